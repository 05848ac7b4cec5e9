"""Baselines: the figures and their intervals, fitting, no leak, and the two commands."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import accuracy_score, average_precision_score, roc_auc_score
from support.scale import IS_SOAK, scaled

from grasp_factory import FactoryConfig, generate
from grasp_factory.apps.learning.comparison import Course, Splits, compare, read_splits, train_on
from grasp_factory.apps.learning.curve import Steps, learning_curve
from grasp_factory.apps.learning.examples import ExampleReader, Examples
from grasp_factory.apps.learning.progress_callback import unwatched
from grasp_factory.apps.learning.report import report_of, training_report_text
from grasp_factory.apps.learning.scores import (
    FIGURES,
    Bootstrap,
    auc,
    calibration_error,
    object_mean,
)
from grasp_factory.apps.learning.simple_baselines import majority, pose_only
from grasp_factory.apps.learning.training import TrainSettings, cross_entropy, fit
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.enums import Phase
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation.merge import split as split_off
from grasp_factory.curation.versions.origin import state_of
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.policies.networks import KINDS, TOUCH, TouchWindow, load_model, save_model
from grasp_factory.signals.grasp_crop import CropShape

pytestmark = pytest.mark.slow

Run = Callable[..., tuple[int, str, str]]
CROP = CropShape(size=24)
QUICK = TrainSettings(epochs=3)


def plain_auc(success: np.ndarray, probability: np.ndarray) -> float:
    return float(auc(success, probability, np.ones((1, len(success))))[0])


def made_up(n: int, seed: int, kind: str = "vision") -> Examples:
    """Return examples whose label is whether the target is seen left of the middle."""
    rng = np.random.default_rng(seed)
    success = rng.random(n) < 0.5
    inputs = {
        "image": rng.normal(0.0, 0.3, size=(n, 3, 24, 24)).astype(np.float32),
        "width": rng.random((n, 1), dtype=np.float32),
        "touch": rng.normal(0.0, 0.3, size=(n, 2, 6, 60)).astype(np.float32),
    }
    inputs["image"][success, 2, 8:16, 8:16] += 1.0
    inputs["touch"][success, :, 2, 40:] += 1.0
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, 3] = rng.random((n, 3))
    return Examples(
        inputs={name: inputs[name] for name in KINDS[kind]},
        rows=np.arange(n),
        success=success,
        object_id=np.array([f"made/{seed}/{i // 2}" for i in range(n)]),
        T_world_tcp=T,
        width=rng.random(n),
    )


def fitted(kind: str, train: Examples, val: Examples, settings: TrainSettings = QUICK):
    crop, touch = CROP, TouchWindow()
    return fit(kind, train, val, settings, crop=crop, touch=touch, facts={"n": len(train)})


# Figures and intervals


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 1.0)), min_size=2, max_size=60))
def test_the_calibration_error_is_the_mean_gap_by_bin(pairs: list[tuple[bool, float]]) -> None:
    success = np.array([s for s, _ in pairs])
    p = np.array([p for _, p in pairs])
    bins = np.minimum((p * 15).astype(int), 14)
    slow = sum(
        (bins == b).mean() * abs(success[bins == b].mean() - p[bins == b].mean())
        for b in set(bins.tolist())
    )
    assert calibration_error(success, p, np.ones((1, len(p)))) == pytest.approx(slow, abs=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(2, 5))
def test_figures_are_those_of_scikit_learn(seed: int, levels: int) -> None:
    rng = np.random.default_rng(seed)
    success = np.r_[True, False, rng.random(30) < 0.5]
    p = np.round(rng.random(32) * levels) / levels  # with ties, and with 0 and 1
    weight = np.c_[np.ones((3, 2)), rng.integers(0, 4, (3, 30))]
    for name, reference in (
        ("auc", lambda w: roc_auc_score(success, p, sample_weight=w)),
        ("average_precision", lambda w: average_precision_score(success, p, sample_weight=w)),
        ("accuracy", lambda w: accuracy_score(success, p >= 0.5, sample_weight=w)),
    ):
        found = FIGURES[name](success, p, weight)
        assert found == pytest.approx([reference(w) for w in weight])


def test_an_interval_counts_objects_and_not_episodes() -> None:
    rng = np.random.default_rng(1)
    success, p = rng.random(60) < 0.5, rng.random(60)
    every = np.arange(60).astype(str)
    ten_times = np.tile(np.arange(60), 10)
    alone = Bootstrap(success, every, 0).estimate(auc, p)
    copied = Bootstrap(success[ten_times], every[ten_times], 0).estimate(auc, p[ten_times])
    independent = np.arange(600).astype(str)
    naive = Bootstrap(success[ten_times], independent, 0).estimate(auc, p[ten_times])
    assert copied.high - copied.low == pytest.approx(alone.high - alone.low, rel=0.1)
    assert naive.high - naive.low < 0.5 * (alone.high - alone.low)


def test_a_95_percent_interval_has_the_truth_in_it_about_19_times_in_20() -> None:
    rng = np.random.default_rng(2)
    truth, hits = 0.7602, 0  # of unit normals one apart: Phi(1 / sqrt(2))
    for _ in range(40):
        success = rng.random(200) < 0.5
        p = 1.0 / (1.0 + np.exp(-rng.normal(size=200) - success))
        found = Bootstrap(success, np.arange(200).astype(str), 0).estimate(auc, p)
        hits += found.low <= truth <= found.high
    assert 34 <= hits <= 40


def test_a_gain_is_paired() -> None:
    rng = np.random.default_rng(3)
    success, noise = rng.random(300) < 0.5, rng.random(300)
    bootstrap = Bootstrap(success, np.arange(300).astype(str), 0)
    better = noise + 0.05 * success
    gain = bootstrap.gain(auc, better, noise)
    assert 0.0 < gain.low <= gain.value <= gain.high
    same = bootstrap.gain(auc, noise, noise)
    assert (same.value, same.low, same.high) == (0.0, 0.0, 0.0)


# Fitting


@pytest.mark.parametrize("kind", KINDS)
def test_a_network_finds_what_is_there(kind: str) -> None:
    model = fitted(kind, made_up(300, 0, kind), made_up(100, 1, kind)).model
    test = made_up(200, 2, kind)
    assert plain_auc(test.success, model.predict(test.inputs)) > 0.95


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    train, val = made_up(100, 0), made_up(50, 1)
    first, again = (save_model(fitted("vision", train, val).model) for _ in range(2))
    other = save_model(fitted("vision", train, val, TrainSettings(epochs=3, seed=1)).model)
    assert first == again != other


def test_fitting_leaves_torch_as_it_was() -> None:
    import torch

    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    threads = torch.get_num_threads()
    fitted("touch", made_up(50, 0, "touch"), made_up(50, 1, "touch"))
    assert torch.get_num_threads() == threads
    assert torch.rand(1) == expected


def test_the_weights_are_those_of_the_best_epoch_on_val() -> None:
    val = made_up(60, 1)
    shuffled = dataclasses.replace(val, success=np.roll(val.success, 1))
    settings = TrainSettings(epochs=6, patience=2)
    found = fitted("vision", made_up(200, 0), shuffled, settings)
    assert found.best_epoch == int(np.argmin(found.val_loss))
    assert len(found.val_loss) <= found.best_epoch + settings.patience + 1
    raw = found.model.raw_logits(shuffled.inputs)
    assert cross_entropy(raw, shuffled.success) == pytest.approx(min(found.val_loss))


def test_probabilities_are_calibrated_on_val() -> None:
    val = made_up(200, 1)
    found = fitted("vision", made_up(60, 0), val, TrainSettings(epochs=1)).model
    said = found.predict(val.inputs)
    assert said.mean() == pytest.approx(val.success.mean(), abs=0.02)


def test_calibration_does_not_turn_an_order_round() -> None:
    val = made_up(80, 1)
    wrong = dataclasses.replace(val, success=~val.success)
    model = fitted("vision", made_up(300, 0), wrong, TrainSettings(epochs=2)).model
    assert model.slope == 1.0
    order = np.argsort(model.raw_logits(val.inputs))
    assert (np.diff(model.predict(val.inputs)[order]) >= 0.0).all()


def test_one_class_is_nothing_to_learn_from() -> None:
    train = made_up(20, 0)
    good = dataclasses.replace(train, success=np.ones(20, np.bool_))
    with pytest.raises(UsageError, match="train: 20 of 20 usable episodes are a success"):
        fitted("vision", good, train)
    with pytest.raises(UsageError, match="val: 20 of 20"):
        fitted("vision", train, good)


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"epochs": 0}, {"batch": 1}, {"learning_rate": 0.0}, {"smoothing": 0.5}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            TrainSettings(**wrong)


def test_pose_alone_sees_poses_and_majority_nothing() -> None:
    train, test = made_up(400, 0), made_up(200, 1)
    by_pose = [
        dataclasses.replace(part, success=part.T_world_tcp[:, 2, 3] > 0.5) for part in (train, test)
    ]
    found = pose_only(*by_pose)
    assert plain_auc(by_pose[1].success, found) > 0.95
    assert set(majority(*by_pose)) == {by_pose[0].success.mean()}
    blind = pose_only(train, test)  # the label is in the images alone
    assert abs(plain_auc(test.success, blind) - 0.5) < 0.15


# On stores


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a store of train and val objects, and one of test objects."""
    folder = tmp_path_factory.mktemp("stores")
    plain = {"resolution": [96, 72], "seed": 3, "physics": to_plain(PHYSICS_PRESETS["fast"])}
    base = FactoryConfig.from_plain(plain)
    parts = (("learn", ("train", "val"), scaled(80, 240)), ("test", ("test",), scaled(32, 120)))
    for name, splits, n in parts:
        config = dataclasses.replace(base, object_splits=splits)
        generate(config, n, folder / name, workers=2, episode_timeout=60.0)
    return folder / "learn", folder / "test"


