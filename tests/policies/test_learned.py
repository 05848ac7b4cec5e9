"""The policy ``learned``: in a model's order, and with the model in the dataset."""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zarr
from support.helpers import assert_same_tree
from support.tiny_models import tiny_model
from support.views import brick, make_view, plain

from grasp_factory.core.cache import VARIABLE, cache_dir, digest
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import Grasp, SceneView
from grasp_factory.core.geometry import Array, apply, inverse, transform
from grasp_factory.curation.merge import merge, split
from grasp_factory.curation.repair import repair
from grasp_factory.curation.replay import replay
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreError, UsageError
from grasp_factory.factory.generate import generate
from grasp_factory.policies import POLICIES, learned, model_registry
from grasp_factory.policies.base import target_points
from grasp_factory.policies.clearance import is_hit, open_gripper
from grasp_factory.policies.learned import LearnedParameters
from grasp_factory.policies.top_down import grasp_height

pytestmark = pytest.mark.slow

N = 6
SHA256 = "0" * 64
SMALL = ("--resolution", "96x72", "--set", "block_size=4", "--quiet", "--n", N)
VIEW = make_view(brick(0.55, 0.06, 0.4), resolution=(160, 120))
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Give an empty cache, and a process that has loaded no model."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    model_registry.find_model.cache_clear()
    yield tmp_path / "cache"
    model_registry.find_model.cache_clear()


