"""The picture of an attempt: what is drawn is what is stored, and all of it can be read."""

from __future__ import annotations

import dataclasses
import itertools
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from support.fake_episodes import JOINTS, make_rows, small_config
from support.places import TINY
from support.scale import soak_only

from grasp_factory.apps.pictures.painting import depth_span, outcome_color
from grasp_factory.apps.pictures.plot import plot_episode, style
from grasp_factory.apps.pictures.plot.figure import Subject, facts, figure_of, pixels_of
from grasp_factory.cli.main import cli
from grasp_factory.core.enums import Label, Outcome, Phase, names
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, UnknownNameError, UsageError
from grasp_factory.labels.rule import pad_normal_force
from grasp_factory.signals.plot_series import curve_groups, pad_forces, phase_spans, touch_moments
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

pytestmark = pytest.mark.slow

DATASET = Dataset(TINY)
PAD = (0.02, 0.05)


def row_of(success: bool) -> int:
    return int(DATASET.where(success=success).indices[0])


def subject(episode: Episode, **more: Any) -> Subject:
    defaults = {"store": "tiny.zarr", "row": 3, "camera": "front", "pad_size": PAD, "maker": "1.2"}
    return Subject(episode=episode, **(defaults | more))


def texts(figure: Figure) -> list[Text]:
    """Return what is written in a figure, without the numbers that lie beyond an axis' ends."""
    found: list[Text] = []
    draw = Text.draw

    def note(text: Text, renderer: Any) -> None:
        found.append(text)
        draw(text, renderer)

    with mock.patch.object(Text, "draw", note):
        figure.canvas.draw()
    return [text for text in found if text.get_text().strip() and text.get_visible()]


def words(figure: Figure) -> str:
    return "\n".join(text.get_text() for text in texts(figure))


def panels(figure: Figure) -> Mapping[str, Axes]:
    """Return the axes of curves by their titles."""
    return {ax.get_title(loc="left"): ax for ax in figure.axes if ax.get_title(loc="left")}


@pytest.fixture(scope="module")
def lifted() -> Figure:
    return figure_of(subject(DATASET[row_of(True)]))


class TestCurves:
    def groups(self, episode: Episode, **more: Any) -> dict[str, Any]:
        given = {"streams": episode.streams, "imu": episode.imu} | more
        com, rest = episode.columns["object_com"][0], episode.columns["rest_height"]
        found = curve_groups(given["streams"], given["imu"], com, rest)
        return {group.key: group for group in found}

    def test_every_group_has_a_value_for_each_name_and_time(self) -> None:
        episode = DATASET[0]
        for group in self.groups(episode).values():
            length = episode.n_imu if group.clock == "imu" else episode.n_steps
            assert group.values.shape == (length, len(group.names))
            assert group.units

    def test_what_a_store_does_not_have_is_left_out(self) -> None:
        episode = DATASET[0]
        streams = {k: v for k, v in episode.streams.items() if "wrist" not in k}
        left = self.groups(episode, streams=streams, imu={"timestamp": episode.imu["timestamp"]})
        gone = {"wrist_force", "wrist_torque", "imu_specific_force", "imu_angular_velocity"}
        assert set(self.groups(episode)) - set(left) == gone

    def test_the_targets_height_ends_at_the_lift_that_is_stored(self) -> None:
        episode = DATASET[row_of(True)]
        height = self.groups(episode)["object_height"].values[:, 0]
        at = np.flatnonzero(episode.streams["phase"] != Phase.SHAKE)[-1]
        assert height[at] == pytest.approx(episode.columns["lift_height"], abs=1e-6)

    def test_the_pads_force_in_the_hold_is_that_on_the_target(self) -> None:
        streams = DATASET[row_of(True)].streams
        hold = streams["phase"] == Phase.HOLD
        assert hold.any()
        np.testing.assert_allclose(pad_forces(streams)[hold], pad_normal_force(streams)[hold])

    @given(st.lists(st.tuples(st.sampled_from(list(Phase)), st.integers(1, 5)), max_size=8))
    def test_spans_cover_the_attempt_in_order(self, runs: list[tuple[Phase, int]]) -> None:
        phase = np.array([p for p, length in runs for _ in range(length)], np.uint8)
        times = np.arange(len(phase)) / 120.0
        spans = phase_spans({"phase": phase, "timestamp": times})
        assert [s.name for s in spans] == [
            names(Phase)[value] for value, _ in itertools.groupby(phase.tolist())
        ]
        if spans:
            assert (spans[0].start, spans[-1].end) == (times[0], times[-1])
        assert all(a.end == b.start for a, b in itertools.pairwise(spans))

    @given(
        st.lists(st.tuples(st.sampled_from(list(Phase)), st.floats(0.0, 9.0)), min_size=1),
    )
    def test_moments_are_few_touched_and_have_the_largest_force(
        self, records: list[tuple[Phase, float]]
    ) -> None:
        n = len(records)
        force, normal = np.zeros((n, 2, 1, 3)), np.zeros((n, 2, 1, 3))
        normal[..., 1] = 1.0
        force[:, 0, 0, 1] = [newtons for _, newtons in records]
        phase = np.array([p for p, _ in records])
        streams = {"tactile_force": force, "tactile_normal": normal, "phase": phase}
        moments = touch_moments(streams)
        total = pad_forces(streams).sum(axis=1)
        assert len(moments) <= 3
        assert all(total[moment.record] > 0.0 for moment in moments)
        order = [moment.record for moment in moments]
        assert order == sorted(set(order))
        assert bool(moments) is bool((total > 0.0).any())
        if moments:
            assert max(total[order]) == total.max()


