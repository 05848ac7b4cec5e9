"""The formats ``jacquard`` and ``cornell``, read as GG-CNN reads them."""

from __future__ import annotations

import csv
import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from support.places import TINY
from support.rectangle_readers import ReadGrasp, read_cornell, read_jacquard
from support.seen_from_above import CONFIG, PLACE, WIDTH, seen_episode, store_of

from grasp_factory.core.camera import project
from grasp_factory.core.enums import Label, Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, apply, inverse
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UnknownNameError, UsageError
from grasp_factory.robots import ROBOTS

PAD = ROBOTS[CONFIG.robot].gripper.pad_size[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """How a layout is read."""

    size: tuple[int, int]
    grasps: str
    """Pattern of the files with good grasps, as in GG-CNN."""
    end: str
    depth: str
    rgb: str
    mask: str
    failed: str
    read: Callable[[Path], list[ReadGrasp]]

    def files(self, out: Path) -> list[Path]:
        """Return the files with good grasps in the order of the episodes."""
        return sorted(out.glob(self.grasps), key=lambda path: int(re.findall(r"\d+", path.name)[0]))

    def image(self, path: Path, end: str) -> NDArray[Any]:
        """Return an image of the episode with this file of grasps."""
        return np.asarray(Image.open(str(path).replace(self.end, end)))


READERS = {
    "jacquard": Reader(
        size=(1024, 1024),
        grasps="*/*_grasps.txt",
        end="grasps.txt",
        depth="perfect_depth.tiff",
        rgb="RGB.png",
        mask="mask.png",
        failed="failures.txt",
        read=read_jacquard,
    ),
    "cornell": Reader(
        size=(640, 480),
        grasps="*/pcd*cpos.txt",
        end="cpos.txt",
        depth="d.tiff",
        rgb="r.png",
        mask="m.png",
        failed="cneg.txt",
        read=read_cornell,
    ),
}
both = pytest.mark.parametrize("name", READERS)


def table_of(out: Path) -> list[dict[str, str]]:
    with (out / "grasps.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def middle(image: NDArray[Any], size: tuple[int, int], zoom: float = 1.0) -> NDArray[Any]:
    """Return the part of an image that is in the middle and has the sides' ratio of ``size``."""
    height, width = image.shape[:2]
    share = min(width / size[0], height / size[1]) / zoom
    rows, columns = round(size[1] * share), round(size[0] * share)
    top, left = (height - rows) // 2, (width - columns) // 2
    return image[top : top + rows, left : left + columns]


def at_centres(image: NDArray[Any], rows: int, columns: int) -> NDArray[Any]:
    """Return an enlarged image's values at the centres of the pixels that it was made from."""
    v, u = (
        np.round((np.arange(small) + 0.5) * large / small - 0.5).astype(int)
        for small, large in ((rows, image.shape[0]), (columns, image.shape[1]))
    )
    return image[v[:, None], u]


@both
@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2, -0.9, math.pi / 2])
def test_a_known_grasp_is_read_where_it_is_in_the_world(
    tmp_path: Path, name: str, yaw: float
) -> None:
    reader, zoom = READERS[name], 1.6
    dataset = store_of(tmp_path / "store.zarr", [seen_episode(yaw)])
    dataset.export(name, tmp_path / "out", zoom=zoom)
    (path,) = reader.files(tmp_path / "out")
    (found,) = reader.read(path)
    # The camera looks straight down; the world's x is up in the image, and y is to the left.
    frames = dataset[0].cameras["overhead"]
    T, K = frames.T_world_camera[0], frames.intrinsics
    height = T[2, 3] - PLACE[2]
    right, down = T[1, 3] - PLACE[1], T[0, 3] - PLACE[0]
    row, column = (K[i, 2] + K[i, i] * way / height for i, way in ((1, down), (0, right)))
    scale = zoom * reader.size[1] / CONFIG.resolution[1]
    wanted = resampled((row, column), CONFIG.resolution[::-1], reader.size, scale)
    assert found.centre.tolist() == pytest.approx(wanted, abs=1e-3)
    assert found.length == pytest.approx(WIDTH * K[0, 0] * scale / height, rel=1e-3)
    assert found.width == pytest.approx(PAD * K[0, 0] * scale / height, rel=1e-3)
    # It closes along the world's y turned by yaw: along a row at yaw 0, turning against the clock.
    assert math.remainder(found.angle - yaw, math.pi) == pytest.approx(0.0, abs=1e-3)


