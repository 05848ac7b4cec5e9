"""Crops around a grasp: metric, aligned, the same from every camera and resolution."""

from __future__ import annotations

import dataclasses
import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.fake_episodes import JOINTS, make_rows, small_config
from support.places import TINY
from support.views import brick, photograph

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Label, Outcome
from grasp_factory.core.episode import CameraImage
from grasp_factory.core.geometry import (
    Array,
    inverse,
    look_at,
    pose_matrices,
    rotation_about,
    transform,
)
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreError, UnknownNameError, UsageError
from grasp_factory.factory.generate import generate
from grasp_factory.signals.grasp_crop import GLANCE, CropShape, GraspCrop, grasp_crop, grasp_relief
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

FRONT, OVERHEAD = CAMERAS["front"].config, CAMERAS["overhead"].config
DOWN = np.diag([1.0, -1.0, -1.0])
"""Of a TCP that looks straight down."""
SHAPE = CropShape()
SIZE = (0.10, 0.04, 0.05)
PLACE, YAW = (0.55, 0.06), 0.4
TCP_HEIGHT = 0.03


def looking_down(x: float, y: float, yaw: float, z: float = TCP_HEIGHT) -> Array:
    return transform(rotation_about((0.0, 0.0, 1.0), yaw) @ DOWN, (x, y, z))


def same(a: GraspCrop, b: GraspCrop) -> bool:
    names = [field.name for field in dataclasses.fields(GraspCrop)]
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in names)


