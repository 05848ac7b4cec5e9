"""The flywheel: rounds of generate, train and generate, resumed and compared."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.elsewhere import move
from support.helpers import tree

from grasp_factory.apps.active_learning import ARMS, FlywheelSettings, learning, run_rounds
from grasp_factory.apps.active_learning.journal import FILE, Journal
from grasp_factory.apps.active_learning.judging import Judge, mistakes_of
from grasp_factory.apps.active_learning.learning import (
    TrainingSet,
    held_out_examples,
    joined,
    learn,
)
from grasp_factory.apps.active_learning.plot import picture_of
from grasp_factory.apps.active_learning.rounds import Round, SelectionGain
from grasp_factory.apps.active_learning.stores import StoreFacts, complete, make_quietly
from grasp_factory.apps.active_learning.text import flywheel_text
from grasp_factory.apps.learning import scores
from grasp_factory.apps.learning.examples import Examples
from grasp_factory.apps.learning.progress_callback import unwatched
from grasp_factory.apps.learning.scores import Estimate
from grasp_factory.cli import run_progress
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.splits import SPLITS
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreError, StoreMismatchError, UsageError
from grasp_factory.policies import model_registry as models
from grasp_factory.policies.networks import load_model

pytestmark = pytest.mark.slow

Run = Callable[..., tuple[int, str, str]]
SHA256 = "5" * 64
DIARY = ".runs.jsonl"
IMAGES = ("--resolution", "96x72", "--set", "block_size=4", "--physics", "fast")
SMALL = (*IMAGES, "--workers", "1", "--seed", "1")
SIZES = ("--rounds", "1", "--start", "32", "--budget", "8", "--eval", "16", "--try", "4")
FEW = (*SMALL, *SIZES, "--seeds", "2", "--epochs", "2")
RESAMPLES = 60


@pytest.fixture(autouse=True)
def quick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Give an empty cache, and intervals from few resamples."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(scores, "RESAMPLES", RESAMPLES)
    models.find_model.cache_clear()
    yield
    models.find_model.cache_clear()


def settings_of(seed: int = 0, **more: Any) -> FlywheelSettings:
    return FlywheelSettings(config=FactoryConfig(seed=seed), **more)


def lasting(folder: Path) -> dict[str, bytes]:
    """Return all files of a flywheel but the diaries, which have times."""
    return {name: data for name, data in tree(folder).items() if not name.endswith(DIARY)}


def facts(**more: Any) -> StoreFacts:
    one = StoreFacts(
        path="round0.zarr", seed=1, config_sha256=SHA256, contents_sha256=SHA256,
        episodes=16, successes=6, quarantined=0,
    )  # fmt: skip
    return dataclasses.replace(one, **more)


def examples(count: int, seed: int = 0) -> Examples:
    """Return examples of alternating labels, the image of a success brighter than the others."""
    rng = np.random.default_rng(seed)
    success = np.arange(count) % 2 == 0
    images = rng.normal(size=(count, 3, 48, 48)) + success[:, None, None, None]
    return Examples(
        inputs={
            "image": images.astype(np.float32),
            "width": rng.random((count, 1)).astype(np.float32),
        },
        rows=np.arange(count),
        success=success,
        object_id=np.array([f"o{seed}_{i // 2}" for i in range(count)]),
        T_world_tcp=np.tile(np.eye(4), (count, 1, 1)),
        width=np.full(count, 0.05),
    )


def lessons(seed: int = 0) -> TrainingSet:
    return TrainingSet(stores=(facts(),), train=examples(16, seed), val=examples(6, seed + 1))


def turn_of(number: int, auc: float) -> Round:
    band = Estimate(value=auc, low=auc - 0.1, high=auc + 0.1)
    return Round(
        round=number, store=facts(), choice=None, learned_from=("round0.zarr",),
        episodes=100 * (number + 1), train_examples=80, val_examples=10, models=(),
        scores={"auc": band, "average_precision": band, "calibration_error": band},
    )  # fmt: skip


class TestSettings:
    @given(st.integers(0, 2**63 - 1), st.integers(1, 100), st.sampled_from(sorted(ARMS)))
    def test_every_store_has_a_seed_of_its_own_but_for_the_other_arm(
        self, seed: int, number: int, arm: str
    ) -> None:
        settings = settings_of(seed)
        there = settings.round_config(number, arm, SHA256)
        others = [settings.start_config, settings.evaluation_config]
        others += [settings.round_config(k, arm, SHA256) for k in (number - 1, number + 1) if k]
        assert there.seed not in {other.seed for other in others}

    @given(st.integers(0, 2**63 - 1), st.integers(1, 100))
    def test_the_arms_of_a_round_differ_in_what_is_preferred_alone(
        self, seed: int, number: int
    ) -> None:
        active, random = (
            settings_of(seed).round_config(number, arm, SHA256).to_plain()
            for arm in ("active", "random")
        )
        preferred = active["policy_parameters"]["learned"].pop("prefer")
        assert preferred == "uncertain"
        assert random["policy_parameters"]["learned"].pop("prefer") == "random"
        assert active == random

    def test_rounds_drop_no_object_of_those_that_are_judged_on(self) -> None:
        settings = settings_of()
        judged = [settings.evaluation_config, settings.tries_config(SHA256)]
        learned = [settings.start_config, settings.round_config(1, "active", SHA256)]
        assert {c.object_splits for c in judged} == {("test",)}
        assert {c.object_splits for c in learned} == {("train", "val")}

    def test_all_that_the_config_says_of_the_policy_learned_is_kept_for_later_rounds(self) -> None:
        config = FactoryConfig(policy_parameters={"learned": {"candidates": 9}, "uniform": {}})
        settings = FlywheelSettings(config=config)
        settings.check_learned()
        assert "learned" not in settings.start_config.policy_parameters
        own = settings.round_config(2, "random", SHA256).policy_parameters["learned"]
        assert own == {"candidates": 9, "model": SHA256, "prefer": "random"}

    def test_tries_are_made_in_the_scenes_of_the_evaluation(self) -> None:
        settings = settings_of(7)
        assert settings.tries_config(SHA256).seed == settings.evaluation_config.seed

    @pytest.mark.parametrize("number", range(3))
    def test_networks_of_another_number_begin_elsewhere(self, number: int) -> None:
        seeds = [settings_of(3).training(k).seed for k in range(4)]
        assert seeds.count(seeds[number]) == 1

    @pytest.mark.parametrize(
        ("more", "said"),
        [
            ({"rounds": 0}, "rounds: got 0, valid: 1 to 100"),
            ({"start": 0}, "start: got 0"),
            ({"budget": -1}, "budget: got -1"),
            ({"evaluation": 0}, "evaluation: got 0"),
            ({"tries": -1}, "tries: got -1"),
            ({"seeds": 0}, "seeds: got 0"),
            ({"epochs": 0}, "epochs: got 0"),
            ({"select": "worst"}, "select: got 'worst', valid: active, random, both"),
        ],
        ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
    )
    def test_a_size_that_cannot_be_is_named(self, more: dict[str, Any], said: str) -> None:
        with pytest.raises(ConfigError, match=said):
            settings_of(**more)

    @pytest.mark.parametrize(
        ("config", "said"),
        [
            ({"policies": {"learned": 1.0}}, "policies: got .'learned'., valid: policies that"),
            ({"object_splits": ["train"]}, "object_splits: got .'train'., valid: train, val, test"),
            ({"policy_parameters": {"learned": {"prefer": "best"}}}, "learned.prefer: got 'best'"),
            ({"policy_parameters": {"learned": {"model": SHA256}}}, "learned.model: got '555"),
        ],
        ids=["policy", "splits", "prefer", "model"],
    )
    def test_what_the_rounds_set_themselves_is_refused(
        self, config: dict[str, Any], said: str
    ) -> None:
        with pytest.raises(ConfigError, match=said):
            FlywheelSettings(config=FactoryConfig.from_plain(config))

    def test_a_bad_setting_of_the_policy_learned_is_told_before_round_0(self) -> None:
        config = FactoryConfig(policy_parameters={"learned": {"candidates": 0}})
        with pytest.raises(ConfigError, match=r"learned\.candidates: got 0"):
            FlywheelSettings(config=config).check_learned()


def table_of(**columns: Any) -> Any:
    """Return what has columns as a dataset has; a status of 1 is committed."""
    status = np.asarray(columns.pop("status", np.ones(len(columns["success"]), int)))
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    return SimpleNamespace(committed=np.flatnonzero(status == 1), column=arrays.__getitem__)


class TestMistakes:
    def test_a_probability_on_the_wrong_side_is_a_mistake(self) -> None:
        holds = np.array([0.95, 0.95, 0.6, 0.4, 0.05, 0.02])
        found = mistakes_of(
            table_of(
                grasp_score=np.log(holds / (1.0 - holds)),
                success=[True, False, False, True, False, False],
                object_id=list("abcdef"),
            )
        )
        assert found is not None
        assert found.episodes == 6
        assert found.expected == pytest.approx(holds.mean())
        assert found.success.value == pytest.approx(2 / 6)
        assert found.wrong.value == pytest.approx(3 / 6)
        assert found.sure == 4
        assert found.wrong_when_sure is not None
        assert found.wrong_when_sure.value == pytest.approx(1 / 4)
        given_to_truth = np.array([0.95, 0.05, 0.4, 0.4, 0.95, 0.98])
        assert found.surprise.value == pytest.approx(-np.log(given_to_truth).mean())

    def test_episodes_without_a_grasp_or_in_quarantine_do_not_count(self) -> None:
        found = mistakes_of(
            table_of(
                grasp_score=[1.0, np.nan, 1.0],
                success=[True, False, False],
                object_id=list("abc"),
                status=[1, 1, 2],
            )
        )
        assert found is not None
        assert (found.episodes, found.success.value, found.sure) == (1, 1.0, 0)
        assert found.wrong_when_sure is None

    def test_without_any_grasp_there_is_nothing_to_say(self) -> None:
        table = table_of(grasp_score=[np.nan], success=[False], object_id=["a"])
        assert mistakes_of(table) is None


class Guess:
    """Stands for a network: it has its answers by heart."""

    def __init__(self, answers: Any) -> None:
        self._answers = np.asarray(answers, float)

    def predict(self, inputs: Any) -> Any:
        return self._answers


class TestJudging:
    held_out = examples(40)
    right = Guess(np.where(held_out.success, 0.9, 0.1))
    rng = np.random.default_rng(1)
    poor = Guess(rng.random(40))

    def test_the_gain_of_the_right_over_the_poor_is_paired(self) -> None:
        judge = Judge(self.held_out)
        right, poor = judge.judge([self.right, self.right]), judge.judge([self.poor, self.poor])
        assert right.scores()["auc"] == Estimate(value=1.0, low=1.0, high=1.0)
        gain, rest = right.gains(poor)["auc"], poor.scores()["auc"]
        assert gain.value == pytest.approx(1.0 - rest.value)
        assert (gain.low, gain.high) == pytest.approx((1.0 - rest.high, 1.0 - rest.low))

    def test_nothing_is_gained_over_oneself(self) -> None:
        found = Judge(self.held_out).judge([self.right, self.poor])
        assert set(found.gains(found).values()) == {Estimate(value=0.0, low=0.0, high=0.0)}

    def test_figures_are_of_all_networks_and_their_spread_is_in_the_interval(self) -> None:
        judge = Judge(self.held_out)
        both = judge.judge([self.right, self.poor]).scores()["auc"]
        alone = [judge.judge([one]).scores()["auc"] for one in (self.right, self.poor)]
        assert both.value == pytest.approx(np.mean([one.value for one in alone]))
        assert both.high == 1.0
        assert both.low < both.value


class TestLearning:
    def test_joined_examples_follow_one_another(self) -> None:
        parts = [examples(4, 0), examples(2, 1), examples(3, 2)]
        found = joined(parts)
        assert len(found) == 9
        assert np.array_equal(found.inputs["image"][4:6], parts[1].inputs["image"])
        assert found.object_id.tolist() == [o for part in parts for o in part.object_id.tolist()]

    def test_a_network_is_trained_once_and_again_with_the_same_bytes(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        file, training = tmp_path / "a.safetensors", settings_of(epochs=2).training(0)
        learn(file, lessons(), training, unwatched)
        written = file.read_bytes()
        file.unlink()
        learn(file, lessons(), training, unwatched)
        assert file.read_bytes() == written
        monkeypatch.delattr(learning, "fit")
        assert learn(file, lessons(), training, unwatched).sha256 == load_model(written).sha256

    def test_a_network_of_something_else_is_refused_by_name(self, tmp_path: Path) -> None:
        file, training = tmp_path / "a.safetensors", settings_of(epochs=1).training(0)
        learn(file, lessons(), training, unwatched)
        written = file.read_bytes()
        changed = dataclasses.replace(lessons(), stores=(facts(contents_sha256="6" * 64),))
        said = r"a\.safetensors was trained on something else \(stores\.round0\.zarr\.contents_sha"
        with pytest.raises(UsageError, match=said):
            learn(file, changed, training, unwatched)
        with pytest.raises(UsageError, match=r"settings\.seed"):
            learn(file, lessons(), settings_of(epochs=1).training(1), unwatched)
        assert file.read_bytes() == written

    def test_a_network_of_another_version_is_taken(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        file, training = tmp_path / "a.safetensors", settings_of(epochs=1).training(0)
        there = learn(file, lessons(), training, unwatched)
        monkeypatch.setattr(learning, "__version__", "99.0")
        assert learn(file, lessons(), training, unwatched).sha256 == there.sha256

    def test_too_little_to_learn_from_is_told_with_what_helps(self, tmp_path: Path) -> None:
        few = dataclasses.replace(lessons(), val=examples(1))
        with pytest.raises(UsageError, match=r"val: 1 of 1 usable .* larger --start"):
            learn(tmp_path / "a.safetensors", few, settings_of().training(0), unwatched)
        assert list(tmp_path.iterdir()) == []

    def test_a_file_that_is_no_network_is_named(self, tmp_path: Path) -> None:
        file = tmp_path / "a.safetensors"
        file.write_bytes(b"poem")
        with pytest.raises(UsageError, match=r"a\.safetensors: it is no model .* move it away"):
            learn(file, lessons(), settings_of().training(0), unwatched)

    def test_a_folder_in_a_networks_place_is_named(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="cannot be read: Is a directory"):
            learn(tmp_path, lessons(), settings_of().training(0), unwatched)

    def test_an_evaluation_of_one_label_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        one = examples(4)
        alike = dataclasses.replace(one, success=np.ones(4, bool))
        reader = SimpleNamespace(usable=lambda: one.rows, read=lambda rows, step: alike)
        monkeypatch.setattr(learning, "_reader", lambda dataset: reader)
        with pytest.raises(
            UsageError, match=r"4 of 4 usable episodes are a success.* larger --eval"
        ):
            held_out_examples(table_of(success=[True]), unwatched)


class TestJournal:
    def test_a_new_folder_gets_the_settings_at_once(self, tmp_path: Path) -> None:
        Journal(tmp_path / "a" / "b", settings_of(5))
        there = json.loads((tmp_path / "a" / "b" / FILE).read_bytes())
        assert there["settings"]["config"]["seed"] == 5

    def test_notes_do_not_take_back_what_the_file_tells(self, tmp_path: Path) -> None:
        first = Journal(tmp_path, settings_of())
        first.note({"arms": {"active": [turn_of(0, 0.5), turn_of(1, 0.6)]}}, 2)
        whole = (tmp_path / FILE).read_bytes()
        again = Journal(tmp_path, settings_of())
        again.note({"arms": {"active": [turn_of(0, 0.5)]}}, 1)
        assert (tmp_path / FILE).read_bytes() == whole
        again.note({"arms": {"active": [turn_of(k, 0.5) for k in range(3)]}}, 3)
        assert len(json.loads((tmp_path / FILE).read_bytes())["arms"]["active"]) == 3

    def test_an_interval_of_nothing_is_null(self, tmp_path: Path) -> None:
        Journal(tmp_path, settings_of()).finish({"x": [Estimate(value=1, low=np.nan, high=2)]})
        assert json.loads((tmp_path / FILE).read_bytes())["x"][0]["low"] is None

    def test_other_settings_are_refused_with_the_difference(self, tmp_path: Path) -> None:
        Journal(tmp_path, settings_of())
        before = (tmp_path / FILE).read_bytes()
        with pytest.raises(UsageError, match=r"file against run: rounds: 3 against 4"):
            Journal(tmp_path, settings_of(rounds=4))
        with pytest.raises(UsageError, match=r"config\.seed: 0 against 1"):
            Journal(tmp_path, settings_of(1))
        assert (tmp_path / FILE).read_bytes() == before

    @pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 2, "settings": {}}', "\xff"])
    def test_a_file_that_is_no_journal_is_refused(self, tmp_path: Path, text: str) -> None:
        (tmp_path / FILE).write_text(text, encoding="latin-1")
        with pytest.raises(UsageError, match=r"flywheel\.json.*choose another folder"):
            Journal(tmp_path, settings_of())

    def test_a_file_without_end_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / FILE).symlink_to("/dev/zero")
        with pytest.raises(UsageError, match="/dev/zero is in the way: it is no regular file"):
            Journal(tmp_path, settings_of())
        (tmp_path / FILE).unlink()
        os.mkfifo(tmp_path / FILE)
        with pytest.raises(UsageError, match=r"flywheel\.json is in the way"):
            Journal(tmp_path, settings_of())

    def test_a_folder_of_other_things_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "thesis.txt").write_text("mine")
        with pytest.raises(UsageError, match="holds other things"):
            Journal(tmp_path, settings_of())
        assert tree(tmp_path) == {"thesis.txt": b"mine"}

    def test_a_beginning_that_was_killed_is_no_other_thing(self, tmp_path: Path) -> None:
        (tmp_path / f"{FILE}.partial").write_text("{")
        Journal(tmp_path, settings_of())
        assert [path.name for path in tmp_path.iterdir()] == [FILE]

    def test_a_file_in_the_folders_place_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "a").write_text("")
        with pytest.raises((UsageError, StoreError), match="a cannot be a folder"):
            Journal(tmp_path / "a", settings_of())


LINES = {
    "active": [turn_of(0, 0.6), turn_of(1, 0.7)],
    "random": [turn_of(0, 0.6), turn_of(1, 0.65)],
}
GAINS = [
    SelectionGain(
        round=1,
        episodes=200,
        scores={
            "auc": Estimate(value=0.05, low=-0.01, high=0.11),
            "average_precision": Estimate(value=0.02, low=-0.02, high=0.06),
        },
    )
]


class TestPictureAndText:
    def test_the_picture_is_the_same_each_time_and_as_wide_as_there_is_to_show(self) -> None:
        both = picture_of(LINES, GAINS)
        assert both == picture_of(LINES, GAINS)
        alone = picture_of({"active": LINES["active"]}, [])
        widths = [
            cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).shape[1]
            for png in (both, alone)
        ]
        assert widths[0] == 2 * widths[1]

    def test_an_interval_of_nothing_or_beside_its_value_can_be_drawn(self) -> None:
        odd = [
            Estimate(value=0.5, low=np.nan, high=np.nan),
            Estimate(value=0.5, low=np.nextafter(0.5, 1.0), high=0.5),
        ]
        for band in odd:
            gain = dataclasses.replace(GAINS[0], scores={"auc": band})
            turns = [dataclasses.replace(turn_of(0, 0.5), scores={"auc": band})]
            assert picture_of({"active": turns}, [gain]).startswith(b"\x89PNG")

    def test_the_text_has_every_round_once_and_the_gain_with_its_interval(self) -> None:
        judged = {"examples": 40, "objects": 12, "intervals": "95%"}
        text = flywheel_text({"evaluation": judged, "arms": LINES, "gains": GAINS})
        assert text.count("0.600 (0.500 to 0.700)  0.600") == 1
        assert "+0.050 (-0.010 to +0.110)" in text
        assert "40 episodes of 12 held-out objects" in text


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--rounds", "0"), "rounds: got 0"),
        (("--select", "best"), "'best' is not one of"),
        (("--policy", "learned"), "policies: got ['learned']"),
        (("--split", "test"), "object_splits: got ['test']"),
        (("--workers", "0"), "workers: got 0"),
        (("--objects", "nothing"), "unknown object set 'nothing'"),
        (("--set", "policy_parameters.learned.ranked=0"), "learned.ranked: got 0"),
    ],
)
def test_a_mistake_is_one_line_and_makes_nothing(
    complaint: Callable[..., tuple[int, str]], given: tuple[str, ...], said: str
) -> None:
    code, text = complaint("flywheel", "out", *given)
    assert (code, "Traceback" in text) == (2, False)
    assert said in text
    assert not Path("out").exists()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small flywheel with two arms, whose cache is gone."""
    home = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(home / "cache"))
        patch.setattr(scores, "RESAMPLES", RESAMPLES)
        fast = to_plain(PHYSICS_PRESETS["fast"])
        plain = {"seed": 1, "resolution": [96, 72], "block_size": 4, "physics": fast}
        config = FactoryConfig.from_plain(plain)
        settings = FlywheelSettings(
            config=config, rounds=1, start=32, budget=8, evaluation=16, tries=4, seeds=2, epochs=2
        )
        run_rounds(settings, home / "fly", workers=1)
    shutil.rmtree(home / "cache")
    return home / "fly"


