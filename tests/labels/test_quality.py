"""The quality gate: each criterion sees what it is for, and a score follows from columns alone."""

from __future__ import annotations

import dataclasses
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.scenes import SMALL, cube_spec, default_episodes

from grasp_factory.cli.store_report import store_text
from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Label, Phase
from grasp_factory.core.episode import Episode
from grasp_factory.core.schema import MAX_CONTACTS
from grasp_factory.curation.replay import replay
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import ConfigError, RecipeError
from grasp_factory.factory.generate import generate
from grasp_factory.labels.force_balance import acceleration, force_residual, pads_on_target
from grasp_factory.labels.image_metrics import (
    CLIPPED,
    Inspection,
    depth_holes,
    exposure,
    grey,
    inspect_episode,
    longest_gap,
    sharpness,
)
from grasp_factory.labels.quality import (
    BEST,
    CRITERIA,
    MEASURED,
    WORST,
    QualityConfig,
    quality_scores,
    shortcomings,
)
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow

USUAL = QualityConfig()
GROUPS = tuple(dict.fromkeys(criterion.group for criterion in CRITERIA))
Streams = dict[str, NDArray[Any]]
Grey = NDArray[np.uint8]


def held_episode() -> Episode:
    """Return an episode with a hold."""
    return next(episode for episode in default_episodes(6) if episode.success)


def found_in(episode: Episode) -> dict[str, float]:
    """Return all that a score is made from, the images and streams measured anew."""
    return {**episode.columns, **dataclasses.asdict(inspect_episode(episode))}


def missed_groups(values: dict[str, float]) -> set[str]:
    return {c.group for c in CRITERIA if not c.is_met(values[c.column], USUAL)}


def with_frames(episode: Episode, **arrays: NDArray[Any]) -> Episode:
    """Return an episode whose front camera has other arrays."""
    frames = dataclasses.replace(episode.cameras["front"], **arrays)
    return dataclasses.replace(episode, cameras={**episode.cameras, "front": frames})


def with_streams(episode: Episode, **streams: NDArray[Any]) -> Episode:
    return dataclasses.replace(episode, streams={**episode.streams, **streams})


def with_columns(episode: Episode, **columns: Any) -> Episode:
    return dataclasses.replace(episode, columns={**episode.columns, **columns})


def recolored(change: Callable[[NDArray[Any]], NDArray[Any]]) -> Callable[[Episode], Episode]:
    def spoil(episode: Episode) -> Episode:
        rgb = episode.cameras["front"].rgb
        frames = [np.clip(change(frame), 0, 255).astype(np.uint8) for frame in rgb]
        return with_frames(episode, rgb=np.stack(frames))

    return spoil


def only_black_and_white(rgb: NDArray[Any]) -> NDArray[Any]:
    return 0 * rgb + 255 * (rgb.mean(axis=2, keepdims=True) > 140)


def hide_target(episode: Episode) -> Episode:
    seen = episode.cameras["front"].visibility.copy()
    seen[0, 0] = 0.3
    return with_frames(episode, visibility=seen)


def shrink_target(episode: Episode) -> Episode:
    labels = episode.cameras["front"].segmentation.copy()
    pixels = np.argwhere(labels[0] == Label.TARGET)[USUAL.min_target_pixels - 1 :]
    labels[0][tuple(pixels.T)] = Label.TABLE
    return with_frames(episode, segmentation=labels)


