"""The contact sheet: every episode in its place, colours that mean what the legend says."""

from __future__ import annotations

import dataclasses
import errno
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.fake_episodes import JOINTS, make_episode, make_rows, small_config
from support.helpers import tree

from grasp_factory.apps.pictures import painting, sheet, tiles
from grasp_factory.apps.pictures.sheet import (
    choose_episodes,
    chosen,
    draw_sheet,
    sheet_of,
    write_png,
)
from grasp_factory.cli.main import cli
from grasp_factory.core.enums import Label, Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import apply, inverse
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, UnknownNameError, UsageError
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

CONFIG = small_config()
PANEL_HEIGHT = 240  # of 32x24 images, 320 wide


def episode(outcome: Outcome = Outcome.SUCCESS, index: int = 0) -> Episode:
    """A flat grey scene: the table half a metre away, a target nearer, nothing above."""
    made = make_episode(CONFIG, index)
    depth = np.full((2, 24, 32), 0.5, np.float32)
    depth[:, :4] = CONFIG.cameras["front"].far
    depth[:, 12:18, 10:20] = 0.4
    segmentation = np.full((2, 24, 32), Label.TABLE, np.uint8)
    segmentation[:, :4] = Label.BACKGROUND
    segmentation[:, 12:18, 10:20] = Label.TARGET
    rgb = np.full((2, 24, 32, 3), (200, 100, 50), np.uint8)
    rgb[1] = (10, 20, 30)
    front = dataclasses.replace(
        made.cameras["front"], rgb=rgb, depth=depth, segmentation=segmentation
    )
    columns = dict(made.columns) | {
        "grasp_position": np.full(3, np.nan),
        "lift_height": 0.2,
        "collision_body": np.uint8(0),
    }
    return dataclasses.replace(made, outcome=outcome, cameras={"front": front}, columns=columns)


def panel(image: np.ndarray, row: int, column: int) -> np.ndarray:
    top = sheet.HEADER + row * (sheet.CAPTION + PANEL_HEIGHT + sheet.GAP) + sheet.CAPTION
    left = sheet.MARGIN + column * (sheet.PANEL_WIDTH + sheet.GAP)
    return image[top : top + PANEL_HEIGHT, left : left + sheet.PANEL_WIDTH]


def test_each_episode_gets_a_row_of_four_panels() -> None:
    one, three = (draw_sheet([episode()] * n, "front") for n in (1, 3))
    assert three.shape[0] - one.shape[0] == 2 * (sheet.CAPTION + PANEL_HEIGHT + sheet.GAP)
    assert one.shape[1] == 2 * sheet.MARGIN + 4 * sheet.PANEL_WIDTH + 3 * sheet.GAP


def test_before_stands_left_of_after_and_red_stays_red() -> None:
    image = draw_sheet([episode()], "front")
    assert (panel(image, 0, 0) == (50, 100, 200)).all()  # BGR
    assert (panel(image, 0, 1) == (30, 20, 10)).all()


def test_the_segmentation_has_the_legends_colours_unmixed() -> None:
    picture = panel(draw_sheet([episode()], "front"), 0, 3)
    colors = {tuple(int(c) for c in color) for color in picture.reshape(-1, 3)}
    words = ("background", "table", "target")
    assert colors == {painting.LABEL_COLORS[word] for word in words}
    assert tuple(picture[150, 150]) == painting.LABEL_COLORS["target"]


def test_every_label_has_a_colour_of_its_own() -> None:
    palette = painting.label_palette()
    used = [tuple(color) for color in palette[: len(Label) + len(painting.OTHER_COLORS)]]
    assert len(set(used)) == len(used)
    assert len(palette) == 256


def test_depth_runs_from_dark_near_to_bright_far_and_nothing_is_grey() -> None:
    depth = np.array([[0.4, 0.5, 4.0]], np.float32)
    near, far, nothing = painting.depth_picture(depth, 0.4, 0.5, 4.0)[0].astype(int)
    assert near.sum() + 200 < far.sum()
    assert tuple(nothing) == painting.NOTHING


