"""Replaying on another platform: what it has to do with it, and how far apart the episodes are."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.elsewhere import HERE, THERE, made_there, move, set_attributes, set_texts
from support.platform_processes import WITHOUT_FMA, command, needs_fma
from support.stored import made_here_but_for_our_version, old_store

from grasp_factory import __version__
from grasp_factory.cli.replay_report import replay_text
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.curation import replay as replaying
from grasp_factory.curation.merge import split
from grasp_factory.curation.replay import replay
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate

pytestmark = pytest.mark.slow

N = 3
CONFIG = FactoryConfig(resolution=(32, 24), block_size=4)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store that no test changes."""
    path = tmp_path_factory.mktemp("replay") / "ds.zarr"
    generate(CONFIG, N, path, workers=1)
    return path


@pytest.fixture
def copy(store: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(store, tmp_path / "ds.zarr"))


def redder(episode: Episode) -> Episode:
    """Return an episode with ten other pixels, whose first object came to lie 3 mm away."""
    (name, frames), *_ = episode.cameras.items()
    rgb = frames.rgb.copy()
    rgb[0, 0, :10, 0] ^= 1
    poses = episode.streams["object_pose"].astype(np.float64)
    poses[:, 0, 0] += 0.003
    streams = {**episode.streams, "object_pose": poses.astype(np.float32)}
    cameras = {name: dataclasses.replace(frames, rgb=rgb)}
    return dataclasses.replace(episode, cameras=cameras, streams=streams)


@pytest.fixture
def changed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every replay give other bytes."""
    real = replaying.run_episode
    monkeypatch.setattr(replaying, "run_episode", lambda world, spec: redder(real(world, spec)))


def attempt(path: Path) -> int:
    """Return a row whose arm moved."""
    return int(np.flatnonzero(Dataset(path).column("n_steps"))[0])


def test_where_the_fingerprint_is_the_same_nothing_is_said_of_the_platform(store: Path) -> None:
    result = replay(store, 0)
    assert result.same
    assert (result.fingerprint, result.here) == (str(HERE), str(HERE))
    assert (result.differing, result.platform, result.distance) == ((), "", None)
    assert "platform" not in replay_text(result)


@pytest.mark.usefixtures("changed")
class TestOtherBytes:
    def test_under_the_same_fingerprint_are_told_to_be_no_platforms_doing(
        self, store: Path
    ) -> None:
        result = replay(store, 0)
        assert not result.same
        assert "fingerprint and versions are the recording's" in result.platform
        assert "the bytes should be the same" in replay_text(result)

    def test_under_the_same_fingerprint_and_other_versions_are_the_versions_doing(
        self, copy: Path
    ) -> None:
        versions = Dataset(copy).attributes["versions"] | {"pybullet": "3.2.6"}
        set_attributes(copy, {"versions": versions})
        result = replay(copy, 0)
        assert result.has_other_versions
        assert result.platform.endswith("it is not the platform, but the versions")
        assert "pybullet: 3.2.6, now" in replay_text(result)

    def test_on_another_machine_of_the_same_fingerprint_should_be_the_same(
        self, copy: Path
    ) -> None:
        platform = Dataset(copy).attributes["platform"] | {"cpu": "Z80", "kernels": "none"}
        set_attributes(copy, {"platform": platform})
        result = replay(copy, 0)
        assert not result.has_other_versions
        assert [change.partition(":")[0] for change in result.changed] == ["cpu", "kernels"]
        assert "the bytes should be the same" in result.platform

    def test_under_another_fingerprint_are_told_to_be_expected(
        self, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        move(monkeypatch)
        result = replay(store, 0)
        assert (result.fingerprint, result.here) == (str(HERE), str(THERE))
        assert result.differing == ("engine",)
        text = replay_text(result)
        assert text.count("engine (simulation steps)") == 1
        assert "bytes need not be the same here; compare where it was recorded" in text

    def test_are_measured(self, store: Path) -> None:
        i = attempt(store)
        result = replay(store, i)
        assert result.distance is not None
        assert result.distance.objects_at_end.mm == pytest.approx(3.0, abs=1e-3)
        assert result.distance.cameras["front"].differing == 10
        assert result.distance.steps_differing == result.distance.steps_recorded > 0
        text = replay_text(result)
        assert "10 of 1536 pixels differ (0.7 %)" in text
        assert "3 mm and 0 degrees at the end" in text
        assert text.index("first difference: cameras/front/rgb: 10 of") < text.index("compared")

    def test_are_told_as_json(self, store: Path, run: Any) -> None:
        code, out, _ = run("replay", store, attempt(store), "--json")
        assert code == 1
        told = json.loads(out)
        assert told["differing"] == []
        assert told["fingerprint"] == told["here"] == str(HERE)
        assert "should be the same" in told["platform"]
        assert told["distance"]["cameras"]["front"]["share"] == pytest.approx(10 / 1536)


class TestWhatIsComparedWith:
    def test_is_the_rows_own_fingerprint(self, copy: Path) -> None:
        set_texts(copy, {1: THERE.text})
        assert replay(copy, 0).differing == ()
        assert replay(copy, 1).differing == ("engine",)

    def test_is_nothing_where_the_rows_own_is_lost(self, copy: Path) -> None:
        made_there(copy, N)
        set_texts(copy, {1: "", 2: "nonsense"})
        for row in (1, 2):
            assert (replay(copy, row).fingerprint, replay(copy, row).differing) == ("", ())

    def test_is_nothing_where_another_store_told_it(self, copy: Path, tmp_path: Path) -> None:
        split(copy, tmp_path / "few", [0])
        set_texts(tmp_path / "few", {0: ""})
        assert FINGERPRINT in Dataset(tmp_path / "few").attributes
        assert replay(tmp_path / "few", 0).fingerprint == ""

    def test_is_told_to_be_unknown_in_a_store_of_a_version_without_fingerprints(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store = old_store(tmp_path)
        made_here_but_for_our_version(store, monkeypatch)
        for row in (0, 3):
            result = replay(store, row)
            assert (result.fingerprint, result.differing) == ("", ())
            assert "does not tell which platform made the episode" in replay_text(result)
            assert result.changed == (f"grasp_factory: 0.4.0, now {__version__}",)


@needs_fma
def test_a_real_other_libm_is_told_with_how_far_apart_the_episodes_are(store: Path) -> None:
    i = attempt(store)
    done = command("replay", store, i, "--json", **WITHOUT_FMA)
    told = json.loads(done.stdout)
    assert {"engine", "libm"} <= set(told["differing"])
    assert "the C library's sine and its kind" in told["platform"]
    assert done.returncode == (0 if told["same"] else 1)
    assert (told["distance"] is None) is told["same"]