def holed(value: float) -> Callable[[Episode], Episode]:
    def spoil(episode: Episode) -> Episode:
        depth = episode.cameras["front"].depth.copy()
        depth[0, : depth.shape[1] // 3] = value
        return with_frames(episode, depth=depth)

    return spoil


def without_record(episode: Episode) -> Episode:
    gone = episode.n_steps // 2
    return with_streams(
        episode, **{name: np.delete(v, gone, axis=0) for name, v in episode.streams.items()}
    )


def without_imus_end(episode: Episode) -> Episode:
    imu = {n: v[:-5] if n != "T_tcp_imu" else v for n, v in episode.imu.items()}
    return dataclasses.replace(episode, own_rate={**episode.own_rate, "imu": imu})


def with_exploding_contacts(episode: Episode) -> Episode:
    rng = np.random.default_rng(0)
    force = episode.streams["tactile_force"]
    kicks = rng.normal(scale=50.0, size=force.shape).astype(np.float32)
    return with_streams(episode, tactile_force=force + kicks)


SPOILED: dict[str, tuple[str, Callable[[Episode], Episode]]] = {
    "a blurred image": ("image", recolored(lambda rgb: cv2.GaussianBlur(rgb, (0, 0), 1.5))),
    "a black image": ("image", recolored(lambda rgb: 0 * rgb)),
    "an over-exposed image": ("image", recolored(lambda rgb: 3.0 * rgb)),
    "an under-exposed image": ("image", recolored(lambda rgb: rgb // 8)),
    "an image of too much contrast": ("image", recolored(only_black_and_white)),
    "a hidden target": ("target", hide_target),
    "a target of few pixels": ("target", shrink_target),
    "holes of no depth": ("depth", holed(0.0)),
    "holes of NaN": ("depth", holed(math.nan)),
    "holes without an end": ("depth", holed(math.inf)),
    "holes at the end of the range": ("depth", holed(SMALL.cameras["front"].far)),
    "a lost record": ("streams", without_record),
    "an IMU that stops early": ("streams", without_imus_end),
    "exploding contacts": ("physics", with_exploding_contacts),
    "pads deep in the target": ("physics", lambda e: with_columns(e, max_penetration=0.002)),
    "the robot deep in the table": ("physics", lambda e: with_columns(e, table_penetration=0.002)),
}


class TestCriteria:
    def test_clean_episodes_score_best(self) -> None:
        for episode in default_episodes(20):
            assert missed_groups(found_in(episode)) == set()
            assert episode.columns["quality"] == BEST

    @pytest.mark.parametrize("what", SPOILED)
    def test_what_is_wrong_costs_the_point_of_its_group(self, what: str) -> None:
        group, spoil = SPOILED[what]
        values = found_in(spoil(held_episode()))
        assert missed_groups(values) == {group}
        assert quality_scores(values, USUAL) == BEST - 1

    def test_every_group_is_spoiled_once(self) -> None:
        assert {group for group, _ in SPOILED.values()} == set(GROUPS)

    def test_an_episode_in_which_everything_is_wrong_scores_worst(self) -> None:
        episode = held_episode()
        for _, spoil in SPOILED.values():
            episode = spoil(episode)
        assert missed_groups(found_in(episode)) == set(GROUPS)
        assert quality_scores(found_in(episode), USUAL) == WORST

    def test_without_an_attempt_streams_and_physics_do_not_apply(self) -> None:
        with World() as world:
            episode = run_episode(world, cube_spec((0.9, 0.0, 0.05)))
        values = found_in(episode)
        assert episode.n_steps == 0
        assert math.isnan(values["stream_gap"])
        assert math.isnan(values["force_residual"])
        assert not {"streams", "physics"} & missed_groups(values)

    def test_of_two_cameras_the_worse_image_and_the_better_view_count(self) -> None:
        good = held_episode()
        far = good.spec.cameras["front"]
        spec = dataclasses.replace(good.spec, cameras={"front": far, "side": far})
        bad = good
        for what in ("a blurred image", "a hidden target", "holes of no depth"):
            bad = SPOILED[what][1](bad)
        cameras = {"front": good.cameras["front"], "side": bad.cameras["front"]}
        both = inspect_episode(dataclasses.replace(good, spec=spec, cameras=cameras))
        alone, spoiled = inspect_episode(good), inspect_episode(bad)
        assert (both.sharpness, both.depth_holes) == (spoiled.sharpness, spoiled.depth_holes)
        assert both.target_visibility == alone.target_visibility > spoiled.target_visibility


def real_image() -> Grey:
    return grey(held_episode().cameras["front"].rgb[0])


class TestImages:
    def test_grey_is_the_luma_of_the_colour(self) -> None:
        colors = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [90, 90, 90]]], np.uint8)
        assert grey(colors).tolist() == [[76, 150, 29, 90]]

    @pytest.mark.parametrize("value", [0, 3, 100, 255])
    def test_a_flat_image_is_not_sharp(self, value: int) -> None:
        assert sharpness(np.full((24, 32), value, np.uint8)) == 0.0

    def test_the_wider_the_blur_the_less_is_left(self) -> None:
        image = real_image()
        blurred = [np.asarray(cv2.GaussianBlur(image, (0, 0), s), np.uint8) for s in (0.5, 1, 1.5)]
        shares = [sharpness(i) for i in (image, *blurred)]
        assert shares == sorted(shares, reverse=True)
        assert shares[-1] < USUAL.min_sharpness < shares[0]

    def test_half_the_contrast_is_as_sharp(self) -> None:
        image = real_image()
        assert sharpness(image // 2 + np.uint8(60)) == pytest.approx(sharpness(image), abs=0.03)

    def test_twice_the_resolution_is_as_sharp(self) -> None:
        found = []
        with World() as world:
            for size in ((96, 72), (192, 144), (384, 288)):
                spec = sample_spec(FactoryConfig(resolution=size), 0)
                found.append(run_episode(world, spec).columns["sharpness"])
        assert max(found) - min(found) < 0.03

    @given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 12))
    def test_exposure_is_the_mean_and_the_share_at_the_ends(
        self, one: int, other: int, rows: int
    ) -> None:
        image = np.full((12, 16), one, np.uint8)
        image[:rows] = other
        values = [other] * rows + [one] * (12 - rows)
        mean, clipped = exposure(image)
        assert mean == pytest.approx(np.mean(values) / 255.0)
        ends = [v for v in values if v <= CLIPPED or v >= 255 - CLIPPED]
        assert clipped == pytest.approx(len(ends) / 12)

    @given(st.floats(0.02, 100.0), st.integers(0, 12))
    def test_only_what_lies_within_the_range_has_depth(self, far: float, rows: int) -> None:
        depth = np.full((12, 16), 0.5 * far, np.float32)
        depth[:rows] = far
        assert depth_holes(depth, far) == pytest.approx(rows / 12)

    def test_nothing_is_changed_and_what_is_read_only_will_do(self) -> None:
        rgb = held_episode().cameras["front"].rgb[0].copy()
        before, rgb.flags.writeable = rgb.copy(), False
        image = grey(rgb)
        image.flags.writeable = False
        assert 0.0 < sharpness(image) < 1.0 > exposure(image)[0]
        assert np.array_equal(rgb, before)