@both
def test_the_brick_lies_under_the_centre_of_its_grasp_and_between_the_pads(
    tmp_path: Path, name: str
) -> None:
    reader = READERS[name]
    dataset = store_of(tmp_path / "store.zarr", [seen_episode(0.5)])
    dataset.export(name, tmp_path / "out")
    (path,) = reader.files(tmp_path / "out")
    (found,) = reader.read(path)
    mask, depth = reader.image(path, reader.mask), reader.image(path, reader.depth)
    along = np.array([-math.sin(found.angle), math.cos(found.angle)]) * found.length / 2
    values = [mask[tuple(np.round(found.centre + k * along).astype(int))] for k in (-1, 0, 1)]
    assert values == [0, 255, 0]
    rows, columns = np.nonzero(mask)
    assert np.hypot(rows.mean() - found.centre[0], columns.mean() - found.centre[1]) < 6
    assert depth[mask == 255].max() < depth[mask == 0].min()


@both
def test_images_of_a_simulated_store_are_those_of_the_store(tmp_path: Path, name: str) -> None:
    reader, dataset = READERS[name], Dataset(TINY)
    dataset.export(name, tmp_path / "out", camera="front", max_tilt_deg=180)
    table = table_of(tmp_path / "out")
    assert [int(row["episode"]) for row in table] == list(range(len(dataset)))
    for row, episode in zip(table, dataset, strict=True):
        frames = episode.cameras["front"]
        good = tmp_path / "out" / f"{row['files']}{'_' * (name == 'jacquard')}{reader.end}"
        for end, values in (
            (reader.rgb, frames.rgb[0]),
            (reader.depth, frames.depth[0]),
            (reader.mask, np.where(frames.segmentation[0] >= Label.TARGET, 255, 0)),
        ):
            image = reader.image(good, end)
            assert image.shape[:2] == reader.size[::-1]
            wanted = middle(values, reader.size)
            np.testing.assert_array_equal(at_centres(image, *wanted.shape[:2]), wanted)
        assert row["outcome"] == episode.outcome.name.lower()
        listed = {"good": reader.end, "failed": reader.failed}[row["listed"]]
        assert (row["listed"] == "good") is episode.success
        (found,) = reader.read(Path(str(good).replace(reader.end, listed)))
        assert found.centre.tolist() == pytest.approx([float(row["y"]), float(row["x"])], abs=1e-3)
        assert pixel_of(episode, reader.size) == pytest.approx(found.centre.tolist(), abs=1e-3)


def pixel_of(episode: Episode, size: tuple[int, int]) -> list[float]:
    """Return row and column of the TCP in the resampled image of the camera ``front``."""
    frames = episode.cameras["front"]
    at_camera = apply(inverse(frames.T_world_camera[0]), episode.columns["grasp_position"])
    column, row = project(at_camera, frames.intrinsics).tolist()
    height, width = frames.depth[0].shape
    scale = max(size[0] / width, size[1] / height)
    return resampled((row, column), (height, width), size, scale)


def resampled(
    pixel: Sequence[float], shape: tuple[int, ...], size: tuple[int, int], scale: float
) -> list[float]:
    """Return where a pixel (row, column) of an image is after scaling it about its middle."""
    ends = zip(pixel, shape, size[::-1], strict=True)
    return [(at - (old - 1) / 2) * scale + (new - 1) / 2 for at, old, new in ends]


LISTINGS: dict[str, tuple[Episode, str, dict[str, Any]]] = {
    "good": (seen_episode(), "good", {}),
    "failed": (dataclasses.replace(seen_episode(), outcome=Outcome.LOST_IN_LIFT), "failed", {}),
    "beside the image": (seen_episode(), "outside", {"zoom": 10.0}),
    "above the camera": (
        seen_episode(grasp_position=np.array([0.6, 0.0, 2.0])),
        "outside",
        {},
    ),
    "from the side": (
        seen_episode(grasp_quat_xyzw=np.array([0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)])),
        "tilted",
        {},
    ),
    "from the side, allowed": (
        seen_episode(grasp_quat_xyzw=np.array([0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)])),
        "good",
        {"max_tilt_deg": 91.0},
    ),
}


@pytest.mark.parametrize("what", LISTINGS)
def test_a_grasp_is_in_the_list_that_the_table_names(tmp_path: Path, what: str) -> None:
    episode, listed, settings = LISTINGS[what]
    reader, out = READERS["cornell"], tmp_path / "out"
    store_of(tmp_path / "store.zarr", [episode]).export("cornell", out, **settings)
    (row,) = table_of(out)
    assert row["listed"] == listed
    lists = {path.name for path in out.glob("00/*.txt")}
    names = {"good": {f"pcd0000{reader.end}"}, "failed": {f"pcd0000{reader.failed}"}}
    assert lists == names.get(listed, set())
    assert (row["x"] == "") is (listed == "outside")
    assert len(list(out.glob("00/*"))) == 3 + len(lists)