class TestFigure:
    def test_the_lines_are_the_stored_series(self, lifted: Figure) -> None:
        episode, axes = DATASET[row_of(True)], panels(lifted)
        wanted = {
            "gripper width": (1e3, episode.streams["gripper_width"], episode.streams),
            "wrist torque": (1.0, episode.streams["wrist_wrench"][:, 3], episode.streams),
            "joint positions": (1.0, episode.streams["joint_positions"][:, 0], episode.streams),
            "IMU specific force": (1.0, episode.imu["specific_force"][:, 0], episode.imu),
        }
        for title, (factor, values, clock) in wanted.items():
            line = axes[title].lines[0]
            np.testing.assert_allclose(np.asarray(line.get_ydata()), factor * values)
            np.testing.assert_array_equal(np.asarray(line.get_xdata()), clock["timestamp"])

    def test_all_curves_share_the_time_axis_and_say_their_units(self, lifted: Figure) -> None:
        axes = [ax for ax in panels(lifted).values() if ax.get_ylabel()]
        assert len(axes) == 8
        assert len({ax.get_xlim() for ax in axes}) == 1
        assert {ax.get_ylabel() for ax in axes} == {*("rad", "mm", "N", "N·m", "m/s²", "rad/s")}
        assert "time since the arm started, s" in words(lifted)

    def test_the_heading_says_what_came_of_it(self, lifted: Figure) -> None:
        episode, text = DATASET[row_of(True)], words(lifted)
        for part in ("success", "episode 3", episode.spec.objects[0].object_id, episode.spec.policy,
                     f"lifted {1000 * episode.columns['lift_height']:.1f} mm", "tiny.zarr",
                     "camera front", "grasp_factory 1.2"):  # fmt: skip
            assert part in text

    def test_the_phases_are_named(self, lifted: Figure) -> None:
        text = words(lifted)
        assert [word for word in names(Phase) if word not in text] == []

    def test_a_loss_is_marked_at_its_time_in_every_panel(self) -> None:
        row = int(DATASET.where(outcome="lost_in_lift").indices[0])
        episode = DATASET[row]
        figure = figure_of(subject(episode))
        assert "lost" in [text.get_text() for text in texts(figure)]
        for ax in panels(figure).values():
            if ax.get_ylabel():
                at = {np.asarray(line.get_xdata())[0] for line in ax.lines[-4:]}
                assert episode.columns["loss_time"] in at

    @pytest.mark.parametrize(
        ("row", "size"),
        [
            *((row, (1600, 1200)) for row in (2, 3)),
            *((0, (2400, 1000)), (1, (1000, 1400))),
            *(pytest.param(row, (1600, 1200), marks=pytest.mark.soak) for row in (0, 1)),
        ],
    )
    def test_no_word_lies_on_another_or_beyond_the_edge(
        self, row: int, size: tuple[int, int]
    ) -> None:
        figure = figure_of(subject(DATASET[row]), size)
        boxes = [(text.get_text(), text.get_window_extent()) for text in texts(figure)]
        for word, box in boxes:
            assert 0 <= box.x0 <= box.x1 <= size[0], word
            assert 0 <= box.y0 <= box.y1 <= size[1], word
        for (word, a), (other, b) in itertools.combinations(boxes, 2):
            wide = min(a.x1, b.x1) - max(a.x0, b.x0)
            high = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert wide <= 1.0 or high <= 2.0, (word, other)

    @pytest.mark.soak
    def test_names_that_are_long_or_odd_stay_words_within_the_picture(self) -> None:
        episode = DATASET[0]
        target = episode.spec.objects[0]
        for name, shown in (("x" * 500, "xxx..."), ("$x^2$ \\alpha", "$x^2$ \\alpha"),
                            ("杯子/ö\n", "??/ö?")):  # fmt: skip
            odd = dataclasses.replace(target, object_id=name)
            spec = dataclasses.replace(episode.spec, objects=(odd,))
            figure = figure_of(subject(dataclasses.replace(episode, spec=spec)))
            drawn = texts(figure)
            assert shown in "\n".join(text.get_text() for text in drawn)
            assert max(text.get_window_extent().x1 for text in drawn) <= 1600

    def test_without_records_there_are_images_and_the_reason(self) -> None:
        episode = DATASET[0]
        streams = {name: values[:0] for name, values in episode.streams.items()}
        imu = {n: v[:0] if n != "T_tcp_imu" else v for n, v in episode.imu.items()}
        nothing = dataclasses.replace(
            episode, streams=streams, own_rate={"imu": imu}, outcome=Outcome.NO_PLAN
        )
        text = words(figure_of(subject(nothing)))
        assert "ended before the arm moved (no plan)" in text
        assert "depth before" in text
        assert "pad normal force" not in text

    def test_pads_that_nothing_touched_say_so(self) -> None:
        episode = DATASET[0]
        streams = dict(episode.streams)
        streams["tactile_force"] = np.full_like(streams["tactile_force"], np.nan)
        quiet = dataclasses.replace(episode, streams=streams)
        assert "nothing touched the pads" in words(figure_of(subject(quiet)))

    @pytest.mark.soak
    def test_the_settings_of_the_user_neither_matter_nor_change(self) -> None:
        once = pixels_of(figure_of(subject(DATASET[0])))
        with mpl.rc_context({"font.size": 20, "lines.linewidth": 9, "axes.facecolor": "red"}):
            again = pixels_of(figure_of(subject(DATASET[0])))
            assert mpl.rcParams["font.size"] == 20
        assert np.array_equal(once, again)

    def test_many_objects_fit_into_the_legend(self) -> None:
        episode = DATASET[0]
        front = episode.cameras["front"]
        labels = front.segmentation.copy()
        labels[0, 0, :30] = np.arange(30)
        crowd = dataclasses.replace(
            episode,
            spec=dataclasses.replace(episode.spec, objects=episode.spec.objects * 10),
            cameras={"front": dataclasses.replace(front, segmentation=labels)},
        )
        figure = figure_of(subject(crowd))
        assert "4 more" in words(figure)

    def test_measurements_that_an_attempt_has_none_of_are_left_out(self) -> None:
        episode = DATASET[0]
        columns = dict(episode.columns) | {
            **dict.fromkeys(("lift_height", "slip_distance", "loss_time"), float("nan")),
            "collision_body": np.uint8(Label.TABLE), "quality": np.uint8(0),
        }  # fmt: skip
        told = facts(dataclasses.replace(episode, columns=columns))
        assert "hit the table" in told
        assert not [t for t in told if t.startswith(("lifted", "slipped", "lost", "quality"))]