class TestStreams:
    @given(st.integers(2, 400), st.sampled_from([10, 120, 240]))
    def test_an_even_series_has_a_gap_of_one_period(self, n: int, rate: int) -> None:
        times = np.arange(1, n + 1) / rate
        assert longest_gap([(times, rate)]) == pytest.approx(1.0)

    @given(st.integers(3, 100), st.integers(1, 5), st.integers(0, 99))
    def test_lost_records_are_as_many_periods(self, n: int, lost: int, start: int) -> None:
        assume(start + lost < n)
        whole = np.arange(1, n + 1) / 120
        times = np.delete(whole, np.arange(start, start + lost))
        assert longest_gap([(times, 120)]) == pytest.approx(1 + lost)
        assert longest_gap([(whole, 120), (times[:start], 120)]) == pytest.approx(max(1, n - start))

    def test_a_series_without_records_beside_another_is_all_gap(self) -> None:
        assert longest_gap([(np.array([0.5, 1.0]), 2), (np.empty(0), 4)]) == pytest.approx(4.0)

    @pytest.mark.parametrize("times", [[0.1, 0.1], [0.2, 0.1], [0.1, math.nan], [0.0], [-1.0]])
    def test_a_clock_that_does_not_rise_is_no_clock(self, times: list[float]) -> None:
        assert longest_gap([(np.array(times), 10)]) == math.inf

    def test_without_records_there_is_no_gap(self) -> None:
        assert math.isnan(longest_gap([(np.empty(0), 120), (np.empty(0), 240)]))

    def test_videos_count_too(self) -> None:
        episode = held_episode()
        spec = dataclasses.replace(episode.spec, video_hz=10)
        last = episode.streams["timestamp"][-1]
        times = np.arange(1, int(10 * last) + 1) / 10
        for kept, gap in ((times, 1.0), (np.delete(times, 4), 2.0)):
            own_rate = {**episode.own_rate, "videos": {"timestamp": kept}}
            filmed = dataclasses.replace(episode, spec=spec, own_rate=own_rate)
            assert inspect_episode(filmed).stream_gap == pytest.approx(gap)