@pytest.mark.parametrize(
    ("outcome", "other"),
    [(Outcome.SUCCESS, Outcome.COLLISION), (Outcome.COLLISION, Outcome.SUCCESS)],
)
def test_the_badge_has_the_colour_of_the_outcome(outcome: Outcome, other: Outcome) -> None:
    strip = draw_sheet([episode(outcome)], "front")[sheet.HEADER : sheet.HEADER + sheet.CAPTION]
    assert (strip == painting.outcome_color(outcome)).all(axis=2).sum() > 500
    assert not (strip == painting.outcome_color(other)).all(axis=2).any()


def test_the_caption_says_what_was_grasped_by_what_and_how_far_it_came() -> None:
    made = episode()
    text = sheet.caption(made)
    for word in ("#0", made.spec.objects[0].object_id, made.spec.policy, "lifted 200.0 mm"):
        assert word in text


def test_the_caption_of_a_collision_names_what_was_hit() -> None:
    made = episode(Outcome.COLLISION)
    columns = dict(made.columns) | {"collision_body": np.uint8(2), "lift_height": float("nan")}
    text = sheet.caption(dataclasses.replace(made, columns=columns))
    assert "hit the table" in text
    assert "lifted" not in text


def test_a_neighbor_that_was_hit_is_named() -> None:
    made = episode(Outcome.COLLISION)
    spec = dataclasses.replace(made.spec, objects=made.spec.objects * 3)
    columns = dict(made.columns) | {"collision_body": np.uint8(7)}
    text = sheet.caption(dataclasses.replace(made, spec=spec, columns=columns))
    assert "hit the object_2" in text


def test_a_planned_grasp_is_drawn_where_it_projects() -> None:
    made = episode()
    K = np.array([[30.0, 0, 16], [0, 30.0, 12], [0, 0, 1]])
    front = dataclasses.replace(
        made.cameras["front"], intrinsics=K, T_world_camera=np.stack([np.eye(4)] * 2)
    )
    columns = dict(made.columns) | {
        "grasp_position": np.array([0.0, 0.0, 1.0]),
        "grasp_quat_xyzw": np.array([0.0, 0.0, 0.0, 1.0]),
        "grasp_width": 0.2,
    }
    made = dataclasses.replace(made, cameras={"front": front}, columns=columns)
    pixels = painting.grasp_pixels(made, front)
    assert pixels is not None
    np.testing.assert_allclose(pixels[:3], [[16, 15], [16, 9], [16, 12]], atol=1e-9)
    picture = panel(draw_sheet([made], "front"), 0, 0)
    assert tuple(picture[125, 165]) == painting.GRASP_COLOR
    assert not (panel(draw_sheet([made], "front"), 0, 1) == painting.GRASP_COLOR).all(axis=2).any()


def test_a_grasp_behind_the_camera_or_none_is_not_drawn() -> None:
    made = episode()
    front = made.cameras["front"]
    assert painting.grasp_pixels(made, front) is None
    behind = apply(np.eye(4), np.array([0.0, 0.0, -1.0]))
    T = dataclasses.replace(front, T_world_camera=inverse(np.stack([np.eye(4)] * 2)))
    columns = dict(made.columns) | {
        "grasp_position": behind,
        "grasp_quat_xyzw": np.array([0.0, 0.0, 0.0, 1.0]),
        "grasp_width": 0.1,
    }
    assert painting.grasp_pixels(dataclasses.replace(made, columns=columns), T) is None


def test_a_random_episode_of_any_outcome_can_be_drawn() -> None:
    for index in range(12):
        draw_sheet([make_episode(CONFIG, index)], "front")


@pytest.mark.parametrize(
    ("success", "most", "chosen"),
    [
        ([True] * 3, 12, [0, 1, 2]),
        ([True, False] * 10, 4, [0, 1, 18, 19]),
        ([False] * 19 + [True], 4, [0, 9, 18, 19]),
        ([True] + [False] * 3, 1, [0]),
        ([], 12, []),
    ],
    ids=["all", "half and half", "one success among many", "one", "none"],
)
def test_a_choice_shows_both_classes(success: list[bool], most: int, chosen: list[int]) -> None:
    assert choose_episodes(np.array(success, bool), most).tolist() == chosen