def config_of(sha256: str, **more: Any) -> FactoryConfig:
    settings = {"policies": {"learned": 1.0}, "resolution": [96, 72], "block_size": 4}
    parameters = {"learned": {"model": sha256, "candidates": 24}}
    return FactoryConfig.from_plain(settings | {"policy_parameters": parameters} | more)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store made with a tiny model, whose cache is gone."""
    home = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(home / "cache"))
        generate(config_of(model_registry.keep(tiny_model(7))), N, home / "a.zarr", workers=1)
    shutil.rmtree(home / "cache")
    return home / "a.zarr"


@pytest.fixture
def store(made: Path, tmp_path: Path) -> Path:
    """Return a copy of that store."""
    return Path(shutil.copytree(made, tmp_path / "a.zarr"))


def damage(store: Path) -> None:
    """Change a byte of the model, in a chunk that can be read."""
    array = zarr.open_array(store / "models" / "learned", mode="r+")
    data = np.asarray(array[:])
    data[len(data) // 2] ^= 1
    array[:] = data


class TestOrder:
    """What comes first, for a model whose opinion is known: the nearer the middle the better."""

    MIDDLE = np.array([0.55, 0.06])

    @pytest.fixture(autouse=True)
    def scripted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(learned, "grasp_inputs", lambda view, T, widths, shape: T)
        monkeypatch.setattr(
            learned, "find_model", lambda sha256: SimpleNamespace(crop=None, log_odds=self.opinion)
        )

    def opinion(self, T: Array) -> Array:
        return 3.0 - 200.0 * self.distance(T)

    def distance(self, T: Array) -> Array:
        return np.asarray(np.linalg.norm(T[..., :2, 3] - self.MIDDLE, axis=-1))

    def plan(self, view: SceneView = VIEW, seed: int = 0, **settings: Any) -> tuple[Grasp, ...]:
        asked = LearnedParameters(model=SHA256, **settings)
        return learned.plan(view, np.random.default_rng(seed), asked).grasps

    def test_the_most_probable_come_first_with_their_log_odds(self) -> None:
        grasps = self.plan(candidates=50, ranked=50)
        distances = [self.distance(grasp.T_world_tcp) for grasp in grasps]
        assert len(grasps) == 50
        assert distances == sorted(distances)
        odds = [3.0 - 200.0 * distance for distance in distances]
        expected = np.clip(odds, -learned.SUREST, learned.SUREST)
        np.testing.assert_allclose([grasp.score for grasp in grasps], expected, rtol=1e-9)

    def test_or_the_least_certain_or_whatever_was_drawn(self) -> None:
        ways = {key: self.plan(prefer=key, ranked=64) for key in learned.PREFERENCES}
        poses = [sorted(map(repr, plain(grasps))) for grasps in ways.values()]
        assert poses[0] == poses[1] == poses[2]
        doubts = [abs(grasp.score) for grasp in ways["uncertain"]]
        assert doubts == sorted(doubts)
        scores = [grasp.score for grasp in ways["random"]]
        assert scores != sorted(scores)
        half_way = grasp_height(float(target_points(VIEW)[:, 2].max()), VIEW.gripper)
        fitted = [abs(grasp.T_world_tcp[2, 3] - half_way) < 1e-9 for grasp in ways["random"]]
        assert sum(fitted) == 32
        assert 2 < sum(fitted[:16]) < 14  # of both kinds from the start

    def test_a_share_of_the_candidates_fits_the_target(self) -> None:
        for fitted in (0.0, 0.25, 1.0):
            grasps = self.plan(candidates=40, ranked=40, fitted=fitted)
            is_open = [grasp.width == VIEW.gripper.max_width for grasp in grasps]
            assert sum(is_open) >= 40 - round(40 * fitted)
            assert fitted == 0.0 or not all(is_open)

    def test_as_many_are_proposed_as_asked_for(self) -> None:
        assert [len(self.plan(ranked=n)) for n in (1, 8, 256)] == [1, 8, 64]

    def test_other_objects_are_kept_clear_of(self) -> None:
        place = transform(np.eye(3), (0.55, 0.10, 0.03))
        other = (place, (0.06, 0.02, 0.06), int(Label.TARGET) + 1)
        view = make_view([*brick(0.55, 0.06, 0.4), other], resolution=(320, 240))
        points = learned.visible_points(view, lambda labels: labels > view.target_label)

        def hits(grasps: tuple[Grasp, ...]) -> int:
            return sum(
                is_hit(
                    open_gripper(view.gripper, grasp.width),
                    apply(inverse(grasp.T_world_tcp), points), 0.0,
                )
                for grasp in grasps
            )  # fmt: skip

        assert hits(self.plan(VIEW, ranked=64)) > 10  # else the neighbour proves nothing
        free = self.plan(view, ranked=64)
        assert free
        assert hits(free) <= len(free) // 20  # of points between those that are looked at


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({}, "model: got '', valid: the SHA-256 of a trained model's file, which --model FILE"),
        ({"model": "x"}, "model: got 'x', valid: the SHA-256"),
        ({"prefer": "worst"}, "prefer: got 'worst', valid: best, uncertain, random"),
        ({"candidates": 0}, "candidates: got 0, valid: 1 to 4096"),
        ({"fitted": 1.1}, "fitted: got 1.1, valid: 0.0 to 1.0"),
    ],
)
def test_a_wrong_setting_is_named(settings: dict[str, Any], text: str) -> None:
    given = settings if "model" in settings or not settings else {"model": SHA256, **settings}
    with pytest.raises(ConfigError) as caught:
        POLICIES["learned"].settings(given)
    assert str(caught.value).startswith(f"policy_parameters.learned.{text}")


class TestImport:
    def test_a_model_is_found_by_its_hash(self, tmp_path: Path, cache: Path) -> None:
        (tmp_path / "m").write_bytes(tiny_model(1))
        sha256 = model_registry.import_model(tmp_path / "m")
        assert sha256 == digest(tiny_model(1))
        assert model_registry.read(sha256) == tiny_model(1)
        assert model_registry.find_model(sha256).sha256 == sha256
        assert cache_dir() == cache

    def test_one_that_is_absent_or_damaged_is_refused(self, cache: Path) -> None:
        with pytest.raises(ConfigError, match="has no trained model with the SHA-256 '0000"):
            model_registry.read(SHA256)
        sha256 = model_registry.keep(tiny_model(1))
        (file,) = (cache / "models").iterdir()
        file.write_bytes(b"nonsense")
        with pytest.raises(ConfigError, match="give its file with --model FILE"):
            model_registry.find_model(sha256)

    @pytest.mark.parametrize(
        "content",
        [None, b"", b"nonsense", b"\xff" * 4096, tiny_model(1, "touch")],
        ids=["absent", "empty", "text", "ones", "of touch"],
    )
    def test_a_file_that_is_no_model_is_refused_in_a_line(
        self, complaint: Callable[..., tuple[int, str]], tmp_path: Path, content: bytes | None
    ) -> None:
        if content is not None:
            (tmp_path / "m").write_bytes(content)
        code, error = complaint("generate", *SMALL, "--policy", "learned", "--model", "m")
        assert code == 2
        assert error.startswith("Error: m")
        assert error.count("\n") == 1
        assert not list((tmp_path / "cache").rglob("*.safetensors"))

    def test_a_pipe_and_a_file_of_holes_are_no_models(self, tmp_path: Path, cache: Path) -> None:
        os.mkfifo(tmp_path / "pipe")
        with (tmp_path / "holes").open("wb") as file:
            file.truncate(2**40)
        for name in ("pipe", "holes"):
            with pytest.raises(UsageError, match=f"{name} is no model of grasps, valid: a regular"):
                model_registry.import_model(tmp_path / name)

    def test_the_policy_and_its_model_need_each_other(
        self, complaint: Callable[..., tuple[int, str]], tmp_path: Path
    ) -> None:
        (tmp_path / "m").write_bytes(tiny_model(1))
        said = {
            ("--model", "m"): "--model is for the policy learned: add --policy learned",
            ("--policy", "learned"): "policy_parameters.learned.model: got '', valid: the SHA-256",
            ("--policy", "learned", "--set", f"policy_parameters.learned.model={'ab' * 32}"):
                "has no trained model with the SHA-256 'abab",
        }  # fmt: skip
        for options, text in said.items():
            code, error = complaint("generate", *SMALL, *options)
            assert (code, error.count("\n")) == (2, 1)
            assert text in error

    def test_the_settings_that_are_printed_are_those_of_the_run(
        self, run: Run, tmp_path: Path
    ) -> None:
        (tmp_path / "m").write_bytes(tiny_model(1))
        options = ("generate", *SMALL, "--policy", "learned", "--print-config")
        more = ("--set", "policy_parameters.learned.ranked=3", "--model", tmp_path / "m")
        code, text, _ = run(*options, *more)
        assert code == 0
        (tmp_path / "c.yaml").write_text(text)
        assert run("generate", "--config", tmp_path / "c.yaml", "--print-config")[1] == text
        assert digest(tiny_model(1)) in text

    def test_without_torch_a_replay_says_in_one_line_what_to_install(
        self, made: Path, run: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "torch", None)
        code, _, said = run("replay", made, 0)
        assert (code, said.count("\n")) == (2, 1)
        assert "this needs torch, which is not installed" in said

    def test_without_torch_one_line_says_what_to_install(self, tmp_path: Path) -> None:
        code = (
            "import sys; sys.modules['torch'] = None;"
            "from grasp_factory.__main__ import main; main()"
        )
        (tmp_path / "m").write_bytes(tiny_model(1))
        for words in (("generate", *SMALL, "--policy", "learned", "--model", tmp_path / "m"),):
            command = [sys.executable, "-c", code, *map(str, words)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 2
            assert done.stderr.count("\n") == 1, done.stderr
            assert (
                "this needs torch, which is not installed: pip install 'grasp-factory[train]'"
                in done.stderr
            )


class TestTheModelInTheStore:
    def test_it_is_there_and_the_config_names_it(self, made: Path) -> None:
        dataset = Dataset(made)
        assert dataset.config.models == {"learned": digest(tiny_model(7))}
        array = zarr.open_array(made / "models" / "learned", mode="r")
        assert np.asarray(array[:]).tobytes() == tiny_model(7)
        assert dataset.attributes["versions"]["torch"]
        assert set(dataset.column("policy")) == {"learned"}
        assert np.isfinite(dataset.column("grasp_score")).any()

    @pytest.mark.soak
    def test_any_number_of_workers_gives_the_same_bytes(self, made: Path, tmp_path: Path) -> None:
        config = config_of(model_registry.keep(tiny_model(7)))
        generate(config, N, tmp_path / "b.zarr", workers=2)
        assert_same_tree(made, tmp_path / "b.zarr")

    def test_an_episode_replays_from_the_store_alone(self, store: Path, cache: Path) -> None:
        assert replay(store, 2).same
        assert [file.stem for file in (cache / "models").iterdir()] == [digest(tiny_model(7))]

    def test_the_store_is_verified_and_simulated_from_itself(self, store: Path) -> None:
        report = verify(store, deep=1, workers=1, deep_seed=3)
        assert report.is_whole, report.problems
        assert report.notes == ()

    def test_a_run_goes_on_from_the_store_alone(self, store: Path) -> None:
        whole = config_of(digest(tiny_model(7)))
        assert generate(whole, N + 1, store, workers=1).made == 1
        assert Dataset(store).spec(N).policy_parameters["model"] == digest(tiny_model(7))

    def test_another_model_is_another_dataset(self, store: Path) -> None:
        other = config_of(model_registry.keep(tiny_model(8)))
        with pytest.raises(UsageError, match=r"it has policy_parameters.learned.model: "):
            generate(other, N, store, workers=1)

    def test_it_goes_along_into_parts_and_back(self, made: Path, tmp_path: Path) -> None:
        split(made, tmp_path / "x.zarr", [0, 3])
        split(made, tmp_path / "y.zarr", [1, 2, 4, 5])
        merge([tmp_path / "x.zarr", tmp_path / "y.zarr"], tmp_path / "z.zarr")
        for name in "xyz":
            assert_same_tree(made / "models", tmp_path / f"{name}.zarr" / "models")
        assert replay(tmp_path / "x.zarr", 1).same

    def test_a_damaged_one_is_named_and_never_used(self, store: Path, cache: Path) -> None:
        damage(store)
        with pytest.raises(StoreError, match="is damaged: its model of policy 'learned' is not"):
            replay(store, 2)
        assert not cache.exists()
        (problem,) = verify(store, workers=1).problems
        assert (problem.array, problem.what) == ("models/learned", "does not match its checksum")

    def test_a_damaged_one_is_mended_from_the_cache(self, made: Path, store: Path) -> None:
        model_registry.keep(tiny_model(7))
        damage(store)
        assert repair(store, workers=1).is_whole
        assert_same_tree(made, store)

    def test_a_lost_one_can_be_given_again(self, made: Path, store: Path) -> None:
        shutil.rmtree(store / "models")
        with pytest.raises(ConfigError, match="--model FILE"):
            repair(store, workers=1)
        model_registry.keep(tiny_model(7))
        assert repair(store, workers=1).is_whole
        assert_same_tree(made, store)


def test_a_model_that_is_lost_while_blocks_are_made_is_no_episodes_fault(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = config_of(model_registry.keep(tiny_model(7)))
    monkeypatch.setattr("grasp_factory.factory.name_check.find_model", lambda sha256: None)
    shutil.rmtree(cache_dir())
    monkeypatch.setattr("grasp_factory.factory.embedded_assets.packed", lambda config: {})
    with pytest.raises(ConfigError, match="has no trained model"):
        generate(config, N, tmp_path / "b.zarr", workers=1)
    assert not Dataset(tmp_path / "b.zarr").status.any()


def test_the_models_that_a_config_names_are_those_of_policies_that_it_asks() -> None:
    asked = config_of(SHA256)
    assert asked.models == {"learned": SHA256}
    assert dataclasses.replace(asked, policies={"uniform": 1.0}).models == {}
    assert FactoryConfig().models == {}