def random_auc_spread(success: np.ndarray) -> float:
    """Return the standard deviation of the AUC of random answers (Mann & Whitney 1947)."""
    good = int(success.sum())
    bad = len(success) - good
    return math.sqrt((good + bad + 1) / (12.0 * good * bad))


def check_shuffled(success: np.ndarray, taught: Callable[[int | None], float]) -> None:
    """Check that shuffled labels teach nothing, and that those which are not shuffled do."""
    spread = random_auc_spread(success)
    shuffled = np.array([taught(seed) for seed in range(8)])
    noise = 3.0 * max(spread, shuffled.std()) / math.sqrt(len(shuffled))
    assert abs(shuffled.mean() - 0.5) < noise, shuffled
    assert taught(None) > shuffled.max() + spread


def shuffle(part: Examples, seed: int) -> Examples:
    order = np.random.default_rng(seed).permutation(len(part))
    return dataclasses.replace(part, success=part.success[order])


def test_shuffled_labels_teach_nothing() -> None:
    train, val, test = made_up(300, 0), made_up(100, 1), made_up(200, 2)

    def taught(seed: int | None) -> float:
        parts = [train, val] if seed is None else [shuffle(part, seed) for part in (train, val)]
        return plain_auc(test.success, fitted("vision", *parts).model.predict(test.inputs))

    check_shuffled(test.success, taught)