def colored(image: CameraImage) -> CameraImage:
    """Return an image with another colour in each pixel."""
    height, width = image.depth.shape
    number = np.arange(height * width).reshape(height, width)
    rgb = np.stack([number % 256, number // 256 % 256, number // 65536], axis=-1)
    return dataclasses.replace(image, rgb=rgb.astype(np.uint8))


BOX = {
    name: colored(photograph(camera, brick(*PLACE, YAW, SIZE), (640, 480)))
    for name, camera in (("front", FRONT), ("overhead", OVERHEAD))
}


def cells(shape: CropShape = SHAPE) -> tuple[Array, Array]:
    """Return x and y of the middles of a crop's cells, (S, S) metres, TCP frame."""
    middles = (np.arange(shape.size) + 0.5) * shape.cell - shape.extent / 2.0
    x, y = np.meshgrid(middles, middles, indexing="ij")
    return x, y


class TestABoxOnATable:
    """Seen by cameras whose depth is exact, so that heights are, too."""

    @pytest.mark.parametrize("camera", BOX)
    @pytest.mark.parametrize(("ahead", "turn"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.7), (-0.01, 2.0)])
    def test_lies_where_it_is(self, camera: str, ahead: float, turn: float) -> None:
        T_world_box = transform(rotation_about((0.0, 0.0, 1.0), YAW), (*PLACE, 0.0))
        T_box_tcp = looking_down(ahead, 0.0, turn)
        crop = grasp_crop([BOX[camera]], T_world_box @ T_box_tcp, SHAPE)
        x, y = cells()
        at_box = np.stack([x, y, np.zeros_like(x)], -1) @ T_box_tcp[:3, :3].T + T_box_tcp[:3, 3]
        beyond = (np.abs(at_box[..., :2]) - np.array(SIZE[:2]) / 2.0).max(axis=-1)
        on_top, beside = beyond < -SHAPE.cell, beyond > SHAPE.cell
        seen = np.isfinite(crop.height)
        assert on_top.sum() > 100
        assert seen[on_top].all()
        np.testing.assert_allclose(crop.height[on_top], SIZE[2] - TCP_HEIGHT, atol=1e-6)
        np.testing.assert_allclose(crop.height[beside & seen], -TCP_HEIGHT, atol=1e-6)
        assert (crop.label[on_top] == Label.TARGET).all()
        assert (crop.label[beside & seen] == Label.TABLE).all()
        assert (seen == (crop.label > 0)).all()
        assert (seen | ~beside)[beyond < 0.1].mean() > 0.8, "all is seen but for the shadow"

    def test_has_the_colour_of_the_very_pixel_that_is_highest(self) -> None:
        image = BOX["overhead"]
        crop = grasp_crop([image], looking_down(*PLACE, YAW), SHAPE)
        seen = crop.label > 0
        number = crop.rgb[seen].astype(int) @ [1, 256, 65536]
        assert (image.segmentation.ravel()[number] == crop.label[seen]).all()
        assert len(np.unique(number)) == seen.sum()

    @pytest.mark.parametrize("camera", BOX)
    def test_turns_with_the_gripper(self, camera: str) -> None:
        straight, turned = (
            grasp_crop([BOX[camera]], looking_down(*PLACE, 0.3) @ quarter, SHAPE)
            for quarter in (np.eye(4), transform(rotation_about((0, 0, 1), math.pi / 2), (0, 0, 0)))
        )
        for name in ("height", "label"):
            want = np.rot90(getattr(straight, name), -1)
            agree = np.isclose(getattr(turned, name), want, atol=1e-6, equal_nan=True)
            assert agree.mean() > 0.995, "all but points on the border of two cells"
        assert not np.allclose(straight.label, turned.label)

    def test_moves_against_the_gripper(self) -> None:
        steps = 5
        T = looking_down(*PLACE, 0.3)
        ahead = T @ transform(np.eye(3), (steps * SHAPE.cell, 0.0, 0.0))
        here, there = (grasp_crop([BOX["overhead"]], each, SHAPE) for each in (T, ahead))
        agree = np.isclose(there.height[:-steps], here.height[steps:], atol=1e-6, equal_nan=True)
        assert agree.mean() > 0.995
        below = grasp_crop([BOX["overhead"]], T @ transform(np.eye(3), (0, 0, 0.01)), SHAPE)
        np.testing.assert_allclose(below.height, here.height + 0.01, atol=1e-6)

    def test_is_cut_off_beyond_the_reach(self) -> None:
        shallow = CropShape(reach=0.025)
        crop = grasp_crop([BOX["overhead"]], looking_down(*PLACE, YAW), shallow)
        assert set(np.unique(crop.label)) == {0, Label.TARGET}, "the table is 30 mm below"

    def test_is_coarser_in_fewer_cells_of_the_same_square(self) -> None:
        T = looking_down(*PLACE, 0.3)
        fine, coarse = (
            grasp_crop([BOX["overhead"]], T, CropShape(size=size)).height for size in (48, 24)
        )
        tops = np.fmax.reduce(fine.reshape(24, 2, 24, 2), axis=(1, 3))
        assert np.isclose(tops, coarse, atol=1e-6).mean() > 0.99

    @pytest.mark.parametrize("step", [1, 10], ids=["fine", "coarse"])
    @pytest.mark.parametrize("target", [(2, 0, 0.4), (0.55, 0.9, 0), (1, 0.1, 3)], ids=str)
    def test_is_not_there_for_a_camera_that_looks_away(
        self, target: tuple[float, float, float], step: int
    ) -> None:
        image = BOX["front"]
        away = dataclasses.replace(
            image,
            depth=image.depth[::step, ::step],
            segmentation=image.segmentation[::step, ::step],
            rgb=image.rgb[::step, ::step],
            intrinsics=np.diag([1.0 / step, 1.0 / step, 1.0]) @ image.intrinsics,
            T_world_camera=look_at((1.15, 0, 0.58), target),
        )
        for image in (away, dataclasses.replace(away, depth=np.full_like(away.depth, 1e30))):
            crop = grasp_crop([image], looking_down(*PLACE, YAW), SHAPE)
            assert np.isnan(crop.height).all()
            assert not crop.label.any()
            assert not crop.rgb.any()
        assert np.isnan(grasp_crop([], looking_down(*PLACE, YAW)).height).all()


class TestSeveralCameras:
    @given(order=st.permutations(sorted(BOX)), yaw=st.floats(-3.0, 3.0))
    def test_give_the_highest_point_of_any_of_them(self, order: list[str], yaw: float) -> None:
        T = looking_down(*PLACE, yaw)
        alone = [grasp_crop([BOX[name]], T) for name in order]
        together = grasp_crop([BOX[name] for name in order], T)
        first, last = alone
        highest = np.fmax(first.height, last.height)
        assert together.height.tobytes() == highest.tobytes()
        has_last = last.height == highest
        np.testing.assert_array_equal(together.label, np.where(has_last, last.label, first.label))
        np.testing.assert_array_equal(
            together.rgb, np.where(has_last[..., None], last.rgb, first.rgb)
        )

    def test_see_what_one_has_in_the_shadow(self) -> None:
        T = looking_down(*PLACE, 0.0)
        front, overhead, both = (
            np.isfinite(grasp_crop([BOX[name] for name in names], T).height)
            for names in (["front"], ["overhead"], ["front", "overhead"])
        )
        assert (both == (front | overhead)).all()
        assert (~front & overhead).sum() > 0.03 * SHAPE.size**2
        assert (front & ~overhead).any()


@pytest.mark.parametrize("resolution", [(64, 48), (96, 72), (160, 120), (320, 240), (640, 480)])
@pytest.mark.parametrize("camera", [FRONT, OVERHEAD], ids=["front", "overhead"])
def test_a_plane_has_no_holes_at_any_resolution(camera: Any, resolution: tuple[int, int]) -> None:
    table = photograph(camera, [], resolution)
    for yaw in np.linspace(0.0, math.pi, 13):
        crop = grasp_crop([table], looking_down(0.55, 0.0, yaw))
        assert np.isfinite(crop.height).all()
        np.testing.assert_allclose(crop.height, -TCP_HEIGHT, atol=1e-6)


class TestPixelsWithoutADepth:
    @pytest.mark.parametrize("nothing", [0.0, -1.0, np.nan, np.inf, -np.inf, 3e38])
    def test_show_nothing(self, nothing: float) -> None:
        image = BOX["front"]
        is_hole = np.random.default_rng(0).random(image.depth.shape) < 0.3
        depth = np.where(is_hole, np.float32(nothing), image.depth)
        T = looking_down(*PLACE, YAW)
        crop = grasp_crop([dataclasses.replace(image, depth=depth)], T)
        far = np.where(is_hole, np.float32(4.0), image.depth)
        assert same(crop, grasp_crop([dataclasses.replace(image, depth=far)], T))
        number = crop.rgb[crop.label > 0].astype(int) @ [1, 256, 65536]
        assert not is_hole.ravel()[number].any()

    def test_leave_an_empty_crop_if_there_are_no_others(self) -> None:
        image = dataclasses.replace(BOX["front"], depth=np.zeros_like(BOX["front"].depth))
        assert np.isnan(grasp_crop([image], looking_down(*PLACE, YAW)).height).all()


def is_depth(depth: np.float32) -> bool:
    return bool(np.isfinite(depth) and depth > 0.0)


def plain_depth(image: NDArray[np.float32], i: int, j: int, parts: int) -> np.float32:
    """Return the depth of a part of a pixel, which lies in a plane through it."""
    f32 = np.float32
    if parts == 1:
        return f32(image[i, j])

    def slope(di: int, dj: int) -> np.float32:
        ends = [(i // parts + s * di, j // parts + s * dj) for s in (1, -1)]
        near = [
            f32(1.0) / image[end]
            for end in ends
            if 0 <= end[0] < len(image) and 0 <= end[1] < image.shape[1]
            if is_depth(image[end])
        ]
        if len(near) < 2:
            return f32(0.0)
        ahead, behind = near[0] - here, here - near[1]
        if not ahead * behind > 0.0:
            return f32(0.0)
        return ahead if abs(ahead) < abs(behind) else behind

    here = f32(1.0) / image[i // parts, j // parts]
    down, right = (f32((k % parts + 0.5) / parts - 0.5) for k in (i, j))
    return f32(1.0) / (here + slope(1, 0) * down + slope(0, 1) * right)


def plain_crop(images: Sequence[CameraImage], T_world_tcp: Array, shape: CropShape) -> GraspCrop:
    """Return a crop by its definition: point after point, in every pixel of every image."""
    height = np.full((shape.size, shape.size), np.nan, np.float32)
    label = np.zeros((shape.size, shape.size), np.uint8)
    rgb = np.zeros((shape.size, shape.size, 3), np.uint8)
    half = shape.extent / 2.0
    f32 = np.float32
    for image in images:
        T_tcp_camera = inverse(T_world_tcp) @ image.T_world_camera
        corners = [
            (np.array([x, y, z]) - T_tcp_camera[:3, 3]) @ T_tcp_camera[:3, :3]
            for x in (-half, half) for y in (-half, half) for z in (-shape.reach, shape.reach)
        ]  # fmt: skip
        K = image.intrinsics
        spacing = GLANCE * max(corner[2] for corner in corners) / K[0, 0]
        parts = max(1, math.ceil(spacing / shape.cell))
        M = T_tcp_camera[:3] * np.array([[1.0 / shape.cell], [1.0 / shape.cell], [1.0]])
        M[:2, 3] += shape.size / 2.0
        M = M.astype(f32)
        rows, columns = image.depth.shape
        for i in range(rows * parts):
            y = f32((i + (0.5 - parts * (K[1, 2] + 0.5))) / (parts * K[1, 1]))
            for j in range(columns * parts):
                x = f32((j + (0.5 - parts * (K[0, 2] + 0.5))) / (parts * K[0, 0]))
                if not is_depth(image.depth[i // parts, j // parts]):
                    continue
                depth = plain_depth(image.depth, i, j, parts)
                row, column, z = (((a * x + c) + b * y) * depth + t for a, b, c, t in M)
                if not (0.0 <= row < shape.size and 0.0 <= column < shape.size):
                    continue
                if not abs(z) < f32(shape.reach):
                    continue
                cell = int(row), int(column)
                if not height[cell] > -z:
                    height[cell] = f32(0.0) - z
                    label[cell] = image.segmentation[i // parts, j // parts]
                    rgb[cell] = image.rgb[i // parts, j // parts]
    return GraspCrop(height=height, label=label, rgb=rgb)


unit = st.floats(-1.0, 1.0)
vectors = st.tuples(unit, unit, unit).map(np.array)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[list[CameraImage], Array, CropShape]:
    """Draw small images of rough ground with holes, from anywhere, and a grasp at any angle."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    shape = CropShape(
        size=draw(st.integers(8, 16)),
        extent=draw(st.floats(0.1, 0.5)),
        reach=draw(st.floats(0.05, 0.4)),
    )
    images = []
    for _ in range(draw(st.integers(1, 2))):
        width, height = draw(st.integers(1, 16)), draw(st.integers(1, 12))
        eye = draw(vectors) * 0.4 + np.array([0.0, 0.0, draw(st.sampled_from([0.1, 0.8]))])
        distance = np.linalg.norm(eye)
        rough = draw(st.sampled_from([0.1, 0.005]))
        slant = np.linspace(-0.1, 0.1, width) + np.linspace(0.0, 0.05, height)[:, None]
        depth = (distance + slant + rng.normal(0.0, rough, slant.shape)).astype(np.float32)
        holes = rng.choice([0.0, np.nan, np.inf, -1.0], depth.shape)
        depth = np.where(rng.random(depth.shape) < 0.2, holes, depth).astype(np.float32)
        if draw(st.booleans()):  # of equal heights, too
            depth[...] = np.float32(distance)
        focal = draw(st.floats(15.0, 150.0))
        K = np.array([[focal, 0, width / 2], [0, focal * 1.1, height / 2], [0, 0, 1]])
        images.append(
            CameraImage(
                rgb=rng.integers(0, 256, (height, width, 3), np.uint8),
                depth=depth,
                segmentation=rng.integers(1, 8, (height, width), np.uint8),
                intrinsics=K,
                T_world_camera=look_at(eye + 1e-3, draw(vectors) * 0.05, (0.1, 1.0, 0.2)),
            )
        )
    angle = draw(st.floats(-3.2, 3.2))
    axis = draw(vectors.filter(lambda v: np.linalg.norm(v) > 0.1))
    R = rotation_about(axis / np.linalg.norm(axis), angle)
    return images, transform(R, draw(vectors) * 0.1), shape


@settings(max_examples=50)
@given(scene=scenes())
def test_a_crop_has_the_bytes_of_its_plain_definition(
    scene: tuple[list[CameraImage], Array, CropShape],
) -> None:
    images, T_world_tcp, shape = scene
    assert same(grasp_crop(images, T_world_tcp, shape), plain_crop(images, T_world_tcp, shape))


@given(yaw=st.floats(-3.0, 3.0), tilt=st.floats(-0.8, 0.8))
def test_a_relief_is_the_crop_without_its_colours(yaw: float, tilt: float) -> None:
    T = looking_down(*PLACE, yaw) @ transform(rotation_about((1.0, 0.0, 0.0), tilt), (0, 0, 0))
    crop, relief = (make(BOX.values(), T) for make in (grasp_crop, grasp_relief))
    assert crop.height.tobytes() == relief.height.tobytes()
    assert crop.label.tobytes() == relief.label.tobytes()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"size": 7}, "size: got 7, valid: 8 to 512 pixels"),
        ({"size": 48.0}, "size: got 48.0, valid: 8 to 512 pixels"),
        ({"extent": 0.0}, "extent: got 0.0, valid: 0.01 to 1.0 m"),
        ({"reach": math.nan}, "reach: got nan, valid: 0.01 to 1.0 m"),
    ],
)
def test_a_shape_that_is_none_is_refused(settings: Mapping[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        CropShape(**settings)


CONFIG = FactoryConfig.from_plain(
    {
        "resolution": [96, 72],
        "block_size": 4,
        "cameras": {name: to_plain(CAMERAS[name].config) for name in ("front", "overhead")},
    }
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of simulated episodes with two cameras."""
    path = tmp_path_factory.mktemp("crops") / "store"
    generate(CONFIG, 6, path, workers=1)
    return path


@pytest.fixture(scope="module")
def dataset(path: Path) -> Dataset:
    return Dataset(path)


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Return a store of made-up episodes, some without a plan, and one that is quarantined."""
    path = tmp_path_factory.mktemp("made_up") / "store"
    config = small_config()
    prepare_store(path, config, JOINTS, 12, {})
    for block in range(3):
        ZarrWriter(path).write_block(block, make_rows(config, block, 12, [5]))
    return Dataset(path)


class TestInADataset:
    @pytest.mark.slow
    def test_a_crop_is_of_the_episodes_grasp_images_and_calibration(self, dataset: Dataset) -> None:
        for row in dataset.where(success=[True, False]).indices.tolist():
            cameras = dataset[row].cameras.items()
            images = [
                CameraImage(
                    rgb=camera.rgb[0],
                    depth=camera.depth[0],
                    segmentation=camera.segmentation[0],
                    intrinsics=camera.intrinsics,
                    T_world_camera=camera.T_world_camera[0],
                )
                for _, camera in cameras
            ]
            position, quat = (
                dataset.column(f"grasp_{name}")[row] for name in ("position", "quat_xyzw")
            )
            T = pose_matrices(np.concatenate([position, quat]))
            assert same(dataset.grasp_crop(row), grasp_crop(images, T))
            for (name, _), image in zip(cameras, images, strict=True):
                assert same(dataset.grasp_crop(row, camera=name), grasp_crop([image], T))
            other = T @ transform(rotation_about((0, 0, 1), 0.5), (0.01, 0.0, -0.02))
            shape = CropShape(size=20)
            assert same(
                dataset.grasp_crop(row, shape, T_world_tcp=other.tolist()),
                grasp_crop(images, other, shape),
            )

    def test_the_target_is_in_the_middle_of_a_grasp_that_holds_it(self, dataset: Dataset) -> None:
        rows = dataset.where(success=True).indices.tolist()
        assert rows
        for row in rows:
            label = dataset.grasp_crop(row).label
            middle = label[20:28, 20:28]
            assert (middle == Label.TARGET).mean() > 0.5

    def test_noise_is_that_of_the_images(self, path: Path) -> None:
        noisy = Dataset(path, noise="stereo", noise_seed=1)
        row = int(noisy.committed[0])
        image = noisy.scenes([row])[0]["front"]
        depth = noisy.image(row, "front", "depth", 0)
        assert image.depth.tobytes() == depth.tobytes()
        T = looking_down(0.55, 0.0, 0.0)
        assert same(noisy.grasp_crop(row, T_world_tcp=T, camera="front"), grasp_crop([image], T))
        clean = Dataset(path).grasp_crop(row, T_world_tcp=T)
        assert not same(clean, noisy.grasp_crop(row, T_world_tcp=T))

    def test_an_episode_without_a_grasp_says_so_and_takes_any(self, made_up: Dataset) -> None:
        position = made_up.column("grasp_position")
        rows = [r for r in made_up.committed.tolist() if np.isnan(position[r]).any()]
        assert rows
        outcome = Outcome(int(made_up.column("outcome")[rows[0]])).name.lower()
        with pytest.raises(UsageError) as caught:
            made_up.grasp_crop(rows[0])
        assert str(caught.value) == (
            f"T_world_tcp=None: episode {rows[0]} has none (its outcome is {outcome}),"
            " valid: rows of where(grasp_width=Range(0.0))"
        )
        crop = made_up.grasp_crop(rows[0], T_world_tcp=looking_down(0.5, 0.0, 0.0))
        assert crop.height.shape == (48, 48)

    @pytest.mark.parametrize(
        "pose",
        [
            np.eye(3),
            np.full((4, 4), np.nan),
            "up",
            2.0 * np.eye(4),
            np.diag([1.0, 1.0, -1.0, 1.0]),
            np.diag([2.0, 1.0, 1.0, 1.0]),
            [[1, 2], [3]],
        ],
        ids=str,
    )
    def test_what_is_no_pose_is_refused(self, dataset: Dataset, pose: Any) -> None:
        with pytest.raises(UsageError) as caught:
            dataset.grasp_crop(0, T_world_tcp=pose)
        assert str(caught.value).startswith("T_world_tcp: got ")
        assert str(caught.value).endswith(", valid: a rigid transform, (4, 4), metres")

    def test_names_and_rows_are_checked(self, dataset: Dataset, made_up: Dataset) -> None:
        with pytest.raises(UnknownNameError, match="unknown camera 'frnt'; did you mean 'front'"):
            dataset.grasp_crop(0, camera="frnt")
        with pytest.raises(IndexError, match="episode 6: valid: -6 to 5"):
            dataset.grasp_crop(6)
        with pytest.raises(StoreError, match="episode 5 is quarantined"):
            made_up.grasp_crop(5, T_world_tcp=np.eye(4))

    def test_scenes_have_the_images_that_are_asked_for_in_order(self, dataset: Dataset) -> None:
        rows = dataset.committed[[3, 0, 3]].tolist()
        for row, scene in zip(rows, dataset.scenes(rows, ["depth"], frame=1), strict=True):
            assert list(scene) == ["front", "overhead"]
            for name, image in scene.items():
                camera = dataset[row].cameras[name]
                assert image.depth.tobytes() == camera.depth[1].tobytes()
                assert image.intrinsics.tobytes() == camera.intrinsics.tobytes()
                assert image.T_world_camera.tobytes() == camera.T_world_camera[1].tobytes()
                assert image.rgb.shape == camera.rgb[1].shape
                assert image.segmentation.shape == camera.segmentation[1].shape
                assert not image.rgb.any()
                assert not image.segmentation.any()
        with pytest.raises(UnknownNameError, match="unknown image kind 'dpth'"):
            dataset.scenes(rows, ["dpth"])


def test_an_old_sample_has_crops(tmp_path: Path) -> None:
    samples = TINY
    dataset = Dataset(shutil.copytree(samples, tmp_path / "tiny.zarr"))
    for row in dataset.where(success=True).indices.tolist():
        assert (dataset.grasp_crop(row).label == Label.TARGET).sum() > 20
