"""Going on with a store on another platform: known before anything is written, and recorded."""

from __future__ import annotations

import dataclasses
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.elsewhere import HERE, THERE, made_there, move
from support.fake_episodes import make_episode, small_config
from support.helpers import assert_same_tree, tree
from support.platform_processes import WITHOUT_FMA, command, needs_fma
from support.stored import old_store

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.platforms import FINGERPRINT, fingerprint_of
from grasp_factory.curation.merge import merge
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryWarning, RecipeError, StoreError, StoreMismatchError
from grasp_factory.factory import block_maker
from grasp_factory.factory.dry_run import forecast
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_request import Request, Shard
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow

CONFIG = small_config()  # blocks of 4
REFUSED = (
    r"ds\.zarr was begun on another platform: the fingerprint differs in engine \(simulation"
    r" steps\), so .*; go on where it was begun, or add --accept-other-platform"
)


def pretend(world: World, spec: EpisodeSpec) -> Episode:
    """Return an episode without physics; that of recipe 2 cannot be made."""
    if spec.index == 2:
        raise RecipeError("no luck with 2")
    return dataclasses.replace(make_episode(CONFIG, spec.index), spec=spec)


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_maker, "run_episode", pretend)


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a store of 6 rows, the second block cut short, made here."""
    folder = tmp_path_factory.mktemp("six")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(block_maker, "run_episode", pretend)
        generate(CONFIG, 6, folder / "ds.zarr", workers=1)
    return folder


@pytest.fixture
def out(six: Path, tmp_path: Path) -> Path:
    """Return a copy of that store, with the diary beside it."""
    shutil.copytree(six, tmp_path, dirs_exist_ok=True)
    return tmp_path / "ds.zarr"


def texts(store: Path) -> list[str]:
    return [str(text) for text in Dataset(store).column("fingerprint")]


def test_a_store_and_each_of_its_rows_tell_the_platform(out: Path) -> None:
    dataset = Dataset(out)
    assert dataset.status.tolist() == [1, 1, 2, 1, 1, 1]
    assert fingerprint_of(dataset.attributes) == HERE
    assert texts(out) == [HERE.text] * 6
    assert "fingerprint" not in dataset[0].columns


def test_the_platform_has_no_part_in_an_episodes_checksum(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    move(monkeypatch)
    other = out.with_name("other.zarr")
    generate(CONFIG, 6, other, workers=1)
    assert texts(other) == [THERE.text] * 6
    ours, theirs = (Dataset(store) for store in (out, other))
    assert ours.column("checksum").tolist() == theirs.column("checksum").tolist()


RUNS: dict[str, dict[str, Any]] = {
    "growing": {"n": 10},
    "a part of a growing store": {"n": 10, "shard": Shard(2, 3)},
    "trying quarantined rows again": {"n": 6, "retry_quarantined": True},
}


class TestOnAnotherPlatform:
    @pytest.fixture(autouse=True)
    def there(self, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        move(monkeypatch)

    @pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
    def test_a_run_is_refused_before_anything_is_written(
        self, out: Path, run: dict[str, Any]
    ) -> None:
        before = tree(out.parent)
        with pytest.raises(StoreMismatchError, match=REFUSED):
            generate(CONFIG, out=out, workers=1, **run)
        assert tree(out.parent) == before

    def test_a_run_that_has_nothing_to_make_says_nothing(self, out: Path) -> None:
        assert generate(CONFIG, 6, out, workers=1).made == 0
        assert generate(CONFIG, 6, out, workers=1, shard=Shard(1, 2)).made == 0

    def test_accepted_it_warns_and_the_new_rows_alone_say_so(self, out: Path) -> None:
        with pytest.warns(GraspFactoryWarning) as told:
            generate(CONFIG, 10, out, workers=1, accept_other_platform=True)
        assert len(told) == 1
        said = str(told[0].message)
        assert "another platform" in said
        assert "engine (simulation steps)" in said
        assert texts(out) == [HERE.text] * 6 + [THERE.text] * 4
        assert fingerprint_of(Dataset(out).attributes) == HERE

    def test_a_quarantined_row_that_is_tried_again_gets_the_text_of_here(self, out: Path) -> None:
        with pytest.warns(GraspFactoryWarning):
            generate(CONFIG, 6, out, 1, retry_quarantined=True, accept_other_platform=True)
        assert texts(out) == [HERE.text] * 2 + [THERE.text] + [HERE.text] * 3

    def test_a_dry_run_says_what_the_run_would_say(self, out: Path) -> None:
        request = Request(config=CONFIG, n=10, workers=1, out=out)
        with pytest.raises(StoreMismatchError, match=REFUSED):
            forecast(request)
        accepted = dataclasses.replace(request, accept_other_platform=True)
        with pytest.warns(GraspFactoryWarning, match="another platform"):
            assert forecast(accepted).to_make == 4

    def test_the_command_refuses_with_one_line_and_exit_code_2(
        self, out: Path, run: Callable[..., tuple[int, str, str]], tmp_path: Path
    ) -> None:
        (tmp_path / "c.yaml").write_text(Request(config=CONFIG, n=10, workers=1).to_yaml())
        words = ("generate", "--config", tmp_path / "c.yaml", "--out", out)
        for more in ((), ("--dry-run",)):
            code, said, err = run(*words, *more)
            note, error = err.splitlines()
            assert (code, said, note) == (2, "", f"Using the config of {out}.")
            assert error.startswith("Error: ")
            assert "--accept-other-platform" in error


def test_going_on_where_the_store_was_begun_gives_the_bytes_of_one_run(
    out: Path, tmp_path: Path
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        generate(CONFIG, 10, out, workers=1)
        generate(CONFIG, 10, tmp_path / "one.zarr", workers=1)
    assert_same_tree(out, tmp_path / "one.zarr")


def test_a_store_that_came_from_elsewhere_is_refused_here(out: Path) -> None:
    made_there(out, 6)
    with pytest.raises(StoreMismatchError, match=REFUSED):
        generate(CONFIG, 10, out, workers=1)


def test_every_part_that_differs_is_named(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    move(monkeypatch, dataclasses.replace(HERE, libm="00000000", images="00000000"))
    what = r"differs in images \(rendered images\) and libm \(the C library's sine and its kind\)"
    with pytest.raises(StoreMismatchError, match=what):
        generate(CONFIG, 10, out, workers=1)


@pytest.mark.usefixtures("fake")
class TestAStoreOfAVersionWithoutFingerprints:
    def test_is_complete_as_ever(self, tmp_path: Path) -> None:
        store = old_store(tmp_path)
        before = tree(store)
        assert generate(Dataset(store).config, 4, store, workers=1).made == 0
        assert tree(store) == before
        assert FINGERPRINT not in Dataset(store).attributes
        assert "fingerprint" not in Dataset(store).columns

    def test_grows_only_if_that_is_accepted(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store = old_store(tmp_path)
        config = Dataset(store).config
        sample = Dataset(store)[0]
        monkeypatch.setattr(
            block_maker, "run_episode", lambda world, spec: dataclasses.replace(sample, spec=spec)
        )
        before = tree(store)
        with pytest.raises(StoreMismatchError, match="by a version without fingerprints; go on"):
            generate(config, 6, store, workers=1)
        assert tree(store) == before
        with pytest.warns(GraspFactoryWarning) as told:
            generate(config, 6, store, workers=1, accept_other_platform=True)
        assert "without fingerprints" in str(told[0].message)
        dataset = Dataset(store)
        assert dataset.status.tolist() == [1, 1, 1, 2, 1, 1]
        assert "fingerprint" not in dataset.columns


@needs_fma
def test_a_real_other_libm_is_refused_and_recorded_when_it_is_accepted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "ds.zarr"
    monkeypatch.undo()  # real episodes
    generate(FactoryConfig(resolution=(32, 24), block_size=1), 1, out, workers=1)
    more = ("--resolution", "32x24", "--workers", 1, "--set", "block_size=1", "--quiet")
    words = ("generate", "--out", out, *more)
    before = tree(out)
    refused = command(*words, "--n", 2, **WITHOUT_FMA)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "libm (the C library's sine and its kind)" in refused.stderr
    assert tree(out) == before
    accepted = command(*words, "--n", 2, "--accept-other-platform", **WITHOUT_FMA)
    assert accepted.returncode == 0
    assert "another platform" in accepted.stderr
    assert len(set(texts(out))) == 2


def test_a_block_that_lost_its_fingerprints_is_not_made_longer(out: Path) -> None:
    (out / "episodes/fingerprint/1").unlink()
    shutil.rmtree(out / "packed", ignore_errors=True)
    with pytest.raises(StoreError, match="episode 4 has a damaged episodes/fingerprint; run"):
        generate(CONFIG, 8, out, workers=1)


def test_rows_that_lost_their_fingerprints_are_not_merged(out: Path) -> None:
    (out / "episodes/fingerprint/1").unlink()
    shutil.rmtree(out / "packed", ignore_errors=True)
    with pytest.raises(StoreError, match="episode 4 has a damaged episodes/fingerprint; run"):
        merge([out], out.with_name("merged.zarr"))
    assert not out.with_name("merged.zarr").exists()