@pytest.mark.soak
@pytest.mark.skipif(not IS_SOAK, reason="few episodes teach too little")
def test_shuffled_labels_of_real_episodes_teach_nothing(stores: tuple[Path, Path]) -> None:
    learn, test = map(Dataset, stores)
    course = Course(kinds=("vision",), settings=TrainSettings(epochs=10))
    splits = read_splits(learn, test, ["vision"], course, unwatched)

    def taught(seed: int | None) -> float:
        parts = {}
        for name in ("train", "val"):
            part = getattr(splits, name)
            parts[name] = part if seed is None else shuffle(part, seed)
        model = train_on(dataclasses.replace(splits, **parts), "vision", course, learn).model
        return plain_auc(splits.test.success, model.predict(splits.test.inputs))

    check_shuffled(splits.test.success, taught)


def test_held_out_episodes_have_no_part_in_training(stores: tuple[Path, Path]) -> None:
    course = Course(kinds=("vision",), settings=QUICK, crop=CROP)
    dataset = Dataset(stores[1])

    def trained(test: Examples) -> bytes:
        splits = Splits(train=made_up(100, 0), val=made_up(60, 1), test=test)
        return save_model(train_on(splits, "vision", course, dataset).model)

    assert trained(made_up(60, 2)) == trained(made_up(60, 3).take(slice(0, 40)))


def test_touch_is_judged_on_what_got_to_the_lift(stores: tuple[Path, Path]) -> None:
    dataset = Dataset(stores[1])
    lifted = ExampleReader(dataset=dataset, uses=(TOUCH,)).usable()
    by_hand = [
        row
        for row in dataset.committed
        if (dataset.series(int(row), "phase")["phase"] == Phase.LIFT).any()
    ]
    assert lifted.tolist() == by_hand
    assert 0 < len(lifted) < len(dataset)