class TestDepthSpan:
    def test_is_that_of_the_table_and_what_lies_on_it(self) -> None:
        front = DATASET[0].cameras["front"]
        depth = np.full_like(front.depth, 3.0)
        labels = np.full_like(front.segmentation, Label.FLOOR)
        depth[:, :40], labels[:, :40] = 0.5, Label.TABLE
        depth[:, :10], labels[:, :10] = 0.4, Label.TARGET
        assert depth_span(depth, labels, 4.0) == pytest.approx((0.4, 0.5))

    def test_is_that_of_all_that_is_seen_where_there_is_no_table(self) -> None:
        depth = np.array([[0.7, 0.9, 4.0, np.nan]], np.float32)
        labels = np.full(depth.shape, Label.FLOOR, np.uint8)
        assert depth_span(depth, labels, 4.0) == pytest.approx((0.702, 0.898))

    def test_each_image_has_its_own_end_of_sight(self) -> None:
        depth = np.array([[[1.0, 2.0]], [[1.0, 3.0]]], np.float32)
        labels = np.full(depth.shape, Label.TABLE, np.uint8)
        far = np.array([2.0, 4.0])[:, None, None]
        assert depth_span(depth, labels, far) == pytest.approx((1.0, 2.96))

    @pytest.mark.parametrize("value", [np.nan, np.inf, 4.0, 0.5])
    def test_is_a_span_also_of_nothing_and_of_one_depth(self, value: float) -> None:
        front = DATASET[0].cameras["front"]
        low, high = depth_span(np.full_like(front.depth, value), front.segmentation, 4.0)
        assert 0.0 <= low < high


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five rows of noise: 2 is quarantined, 4 is missing."""
    config = small_config()
    path = tmp_path_factory.mktemp("plot") / "ds.zarr"
    prepare_store(path, config, JOINTS, 5, {"robot": {"pad_size": list(PAD)}})
    ZarrWriter(path).write_block(0, make_rows(config, 0, 5, quarantined=(2,)))
    return path


class TestPicture:
    @pytest.mark.parametrize("size", [(900, 601), *soak_only((1600, 1200))])
    def test_has_the_size_that_is_asked_for(self, size: tuple[int, int]) -> None:
        image = plot_episode(DATASET, 0, size=size)
        assert image.shape == (size[1], size[0], 3)
        assert np.array_equal(image, plot_episode(DATASET, 0, "front", size))

    @pytest.mark.soak
    def test_red_stays_red(self) -> None:
        for row in (row_of(True), row_of(False)):
            badge = plot_episode(DATASET, row)[16:42, 24:200]
            color = outcome_color(DATASET[row].outcome)  # BGR
            assert (badge == color).all(axis=2).sum() > 500

    @pytest.mark.parametrize("row", [0, *soak_only(1), 3])
    def test_noise_with_holes_can_be_drawn(self, store: Path, row: int) -> None:
        assert plot_episode(Dataset(store), row).std() > 5.0

    def test_asking_for_what_cannot_be_drawn_says_why(self, store: Path) -> None:
        dataset = Dataset(store)
        with pytest.raises(StoreError, match="episode 2 is quarantined: no luck with 2"):
            plot_episode(dataset, 2)
        with pytest.raises(StoreError, match="episode 4 is missing"):
            plot_episode(dataset, 4)
        for index in (5, -1):
            with pytest.raises(UsageError, match=rf"episode {index}: .* has episodes 0 to 4"):
                plot_episode(dataset, index)
        with pytest.raises(UnknownNameError, match="unknown camera 'frnt'; did you mean 'front'"):
            plot_episode(dataset, 0, "frnt")
        for size in ((599, 900), (900, 8001)):
            with pytest.raises(UsageError, match="valid: sides of 600 to 8000 pixels"):
                plot_episode(dataset, 0, size=size)

    def test_without_matplotlib_it_says_what_to_install(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
        with pytest.raises(UsageError, match=r"pip install 'grasp-factory\[plot\]'"):
            plot_episode(DATASET, 0)


def run(*args: object) -> Result:
    return CliRunner().invoke(cli, ["plot", *map(str, args)], standalone_mode=False)


class TestCommand:
    def test_draws_into_the_current_folder(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert run(TINY, 1).output == "episode_1.png\n"
        assert np.array_equal(cv2.imread("episode_1.png"), plot_episode(DATASET, 1))

    def test_draws_where_and_as_large_as_it_is_told(self, tmp_path: Path) -> None:
        out = tmp_path / "mine.png"
        assert run(TINY, 1, out, "--size", "800x600", "--camera", "front").output == f"{out}\n"
        image = cv2.imread(str(out))
        assert image is not None
        assert image.shape == (600, 800, 3)

    def test_a_file_that_is_no_picture_is_refused_and_stays(self, tmp_path: Path) -> None:
        mine = tmp_path / "mine.png"
        mine.write_text("mine")
        for out in (mine, tmp_path / "x.jpg", tmp_path / "no" / "x.png"):
            assert isinstance(run(TINY, 1, out).exception, UsageError)
        assert mine.read_text() == "mine"
        assert sorted(tmp_path.iterdir()) == [mine]

    def test_its_help_loads_neither_matplotlib_nor_numpy(self) -> None:
        code = (
            "import sys; from grasp_factory.cli.main import cli; cli(['plot', '--help'], 'x', "
            "standalone_mode=False); print({'matplotlib', 'numpy', 'zarr'} & set(sys.modules))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert done.stdout.splitlines()[-1] == "set()"


def test_the_colours_of_lines_differ() -> None:
    assert len(set(style.LINES)) == len(style.LINES) >= 7
    assert set(style.PHASES) == set(names(Phase))
    assert len(set(style.PHASES.values())) == len(style.PHASES)