@pytest.fixture
def fly(made: Path, tmp_path: Path) -> Path:
    """Return a copy of that folder."""
    return Path(shutil.copytree(made, tmp_path / "fly"))


class TestTurning:
    def test_the_same_command_changes_nothing(self, made: Path, fly: Path, run: Run) -> None:
        code, text, _ = run("flywheel", fly, *FEW)
        assert code == 0
        assert tree(fly) == tree(made)
        assert "AUC, active - random" in text

    def test_json_is_the_file(self, fly: Path, run: Run) -> None:
        code, text, _ = run("flywheel", fly, *FEW, "--json")
        assert (code, text) == (0, (fly / FILE).read_text())

    def test_provenance_is_that_of_the_stores_and_models(self, made: Path) -> None:
        told = json.loads((made / FILE).read_bytes())
        for turns in told["arms"].values():
            assert [turn["round"] for turn in turns] == [0, 1]
            for turn in turns:
                dataset = Dataset(made / turn["store"]["path"])
                assert turn["store"]["config_sha256"] == dataset.config.sha256()
                assert turn["store"]["seed"] == dataset.config.seed
                assert turn["store"]["episodes"] == len(dataset.committed)
                assert turn["learned_from"][-1] == turn["store"]["path"]
                for facts in turn["models"]:
                    model = load_model((made / facts["path"]).read_bytes())
                    assert model.sha256 == facts["sha256"]
                    assert list(model.facts["stores"]) == sorted(turn["learned_from"])
            chosen = Dataset(made / turns[1]["store"]["path"]).config
            first = turns[0]["models"][0]["sha256"]
            assert turns[1]["choice"]["model_sha256"] == first == chosen.models["learned"]
        assert told["gains"][0]["episodes"] == 40
        assert str(made) not in (made / FILE).read_text()

    def test_the_arms_share_round_0_and_differ_in_selection_alone(self, made: Path) -> None:
        told = json.loads((made / FILE).read_bytes())["arms"]
        assert told["active"][0] == told["random"][0]
        stores = [Dataset(made / arm / "round1.zarr") for arm in ("active", "random")]
        plain = [store.config.to_plain() for store in stores]
        where = "policy_parameters.learned.prefer"
        assert first_difference(*plain) == f"{where}: 'uncertain' against 'random'"
        for name in ("object_id", "object_rest_pose"):
            assert np.array_equal(*(store.column(name) for store in stores))
        assert not np.array_equal(*(store.column("grasp_position") for store in stores))

    def test_what_is_judged_on_was_never_learned_from(self, made: Path) -> None:
        for name in ("round0.zarr", "active/round1.zarr", "random/round1.zarr"):
            assert set(Dataset(made / name).column("split")) <= {"train", "val"}
        tried = [Dataset(made / arm / "tries.zarr") for arm in ARMS]
        judged = Dataset(made / "evaluation.zarr")
        assert set(judged.column("split")) == {"test"} <= set(SPLITS)
        for store in tried:
            assert np.array_equal(store.column("object_id"), judged.column("object_id")[:4])

    @pytest.mark.soak
    def test_what_is_deleted_is_made_again_with_the_same_bytes(
        self, made: Path, fly: Path, run: Run
    ) -> None:
        for name in ("round0.safetensors", "active/round1.seed1.safetensors", "flywheel.png"):
            (fly / name).unlink()
        assert run("flywheel", fly, *FEW)[0] == 0
        assert lasting(fly) == lasting(made)

    @pytest.mark.soak
    def test_a_flywheel_that_was_stopped_goes_on(
        self, made: Path, fly: Path, run: Run, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for path in (fly / "random", fly / "active" / "tries.zarr"):
            shutil.rmtree(path)
        (fly / "flywheel.png").unlink()
        told = json.loads((fly / FILE).read_bytes())
        (fly / FILE).write_text(json.dumps({k: told[k] for k in ("format", "settings")}))
        make = run_progress.make

        def make_until_random(request: Any, progress: Any) -> Any:
            if "random" in request.out.parts:
                raise KeyboardInterrupt
            return make(request, progress)

        with monkeypatch.context() as patch:
            patch.setattr(run_progress, "make", make_until_random)
            code, _, said = run("flywheel", fly, *FEW)
        assert code == 130
        assert "run the same command again to continue" in said
        noted = json.loads((fly / FILE).read_bytes())["arms"]
        assert [len(noted[arm]) for arm in ("active", "random")] == [2, 1]
        assert run("flywheel", fly, *FEW)[0] == 0
        assert lasting(fly) == lasting(made)

    def test_another_command_is_refused_and_changes_nothing(
        self, made: Path, fly: Path, run: Run
    ) -> None:
        code, _, said = run("flywheel", fly, *FEW, "--budget", "9")
        assert code == 2
        assert "budget: 8 against 9" in said
        assert tree(fly) == tree(made)

    @pytest.mark.soak
    def test_one_arm_has_no_gain(self, fly: Path, run: Run, tmp_path: Path) -> None:
        alone = tmp_path / "alone"
        alone.mkdir()
        told = json.loads((fly / FILE).read_bytes())
        settings = told["settings"] | {"select": "random", "tries": 0}
        (alone / FILE).write_text(json.dumps({"format": 1, "settings": settings}))
        for name in ("round0.zarr", "evaluation.zarr", "random/round1.zarr"):
            shutil.copytree(fly / name, alone / name)
        code, text, _ = run("flywheel", alone, *FEW, "--select", "random", "--try", "0")
        assert code == 0
        assert "active" not in text
        found = json.loads((alone / FILE).read_bytes())
        assert found["gains"] == []
        assert found["arms"]["random"] == told["arms"]["random"]


def test_all_stores_of_a_flywheel_come_from_one_platform(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, path = FactoryConfig(resolution=(32, 24)), tmp_path / "round0.zarr"
    assert len(complete(path, config, 1, workers=1, make=make_quietly)) == 1
    assert len(complete(path, config, 1, workers=1, make=make_quietly)) == 1
    move(monkeypatch)
    with pytest.raises(StoreMismatchError, match=r"engine \(.*; go on with the flywheel where it"):
        complete(path, config, 1, workers=1, make=make_quietly)