def test_a_comparison_has_every_baseline_on_its_population(stores: tuple[Path, Path]) -> None:
    learn, test = map(Dataset, stores)
    found = compare(learn, test, Course(episodes=60, settings=QUICK, crop=CROP))
    attempts, lifts = found.populations["attempts"], found.populations["lifts"]
    assert list(attempts.scores) == ["majority", "pose", "vision"]
    assert list(lifts.scores) == [*("majority", "pose", "vision", "touch", "both", "vision_lifts")]
    assert attempts.train_episodes == 60 > lifts.train_episodes
    assert len(lifts.success) < len(attempts.success)
    for scores in attempts.scores.values():
        assert scores["auc"].low <= scores["auc"].value <= scores["auc"].high
    text = training_report_text(report_of(found, {}))
    assert "AUC of both over vision_lifts on lifts" in text
    assert max(len(line) for line in text.splitlines()) < 120


def test_an_object_in_train_and_test_is_no_held_out_object(stores: tuple[Path, Path]) -> None:
    dataset = Dataset(stores[0])
    honest = dataset.split
    course = Course(kinds=("vision",), crop=CROP)

    class Leaky(Dataset):
        def split(self, name: str):
            return honest("train" if name == "test" else name)

    leaky = Leaky(stores[0])
    with pytest.raises(UsageError, match="is in train and in test"):
        read_splits(leaky, leaky, ["vision"], course, unwatched)


def test_a_curve_has_nested_parts_and_every_seed(stores: tuple[Path, Path]) -> None:
    learn, test = map(Dataset, stores)
    steps = Steps(kind="touch", sizes=(15, 40), seeds=2)
    course = Course(kinds=("touch",), settings=QUICK)
    curve = learning_curve(learn, test, steps, course)
    assert list(curve.auc) == ["touch", "pose"]
    assert all(len(seeds) == 2 for seeds in curve.by_seed["touch"])
    for at_size, seeds in zip(curve.auc["touch"], curve.by_seed["touch"], strict=True):
        assert at_size.value == pytest.approx(np.mean(seeds))
        assert at_size.low <= at_size.value <= at_size.high
    again = Course(kinds=("touch",), settings=dataclasses.replace(QUICK, seed=1))
    other = learning_curve(learn, test, steps, again)
    assert other.by_seed["touch"][0][0] == curve.by_seed["touch"][0][1]  # seeds 1, 2 after 0, 1
    assert other.by_seed["touch"] != curve.by_seed["touch"]
    with pytest.raises(UsageError, match="sizes: got 5000, valid: up to"):
        learning_curve(learn, test, Steps(kind="touch", sizes=(5000,)), course)