@pytest.mark.parametrize("good", range(0, 31, 5))
def test_a_choice_is_as_large_as_it_may_be_and_has_no_one_twice(good: int) -> None:
    success = np.arange(30) < good
    chosen = choose_episodes(success)
    assert len(set(chosen.tolist())) == 12
    assert good in (0, 30) or 0 < success[chosen].sum() < 12


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    path = tmp_path / "ds.zarr"
    prepare_store(path, CONFIG, JOINTS, 5, {})
    ZarrWriter(path).write_block(0, make_rows(CONFIG, 0, 5, quarantined=(2,)))
    return Dataset(path)


def test_a_store_is_drawn_without_what_is_missing_or_quarantined(dataset: Dataset) -> None:
    expected = draw_sheet([dataset[i] for i in (0, 1, 3)], "front")
    assert np.array_equal(sheet_of(dataset, None, "front"), expected)


def test_asking_for_what_cannot_be_drawn_says_why(dataset: Dataset) -> None:
    with pytest.raises(UsageError, match=r"episode 5: .* has episodes 0 to 4"):
        sheet_of(dataset, [5], "front")
    with pytest.raises(StoreError, match="episode 2 is quarantined: no luck with 2"):
        sheet_of(dataset, [2], "front")
    with pytest.raises(StoreError, match="episode 4 is missing"):
        sheet_of(dataset, [4], "front")
    with pytest.raises(UnknownNameError, match="unknown camera 'frnt'; did you mean 'front'"):
        sheet_of(dataset, [0], "frnt")
    with pytest.raises(UsageError, match="no episode to draw"):
        draw_sheet([], "front")


def test_the_file_holds_the_picture(tmp_path: Path) -> None:
    image = draw_sheet([episode()], "front")
    write_png(tmp_path / "s.png", image)
    assert np.array_equal(cv2.imread(str(tmp_path / "s.png")), image)


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    image = np.zeros((2, 2, 3), np.uint8)
    with pytest.raises(UsageError, match=r"valid: a name that ends in \.png"):
        write_png(tmp_path / "s.jpg", image)
    with pytest.raises(UsageError, match=r"the folder .* does not exist"):
        write_png(tmp_path / "no" / "s.png", image)
    (tmp_path / "d.png").mkdir()
    with pytest.raises(UsageError, match=r"d\.png exists and is not a PNG image"):
        write_png(tmp_path / "d.png", image)