MASS, GRAVITY, HZ = 0.2, 9.81, 120


def held_streams(com: NDArray[np.float64], force: NDArray[np.float64]) -> Streams:
    """Return a hold in which the left pad exerts a force (n, 3) on the target, the right none."""
    n = len(com)
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    body = np.zeros((n, 2, MAX_CONTACTS), np.uint8)
    body[:, :, 0] = Label.TARGET
    tactile = np.full((n, 2, MAX_CONTACTS, 3), np.nan)
    tactile[:, :, 0] = 0.0
    tactile[:, 0, 0] = -force
    return {
        "timestamp": np.arange(1, n + 1) / HZ,
        "phase": np.full(n, Phase.HOLD, np.uint8),
        "object_pose": np.concatenate([com, upright], axis=1)[:, None],
        "tcp_pose": np.concatenate([com, upright], axis=1),
        "gripper_width": np.full(n, 0.04),
        "tactile_body": body,
        "tactile_force": tactile,
        "tactile_position": np.nan_to_num(tactile) * 0.0,
        "hand_force": np.zeros((n, 3)),
    }


def residual(streams: Streams) -> float:
    return force_residual(streams, np.zeros(3), MASS, GRAVITY)


class TestBalance:
    WAY = np.stack([0.0 * np.arange(30), 0.3 * np.sin(np.arange(30)), np.full(30, 0.2)], axis=1)
    UP = np.array([0.0, 0.0, GRAVITY])
    NEEDED = MASS * (acceleration(WAY, np.arange(1, 31) / HZ) + UP)

    def test_the_acceleration_of_a_parabola_is_its_own(self) -> None:
        times = np.arange(9) / HZ
        fall = np.stack([times, 0.0 * times, -0.5 * GRAVITY * times**2], axis=1)
        found = acceleration(fall, times)
        assert found[1:-1] == pytest.approx(np.tile([0.0, 0.0, -GRAVITY], (7, 1)))
        assert not found[[0, -1]].any()

    def test_a_force_that_moves_the_target_as_it_moves_leaves_nothing(self) -> None:
        assert residual(held_streams(self.WAY, self.NEEDED)) == pytest.approx(0.0, abs=1e-9)

    @given(st.floats(0.0, 3.0))
    def test_the_residual_is_what_is_missing_of_the_weight(self, share: float) -> None:
        weight = np.tile([0.0, 0.0, MASS * GRAVITY], (30, 1))
        still = np.tile([0.5, 0.0, 0.2], (30, 1))
        assert residual(held_streams(still, share * weight)) == pytest.approx(
            abs(1.0 - share), abs=1e-6
        )

    def test_what_the_palm_carries_counts(self) -> None:
        streams = held_streams(self.WAY, 0.25 * self.NEEDED)
        streams["hand_force"] = 0.75 * self.NEEDED
        assert residual(streams) == pytest.approx(0.0, abs=1e-9)

    def test_only_records_of_the_hold_with_both_pads_on_the_target_count(self) -> None:
        streams = held_streams(self.WAY, self.NEEDED)
        streams["tactile_force"][:10] = 1e6
        streams["phase"][:5] = Phase.LIFT
        streams["tactile_body"][5:10, 1] = Label.BACKGROUND
        assert residual(streams) == pytest.approx(0.0, abs=1e-9)

    def test_up_on_the_left_and_down_on_the_right_turns_the_target_about_x(self) -> None:
        com, shear = np.array([[0.5, 0.0, 0.2]]), np.array([[0.0, 0.0, 3.0]])
        streams = held_streams(com, shear)
        streams["tactile_force"][:, 1, 0] = shear  # the target pushes the right pad up
        force, moment = pads_on_target(streams, com, np.array([0]))
        assert force == pytest.approx(np.zeros((1, 3)))
        assert moment == pytest.approx(np.array([[2.0 * 3.0 * 0.02, 0.0, 0.0]]))

    @pytest.mark.parametrize("n", [0, 1, 2])
    def test_too_few_records_say_nothing(self, n: int) -> None:
        assert math.isnan(residual(held_streams(self.WAY[:n], self.NEEDED[:n])))