def test_train_writes_weights_report_and_plots_once(
    stores: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    learn, test = stores
    args = ("train", learn, "--test", test, "--baseline", "touch", "--epochs", "2")
    code, said, _ = run(*args, "--out", tmp_path / "a")
    assert code == 0
    assert "touch" in said and "majority" in said
    names = ["calibration.png", "report.json", "roc.png", "touch.safetensors"]
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == names
    report = json.loads((tmp_path / "a" / "report.json").read_text())
    assert report["populations"]["lifts"]["scores"]["touch"]["auc"]["value"] > 0.0
    assert load_model((tmp_path / "a" / "touch.safetensors").read_bytes(), "touch").kind == "touch"
    code, _, said = run(*args, "--out", tmp_path / "a")
    assert (code, said.count("\n")) == (2, 1)
    assert "exists and is not an empty folder" in said
    assert run(*args, "--out", tmp_path / "b")[0] == 0
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_learning_curve_writes_its_table_and_plot(
    stores: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    learn, test = stores
    code, said, _ = run(
        "learning-curve", learn, "--test", test, "--baseline", "touch", "--sizes", "20,40",
        "--seeds", "1", "--epochs", "2", "--out", tmp_path / "c",
    )  # fmt: skip
    assert code == 0
    assert said.startswith("episodes")
    names = sorted(p.name for p in (tmp_path / "c").iterdir())
    assert names == ["learning-curve.json", "learning-curve.png"]
    curve = json.loads((tmp_path / "c" / "learning-curve.json").read_text())["curve"]
    assert curve["sizes"] == [20, 40]


@pytest.mark.parametrize(
    ("args", "reason"),
    [
        (("train", "{store}", "--epochs", "0"), "epochs: got 0"),
        (("train", "{store}", "--episodes", "0"), "episodes: got 0"),
        (("train", "nowhere"), "nowhere"),
        (("train", "{store}", "--test", "{store}", "--out", "{store}/x"), "inside a store"),
        (("train", "{store}", "--out", "/proc/nope"), "cannot be made"),
        (("train", "{store}", "--noise", "nope"), "unknown"),
        (("learning-curve", "{store}", "--sizes", "1,x"), "valid: numbers"),
        (("learning-curve", "{store}", "--sizes", "9,3"), "ascending"),
        (("learning-curve", "{store}", "--seeds", "0"), "seeds: got 0"),
    ],
)
def test_a_mistake_is_told_in_a_line(
    stores: tuple[Path, Path],
    complaint: Callable[..., tuple[int, str]],
    args: tuple[str, ...],
    reason: str,
) -> None:
    code, said = complaint(*(arg.format(store=stores[1]) for arg in args))
    assert (code, said.count("\n")) == (2, 1)
    assert reason in said


def test_a_store_without_held_out_objects_is_told_what_it_lacks(
    stores: tuple[Path, Path], complaint: Callable[..., tuple[int, str]]
) -> None:
    code, said = complaint("train", stores[0])
    assert (code, said.count("\n")) == (2, 1)
    assert "split test" in said


def test_more_episodes_than_there_are_is_refused(
    stores: tuple[Path, Path], complaint: Callable[..., tuple[int, str]]
) -> None:
    code, said = complaint("train", stores[0], "--test", stores[1], "--episodes", "9999")
    assert (code, said.count("\n")) == (2, 1)
    assert "episodes: got 9999, valid: up to" in said


def test_chosen_rows_of_the_train_split_alone_are_learned_from(
    stores: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    learn, test = stores
    rows = Dataset(learn).split("train").indices[::2].tolist()
    (tmp_path / "ids").write_text("\n".join(map(str, rows)))
    said = run(
        "train", learn, "--test", test, "--baseline", "vision", "--epochs", "1",
        "--ids", tmp_path / "ids", "--out", tmp_path / "t",
    )  # fmt: skip
    assert said[0] == 0
    report = json.loads((tmp_path / "t" / "report.json").read_text())
    assert report["course"]["rows"] == rows
    course = Course(kinds=("vision",), rows=rows)
    dataset, judge = Dataset(learn), Dataset(test)
    splits = read_splits(dataset, judge, ["vision"], course, unwatched)
    whole = read_splits(dataset, judge, ["vision"], Course(kinds=("vision",)), unwatched)
    learned_from = report["populations"]["attempts"]["train_episodes"]
    assert learned_from == len(splits.train) < len(whole.train)
    assert (len(splits.val), len(splits.test)) == (len(whole.val), len(whole.test))


@pytest.fixture(scope="module")
def halves(stores: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return two stores with the episodes of the first one, in their order."""
    rows, folder = Dataset(stores[0]).committed, tmp_path_factory.mktemp("halves")
    for name, mine in (("a.zarr", rows[:50]), ("b.zarr", rows[50:])):
        split_off(stores[0], folder / name, mine.tolist())
    return [folder / "a.zarr", folder / "b.zarr"]


def test_several_stores_teach_what_one_with_their_episodes_does(
    stores: tuple[Path, Path], halves: list[Path], tmp_path: Path, run: Run
) -> None:
    learn, test = stores
    rows = Dataset(learn).split("train").indices
    places = np.searchsorted(Dataset(learn).committed, rows[rows.size // 4 :]).tolist()
    starts, lines = Dataset(halves).starts, []
    for place in places:
        store = int(np.searchsorted(starts, place, side="right")) - 1
        lines.append(f"{halves[store]}:{place - starts[store]}")
    (tmp_path / "ids").write_text("\n".join([f"{halves[0]}:50", *lines]))  # one beyond its end
    (tmp_path / "own").write_text("\n".join(map(str, rows[rows.size // 4 :])))
    options = ("--test", test, "--baseline", "touch", "--epochs", "1")
    one = run("train", learn, *options, "--ids", tmp_path / "own", "--out", tmp_path / "one")
    two = run("train", *halves, *options, "--ids", tmp_path / "ids", "--out", tmp_path / "two")
    assert (one[0], two) == (0, (0, one[1].replace("/one", "/two"), one[2]))
    models = [
        load_model((tmp_path / name / "touch.safetensors").read_bytes(), "touch")
        for name in ("one", "two")
    ]
    weights = [model.network.state_dict() for model in models]
    assert all(torch.equal(weights[0][key], weights[1][key]) for key in weights[0])
    states = [state_of(path) for path in halves]
    assert models[1].facts["stores"] == [
        {"config_sha256": state.config_sha256, "rows_sha256": state.rows_sha256} for state in states
    ]
    report = json.loads((tmp_path / "two" / "report.json").read_text())
    assert report["course"]["rows"] == places
    assert [store["path"] for store in report["store"]] == list(map(str, halves))
    assert report["test"]["path"] == str(test)
    told = run("provenance", tmp_path / "two")[1]
    assert all(f"rows {state.rows_sha256[:12]}" in told for state in states)


def test_stores_that_do_not_go_together_are_refused(
    stores: tuple[Path, Path],
    halves: list[Path],
    complaint: Callable[..., tuple[int, str]],
    tmp_path: Path,
) -> None:
    split_off(halves[1], tmp_path / "again.zarr", [3, 4])
    (tmp_path / "ids").write_text("3")
    for args, words in (
        ((*halves, stores[1]), "are of different kinds: object_splits"),
        ((*halves, tmp_path / "again.zarr"), "row 0 are the same episode, of 2 that are there"),
        ((*halves, "--ids", tmp_path / "ids"), "--ids: valid for several stores: lines STORE:ROW"),
        (halves, f"split test: {halves[0]} and 1 more has no episodes with a grasp"),
    ):
        code, said = complaint("train", *args, "--out", tmp_path / "out")
        assert (code, said.count("\n")) == (2, 1)
        assert words in said
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


def test_rows_of_which_nothing_can_be_learned_are_refused(
    stores: tuple[Path, Path], complaint: Callable[..., tuple[int, str]], tmp_path: Path
) -> None:
    learn, test = stores
    (tmp_path / "ids").write_text("\n".join(map(str, Dataset(learn).split("val").indices)))
    code, said = complaint("train", learn, "--test", test, "--ids", tmp_path / "ids")
    assert (code, said.count("\n")) == (2, 1)
    assert "none of which is a train episode with a grasp; valid: some of the" in said


def test_a_part_with_one_label_is_told_before_anything_is_fitted(
    stores: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    test = Dataset(stores[1])
    monkeypatch.setattr("grasp_factory.apps.learning.comparison.fit", None)
    rows = test.where(split="test").indices
    lost = rows[~test.column("success")[rows]]
    monkeypatch.setattr(Dataset, "split", lambda self, name: self[lost if name == "test" else rows])
    with pytest.raises(UsageError, match=r"split test of .*: 0 of \d+ attempts are a success"):
        compare(test, test, Course(crop=CROP))


def test_without_the_extra_the_command_says_what_to_install(
    complaint: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
    code, said = complaint("train", tmp_path)
    assert code == 2
    assert "pip install 'grasp-factory[train]'" in said


VALUES = st.lists(
    st.tuples(st.integers(0, 5), st.floats(-10.0, 10.0)), min_size=1, max_size=40
)  # fmt: skip


class TestMeansOverObjects:
    @given(VALUES)
    def test_the_value_is_the_mean_and_the_interval_within_the_extremes(
        self, drawn: list[tuple[int, float]]
    ) -> None:
        objects, values = (np.array(part) for part in zip(*drawn, strict=True))
        found = object_mean(values, objects.astype(str))
        assert found.value == pytest.approx(values.mean())
        assert values.min() - 1e-9 <= found.low <= found.high <= values.max() + 1e-9

    @given(VALUES, st.randoms(use_true_random=False))
    def test_the_order_of_the_episodes_says_nothing(
        self, drawn: list[tuple[int, float]], random: Any
    ) -> None:
        mixed = random.sample(drawn, len(drawn))
        there, here = (
            object_mean(np.array([v for _, v in rows]), np.array([str(o) for o, _ in rows]))
            for rows in (drawn, mixed)
        )
        assert dataclasses.astuple(here) == pytest.approx(dataclasses.astuple(there))

    def test_the_interval_is_as_wide_as_the_number_of_objects_says(self) -> None:
        rng = np.random.default_rng(0)
        of_object = rng.normal(size=400)
        objects = np.repeat(np.arange(400), 5)
        found = object_mean(of_object[objects], objects.astype(str))
        error = of_object.std() / np.sqrt(400)  # not 2000: an object's episodes are alike
        assert found.high - found.low == pytest.approx(2 * 1.96 * error, rel=0.1)