def test_a_disk_without_room_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(path: Path, data: bytes) -> int:
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fill)
    with pytest.raises(StoreError, match=r"s\.png cannot be written: No space left on device"):
        write_png(tmp_path / "s.png", np.zeros((2, 2, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_picture_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "s.png"
    path.write_text("mine")
    with pytest.raises(UsageError, match="exists and is not a PNG image"):
        write_png(path, np.zeros((2, 2, 3), np.uint8))
    assert path.read_text() == "mine"


@pytest.mark.parametrize("place", ["s.zarr", "s.zarr/episodes", "link", "deep/../s.zarr"])
def test_no_picture_is_put_into_a_store(tmp_path: Path, place: str) -> None:
    (tmp_path / "s.zarr" / "episodes").mkdir(parents=True)
    (tmp_path / "deep").mkdir()
    (tmp_path / "s.zarr" / "zarr.json").write_text("{}")
    (tmp_path / "link").symlink_to(tmp_path / "s.zarr" / "episodes")
    before = tree(tmp_path)
    with pytest.raises(UsageError, match=r"p\.png is inside a store: choose another folder"):
        write_png(tmp_path / place / "p.png", np.zeros((2, 2, 3), np.uint8))
    assert tree(tmp_path) == before


def test_a_picture_that_is_there_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "s.png"
    for grey in (0, 200):
        write_png(path, np.full((2, 2, 3), grey, np.uint8))
    assert (cv2.imread(str(path)) == 200).all()
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Thirty rows, of which 2 and 9 are quarantined and 29 is missing."""
    path = tmp_path_factory.mktemp("many") / "many.zarr"
    prepare_store(path, CONFIG, JOINTS, 30, {})
    for block in range(8):
        rows = make_rows(CONFIG, block, 29, quarantined=(2, 9))
        ZarrWriter(path).write_block(block, rows)
    return Dataset(path)


def test_a_sheet_shows_as_many_as_are_asked_for_of_both_classes(many: Dataset) -> None:
    success = many.column("success")
    assert 0 < success.sum() < 27
    rows = chosen(many, None, 6, default=12, most=60)
    assert len(rows) == 6
    assert 0 < success[rows].sum() < 6
    assert chosen(many, None, None, default=12, most=60) == chosen(
        many, None, 12, default=1, most=60
    )


def test_a_selection_is_shown_in_its_order_and_whole(many: Dataset) -> None:
    wanted = [7, 3, 3, 12]
    assert chosen(many, wanted, None, default=2, most=4) == wanted
    some = chosen(many, wanted, 2, default=12, most=4)
    assert len(some) == 2
    assert set(some) <= set(wanted)


@pytest.mark.parametrize("n", [0, -1, 61])
def test_a_number_that_makes_no_sheet_is_refused(many: Dataset, n: int) -> None:
    with pytest.raises(UsageError, match=f"{n} episodes on a sheet: valid: 1 to 60"):
        chosen(many, None, n, default=12, most=60)


def test_a_selection_larger_than_a_sheet_is_refused_with_what_to_do(many: Dataset) -> None:
    with pytest.raises(UsageError, match=r"5 episodes are more than the 4 of a sheet: --n 4"):
        chosen(many, [0, 1, 3, 4, 5], None, default=2, most=4)


class TestTiles:
    HEIGHT = round(tiles.PANEL * 24 / 32)

    def tile(self, image: np.ndarray, place: int, across: int) -> np.ndarray:
        row, column = divmod(place, across)
        top = tiles.HEADER + tiles.GAP + row * (self.HEIGHT + tiles.CAPTION + tiles.GAP)
        left = tiles.GAP + column * (tiles.WIDTH + tiles.GAP)
        return image[top : top + self.HEIGHT + tiles.CAPTION, left : left + tiles.WIDTH]

    def test_each_episode_has_its_tile_before_left_of_after(self, many: Dataset) -> None:
        image = tiles.tiles_of(many, [4, 0, 11], "front", across=2)
        for place, row in enumerate([4, 0, 11]):
            tile = self.tile(image, place, 2)
            halves = tile[: self.HEIGHT, : tiles.PANEL], tile[: self.HEIGHT, -tiles.PANEL :]
            for half, rgb in zip(halves, many[row].cameras["front"].rgb, strict=True):
                size = (tiles.PANEL, self.HEIGHT)
                want = cv2.resize(
                    np.ascontiguousarray(rgb[..., ::-1]), size, interpolation=cv2.INTER_CUBIC
                )
                assert np.array_equal(half, want)
        empty = self.tile(image, 3, 2)
        assert (empty == painting.PAPER).all()

    def test_the_strip_has_the_colour_of_the_outcome(self, many: Dataset) -> None:
        success = many.column("success")
        rows = [int(np.flatnonzero(success)[0]), int(many.where(success=False).indices[0])]
        image = tiles.tiles_of(many, rows, "front", across=2)
        for place, row in enumerate(rows):
            strip = self.tile(image, place, 2)[self.HEIGHT]
            outcome = Outcome(int(many.value(row, "outcome")))
            assert (strip == painting.outcome_color(outcome)).all()

    def test_a_quarantined_episode_has_a_tile_without_images(self, many: Dataset) -> None:
        image = tiles.tiles_of(many, [1, 2], "front", across=2)
        assert (self.tile(image, 1, 2)[: self.HEIGHT] == painting.NOTHING).all()
        assert not (self.tile(image, 0, 2)[: self.HEIGHT] == painting.NOTHING).all()

    def test_without_a_choice_there_are_those_that_are_committed(self, many: Dataset) -> None:
        every = tiles.tiles_of(many, None, "front", across=9)
        assert np.array_equal(
            every, tiles.tiles_of(many, many.committed.tolist(), "front", across=9)
        )
        assert (
            every.shape[0]
            == tiles.HEADER + 3 * (self.HEIGHT + tiles.CAPTION + tiles.GAP) + tiles.GAP
        )

    @pytest.mark.parametrize("n", [1, 7, 27])
    def test_a_sheet_is_about_as_wide_as_high(self, many: Dataset, n: int) -> None:
        height, width = tiles.tiles_of(many, many.committed[:n].tolist(), "front").shape[:2]
        assert 0.6 < width / height < 2.6

    def test_more_than_are_read_at_once_keep_their_places(
        self, many: Dataset, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        rows = [5, 2, 28, 0, 9, 17, 3]
        whole = tiles.tiles_of(many, rows, "front")
        monkeypatch.setattr(tiles, "TOGETHER", 2)
        assert np.array_equal(tiles.tiles_of(many, rows, "front"), whole)

    def test_asking_for_what_cannot_be_drawn_says_why(self, many: Dataset) -> None:
        with pytest.raises(StoreError, match="episode 29 is missing"):
            tiles.tiles_of(many, [29], "front")
        with pytest.raises(UsageError, match=r"episode 30: .* has episodes 0 to 29"):
            tiles.tiles_of(many, [30], "front")
        with pytest.raises(UnknownNameError, match="unknown camera 'frnt'"):
            tiles.tiles_of(many, [0], "frnt")
        with pytest.raises(UsageError, match="no episode to draw"):
            tiles.tiles_of(many, [], "front")
        with pytest.raises(UsageError, match="0 tiles side by side: valid: 1 to"):
            tiles.tiles_of(many, [0], "front", across=0)

    def test_a_word_that_is_no_ascii_is_drawn_with_question_marks(self) -> None:
        strips = [
            tiles._strip(painting.PALE, "success", "#1", text) for text in ("a?b", "aüb", "ab")
        ]
        assert np.array_equal(strips[0], strips[1])
        assert not np.array_equal(strips[0], strips[2])

    @pytest.mark.parametrize("text", ["a\ud800b", "\x1b[2J", "a\x00b", "x" * 10**6, "\u202e"])
    def test_whatever_a_store_says_can_be_drawn(self, text: str) -> None:
        strip = np.zeros((40, 100, 3), np.uint8)
        shown = painting.drawable(text)
        assert shown.isascii()
        assert shown.isprintable()
        assert painting.put_text(strip, text, (0, 20)) == painting.put_text(strip, shown, (0, 20))
        assert painting.put_badge(strip, text, (0, 20), painting.PALE) > 0


def run(*args: object) -> Result:
    return CliRunner().invoke(cli, [str(arg) for arg in args], standalone_mode=False)


class TestCommand:
    def test_tiles_are_written(self, many: Dataset, tmp_path: Path) -> None:
        out = tmp_path / "t.png"
        result = run("sheet", many.path, out, "--tiles", "--n", 4, "--columns", 2)
        assert result.output == f"{out}\n"
        rows = chosen(many, None, 4, default=1, most=60)
        want = tiles.tiles_of(many, rows, "front", across=2)
        assert np.array_equal(cv2.imread(str(out)), want)

    def test_a_selection_from_a_file_is_drawn(self, many: Dataset, tmp_path: Path) -> None:
        ids, out = tmp_path / "ids.txt", tmp_path / "s.png"
        ids.write_text("3\n1\n")
        assert run("sheet", many.path, out, "--ids", ids).exception is None
        assert np.array_equal(cv2.imread(str(out)), sheet_of(many, [3, 1], "front"))

    def test_options_that_do_not_go_together_are_refused(
        self, many: Dataset, tmp_path: Path
    ) -> None:
        ids = tmp_path / "ids.txt"
        ids.write_text("3\n")
        both = ["--ids", ids, "--episodes", 1]
        for options, words in ((both, "valid: one of them"), (["--columns", 3], "--tiles")):
            result = run("sheet", many.path, tmp_path / "s.png", *options)
            assert isinstance(result.exception, UsageError)
            assert words in str(result.exception)
        assert not (tmp_path / "s.png").exists()