NUMBERS = st.floats(0.0, 40.0) | st.floats(0.0, 1.0) | st.just(math.nan) | st.just(math.inf)
VALUES = st.fixed_dictionaries({name: NUMBERS for name in MEASURED})
LOOSENED = {
    "min_sharpness": 0.2, "min_exposure": 0.05, "max_exposure": 0.95, "max_clipped": 0.6,
    "min_visibility": 0.1, "min_target_pixels": 4, "max_depth_holes": 0.6, "max_stream_gap": 9.0,
    "max_penetration": 0.5, "max_force_residual": 5.0,
}  # fmt: skip


class TestScores:
    @given(VALUES)
    def test_a_score_is_one_to_five_and_says_how_many_groups_are_met(
        self, values: dict[str, float]
    ) -> None:
        score = int(quality_scores(values, USUAL))
        assert WORST <= score <= BEST
        assert score == max(WORST, BEST - len(missed_groups(values)))
        assert (score == BEST) == (shortcomings(values, USUAL) == ())

    def test_every_threshold_can_be_loosened(self) -> None:
        named = {f.name for f in dataclasses.fields(QualityConfig)} - {"min_score"}
        assert named == set(LOOSENED) == {criterion.threshold for criterion in CRITERIA}

    @pytest.mark.parametrize("key", LOOSENED)
    @given(values=VALUES)
    def test_a_looser_threshold_never_lowers_a_score(
        self, key: str, values: dict[str, float]
    ) -> None:
        looser = dataclasses.replace(USUAL, **{key: LOOSENED[key]})
        assert quality_scores(values, looser) >= quality_scores(values, USUAL)

    @pytest.mark.parametrize("key", LOOSENED)
    def test_every_threshold_decides_about_what_lies_between(self, key: str) -> None:
        column = next(c.column for c in CRITERIA if c.threshold == key)
        looser = dataclasses.replace(USUAL, **{key: LOOSENED[key]})
        between = (getattr(USUAL, key) + LOOSENED[key]) / 2
        values = {**dict.fromkeys(MEASURED, math.nan), column: between}
        assert (quality_scores(values, USUAL), quality_scores(values, looser)) == (BEST - 1, BEST)
        assert key in "".join(shortcomings(values, USUAL))

    @given(st.lists(VALUES, min_size=1, max_size=20))
    def test_scores_of_many_are_those_of_each(self, rows: list[dict[str, float]]) -> None:
        columns = {name: np.array([row[name] for row in rows]) for name in MEASURED}
        found = quality_scores(columns, USUAL)
        assert found.dtype == np.uint8
        assert found.tolist() == [int(quality_scores(row, USUAL)) for row in rows]

    def test_a_value_on_its_threshold_meets_it(self) -> None:
        for c in CRITERIA:
            assert c.is_met(getattr(USUAL, c.threshold), USUAL)

    def test_what_a_score_is_made_from_is_in_the_store(self) -> None:
        columns = {row.path.removeprefix("episodes/"): row for row in schema.FIELDS}
        measured = {f.name for f in dataclasses.fields(Inspection)}
        assert set(MEASURED) == measured | {"max_penetration", "table_penetration"}
        assert all(columns[name].dtype == "float64" for name in MEASURED)


WRONG = [
    ({"min_score": 0}, "min_score: got 0, valid: 1 to 5"),
    ({"min_score": 6}, "min_score: got 6, valid: 1 to 5"),
    ({"min_sharpness": 1.5}, "min_sharpness: got 1.5, valid: 0.0 to 1.0"),
    ({"max_clipped": -0.1}, "max_clipped: got -0.1, valid: 0.0 to 1.0"),
    ({"min_exposure": 0.95}, "min_exposure: got 0.95, valid: at most max_exposure (0.9)"),
    ({"max_stream_gap": 1.0}, "max_stream_gap: got 1.0, valid: 1.1 to 1000.0 periods"),
    ({"max_penetration": 2.0}, "max_penetration: got 2.0, valid: 0.0 to 1.0 m"),
]