NASTY = ("../../up", "grasps.txt", "a b/c", ".hidden", "\U0001f600", "x" * 300, "NUL", "*[")


def test_an_objects_name_never_becomes_a_path(tmp_path: Path) -> None:
    episodes = [
        seen_episode(index=k, object_id=name, object_ids=np.array([name]))
        for k, name in enumerate(NASTY)
    ]
    out = tmp_path / "folder" / "out"
    out.parent.mkdir()
    store_of(tmp_path / "store.zarr", episodes).export("jacquard", out)
    assert [path.name for path in out.parent.iterdir()] == ["out"]
    files = READERS["jacquard"].files(out)
    assert [int(path.name.split("_")[0]) for path in files] == list(range(len(NASTY)))
    folders = {path.parent.name for path in files}
    assert len(folders) == len(NASTY)
    assert all(re.fullmatch("[0-9a-f]{32}", folder) for folder in folders)


def test_images_of_one_object_share_a_folder(tmp_path: Path) -> None:
    episodes = [seen_episode(index=k, object_set="s", object_id="a") for k in range(2)]
    episodes.append(seen_episode(index=2, object_set="other", object_id="a"))
    store_of(tmp_path / "store.zarr", episodes).export("jacquard", tmp_path / "out")
    folders = [path.parent for path in READERS["jacquard"].files(tmp_path / "out")]
    assert folders[0] == folders[1] != folders[2]


def test_missing_depth_is_filled_and_the_other_depth_stays(tmp_path: Path) -> None:
    episode = seen_episode()
    holes: Array = np.zeros(CONFIG.resolution[::-1], bool)
    holes[100:104, 150:160] = True
    depth = episode.cameras["overhead"].depth.copy()
    for rows, value in (
        (slice(100, 102), np.nan),
        (slice(102, 103), 0.0),
        (slice(103, 104), np.inf),
    ):
        depth[:, rows, 150:160] = value
    frames = dataclasses.replace(episode.cameras["overhead"], depth=depth)
    episode = dataclasses.replace(episode, cameras={**episode.cameras, "overhead": frames})
    store_of(tmp_path / "store.zarr", [episode]).export("cornell", tmp_path / "out")
    reader = READERS["cornell"]
    (path,) = reader.files(tmp_path / "out")
    found = reader.image(path, reader.depth)[::2, ::2]
    np.testing.assert_array_equal(found[~holes], depth[0][~holes])
    around = depth[0][99:105, 149:161]
    assert np.isfinite(found).all()
    assert np.nanmin(around[around > 0]) <= found[holes].min()
    assert found[holes].max() <= np.nanmax(np.where(np.isinf(around), 0, around))


def test_depth_is_compressed_so_that_readers_without_other_codecs_can_read_it(
    tmp_path: Path,
) -> None:
    store_of(tmp_path / "store.zarr", [seen_episode()]).export("cornell", tmp_path / "out")
    with Image.open(tmp_path / "out" / "00" / "pcd0000d.tiff") as image:
        tags = dict(image.tag_v2)  # type: ignore[attr-defined]
    deflate, floats, none = 8, 3, 1
    assert (tags[259], tags[339], tags.get(317, none)) == (deflate, (floats,), none)


@both
def test_a_store_without_the_overhead_camera_is_refused_with_what_to_do(
    tmp_path: Path, name: str
) -> None:
    dataset = Dataset(TINY)
    with pytest.raises(UsageError) as caught:
        dataset.export(name, tmp_path / "out")
    assert str(caught.value) == (
        f"{dataset.path} has no camera overhead, and the format needs a view from above: generate a"
        " dataset with --camera overhead, or choose one of front with --option camera=NAME"
    )
    with pytest.raises(UnknownNameError, match="unknown camera 'frnt'; did you mean 'front'"):
        dataset.export(name, tmp_path / "out", camera="frnt")


@pytest.mark.parametrize("wrong", [{"zoom": 0.5}, {"max_tilt_deg": 181}, {"zoom": math.nan}])
def test_settings_out_of_range_are_refused(tmp_path: Path, wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        Dataset(TINY).export("jacquard", tmp_path / "out", **wrong)


def test_an_episode_without_a_grasp_is_left_out_and_counted(tmp_path: Path) -> None:
    episodes = [seen_episode(), seen_episode(index=1, grasp_position=np.full(3, np.nan))]
    found = store_of(tmp_path / "store.zarr", episodes).export("jacquard", tmp_path / "out")
    assert (found.episodes, found.excluded) == (1, {"no grasp was planned": 1})