@pytest.mark.parametrize(("section", "text"), WRONG, ids=[text for _, text in WRONG])
def test_a_threshold_that_cannot_be_is_refused(section: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        FactoryConfig.from_plain({"quality": section})
    assert str(caught.value) == f"quality.{text}"


TINY = {"resolution": (96, 72), "block_size": 4, "seed": 3}
BLUR_OF_NOTHING = QualityConfig(min_sharpness=1.0)
"""No image is as sharp."""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("quality") / "ds.zarr"
    generate(FactoryConfig(**TINY), 6, path, workers=1)
    return path


class TestInTheStore:
    def test_columns_are_those_measured_on_what_is_stored(self, store: Path) -> None:
        dataset = Dataset(store)
        columns = {name: dataset.column(name) for name in MEASURED}
        for i, episode in enumerate(dataset):
            again = dataclasses.asdict(inspect_episode(episode))
            for name, value in again.items():
                assert columns[name][i] == value or (
                    math.isnan(value) and np.isnan(columns[name][i])
                )
        assert np.isfinite(columns["force_residual"]).any()
        stored = dataset.column("quality")
        assert quality_scores(columns, dataset.config.quality).tolist() == stored.tolist()

    def test_other_thresholds_give_the_scores_of_a_run_with_them(self, store: Path) -> None:
        dataset = Dataset(store)
        columns = {name: dataset.column(name) for name in MEASURED}
        other = QualityConfig(min_sharpness=1.0, max_exposure=0.3, min_target_pixels=90)
        scores = quality_scores(columns, other).tolist()
        with World() as world:
            for i in (0, 1):
                spec = dataclasses.replace(dataset.spec(i), quality=other)
                assert run_episode(world, spec).columns["quality"] == scores[i] < BEST

    def test_a_score_can_be_asked_for(self, store: Path) -> None:
        dataset = Dataset(store)
        assert dataset.where(quality=[4, 5]).indices.tolist() == list(range(6))
        assert dataset.where(quality=1).indices.tolist() == []

    def test_the_summary_counts_the_scores_and_the_report_says_them(
        self, store: Path, tmp_path: Path
    ) -> None:
        summary = summarise(Dataset(store))
        assert summary.quality == {"5": 6}
        assert "quality scores, 5 is the best: 6 with 5" in store_text(summary, ("policy",))
        config = FactoryConfig(**TINY, quality=BLUR_OF_NOTHING)
        generate(config, 3, tmp_path / "poor.zarr", workers=1)
        poor = summarise(Dataset(tmp_path / "poor.zarr"))
        assert poor.quality == {"4": 3}

    def test_a_store_from_before_there_were_scores_is_summarised_without(
        self, store: Path, tmp_path: Path
    ) -> None:
        old = tmp_path / "old.zarr"
        shutil.copytree(store, old)
        shutil.rmtree(old / "episodes/quality")
        summary = summarise(Dataset(old))
        assert summary.quality == {}
        assert "quality" not in store_text(summary, ("policy",))


class TestTheGate:
    ASKING = dataclasses.replace(BLUR_OF_NOTHING, min_score=BEST)

    def test_lets_in_what_scores_enough(self) -> None:
        asking = dataclasses.replace(BLUR_OF_NOTHING, min_score=BEST - 1)
        with World() as world:
            episode = run_episode(world, cube_spec(quality=asking))
        assert episode.columns["quality"] == BEST - 1

    def test_refuses_what_scores_less_with_values_and_thresholds(self) -> None:
        with World() as world, pytest.raises(RecipeError) as caught:
            run_episode(world, cube_spec(quality=self.ASKING))
        head, reason = str(caught.value).split(": sharpness ")
        assert head == "quality 4 is below min_score 5"
        value, valid = reason.split(", ", 1)
        assert 0.8 < float(value) < 1.0
        assert valid == "valid: at least 1 (min_sharpness)"

    def test_quarantines_and_the_replay_is_refused_alike(self, tmp_path: Path) -> None:
        path = tmp_path / "ds.zarr"
        generate(FactoryConfig(**TINY, quality=self.ASKING), 2, path, workers=1)
        dataset = Dataset(path)
        assert dataset.status.tolist() == [2, 2]
        reason = str(dataset.column("error")[0])
        assert reason.startswith("quality 4 is below min_score 5: sharpness 0.")
        result = replay(path, 0)
        assert (result.same, result.replayed) == (True, reason)
