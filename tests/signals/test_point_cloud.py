"""Point clouds: points lie where physics and geometry say, whatever frame they are asked for in."""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_episode, small_config

from grasp_factory.core.camera import Intrinsics, project
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Label, Outcome
from grasp_factory.core.episode import CameraImage
from grasp_factory.core.geometry import Array, apply, inverse, look_at, pose_matrices
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation.merge import split
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, UnknownNameError, UsageError
from grasp_factory.factory.generate import generate
from grasp_factory.objects import find_set
from grasp_factory.signals.point_cloud import (
    FAR_SHARE,
    FRAMES,
    PointCloud,
    joined,
    label_mask,
    visible_cloud,
)
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

FAR = 5.0
EVERYTHING = label_mask("scene", 1)


def image_of_the_table(eye: Array, target: Array, size: tuple[int, int] = (40, 30)) -> CameraImage:
    """Return what a camera sees of the plane z = 0: its depth, and a label and a colour a pixel."""
    width, height = size
    intrinsics = Intrinsics.from_fov(width, height, 0.8)
    T_world_camera = look_at(eye, target)
    v, u = np.mgrid[:height, :width]
    rays = np.stack(
        [(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones_like(u)],
        axis=-1,
    )
    down = (rays @ T_world_camera[:3, :3].T)[..., 2]
    depth = np.where(down < 0.0, eye[2] / np.maximum(-down, 1e-9), np.inf)
    number = np.arange(width * height).reshape(height, width)
    return CameraImage(
        rgb=np.stack([number % 256, number // 256, np.zeros_like(number)], -1).astype(np.uint8),
        depth=np.minimum(depth, FAR).astype(np.float32),
        segmentation=(number % 7).astype(np.uint8),
        intrinsics=intrinsics.matrix(),
        T_world_camera=T_world_camera,
    )


eyes = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.3, 1.5)).map(np.array)
targets = st.tuples(st.floats(1.5, 2.0), st.floats(-1.0, 1.0), st.just(0.0)).map(np.array)


@given(eye=eyes, target=targets)
def test_a_plane_is_a_plane_from_wherever_it_is_seen(eye: Array, target: Array) -> None:
    image = image_of_the_table(eye, target)
    cloud = visible_cloud(image, FAR, EVERYTHING)
    assert len(cloud) == np.count_nonzero(image.depth < FAR * FAR_SHARE) > 0
    np.testing.assert_allclose(cloud.points[:, 2], 0.0, atol=1e-5)
    assert (cloud.points.dtype, cloud.points.shape) == (np.float64, (len(cloud), 3))


@given(eye=eyes, target=targets, data=st.data())
def test_a_point_lies_at_its_pixel_and_has_its_colour_and_label(
    eye: Array, target: Array, data: st.DataObject
) -> None:
    image = image_of_the_table(eye, target)
    words = data.draw(st.sampled_from(["scene", "objects", "target", "table", "object_1"]))
    shown = label_mask(words, 2)
    cloud = visible_cloud(image, FAR, shown)
    seen = (image.depth < FAR * FAR_SHARE) & shown[image.segmentation]
    pixels = project(apply(inverse(image.T_world_camera), cloud.points), image.intrinsics)
    v, u = np.nonzero(seen)
    np.testing.assert_allclose(pixels, np.stack([u, v], -1), atol=1e-6)
    np.testing.assert_array_equal(cloud.rgb, image.rgb[v, u])
    np.testing.assert_array_equal(cloud.labels, image.segmentation[v, u])


@given(data=st.data())
def test_pixels_without_a_depth_have_no_point(data: st.DataObject) -> None:
    image = image_of_the_table(np.array([0.0, 0.0, 1.0]), np.array([1.5, 0.0, 0.0]))
    empty = st.sampled_from([0.0, -1.0, np.nan, np.inf, -np.inf, FAR, np.nextafter(FAR, 0.0)])
    depth, whole = image.depth.copy(), visible_cloud(image, FAR, EVERYTHING)
    holes = data.draw(st.dictionaries(st.integers(0, depth.size - 1), empty, max_size=50))
    was_seen = sum(bool(depth.flat[place] < FAR * FAR_SHARE) for place in holes)
    for place, value in holes.items():
        depth.flat[place] = value
    cloud = visible_cloud(dataclasses.replace(image, depth=depth), FAR, EVERYTHING)
    assert len(cloud) == len(whole) - was_seen
    assert np.isfinite(cloud.points).all()


def test_the_parts_of_a_scene_are_its_labels() -> None:
    def values(name: str, objects: int) -> list[int]:
        return np.flatnonzero(label_mask(name, objects)).tolist()

    assert values("target", 1) == values("objects", 1) == [Label.TARGET]
    assert values("objects", 3) == [Label.TARGET, 6, 7]
    assert values("object_2", 3) == [7]
    assert values("gripper", 3) == [Label.GRIPPER]
    assert values("scene", 3) == list(range(256))
    with pytest.raises(UnknownNameError) as caught:
        label_mask("objcts", 2)
    assert str(caught.value) == (
        "unknown part of the scene 'objcts'; did you mean 'objects'?"
        " (valid: arm, floor, gripper, object_1, objects, scene, table, target)"
    )


WITH_WRIST = FactoryConfig.from_plain(
    {
        "resolution": [96, 72],
        "block_size": 4,
        "cameras": {name: to_plain(CAMERAS[name].config) for name in ("front", "wrist")},
        "clutter": {"count": 3},
    }
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of simulated episodes, with two cameras and three objects."""
    path = tmp_path_factory.mktemp("clouds") / "store"
    generate(WITH_WRIST, 6, path, workers=1)
    return path


@pytest.fixture(scope="module")
def dataset(path: Path) -> Dataset:
    dataset = Dataset(path)
    assert dataset.where(success=True).indices.size
    return dataset


BOTH = pytest.mark.parametrize("frame", [0, 1])


def same(a: PointCloud, b: PointCloud) -> bool:
    return all(
        getattr(a, name).tobytes() == getattr(b, name).tobytes()
        for name in ("points", "rgb", "labels")
    )


class TestAnEpisodesCloud:
    @pytest.mark.slow
    @BOTH
    @pytest.mark.parametrize("camera", [*WITH_WRIST.cameras, None])
    def test_has_the_table_at_zero(self, dataset: Dataset, camera: str | None, frame: int) -> None:
        seen = 0
        for i in dataset.committed:
            cloud = dataset.point_cloud(i, camera, frame, of="table")
            np.testing.assert_allclose(cloud.points[:, 2], 0.0, atol=1e-4)
            assert (cloud.labels == Label.TABLE).all()
            seen += len(cloud)
        assert seen > 1000

    @BOTH
    def test_has_the_target_within_its_bounding_box(self, dataset: Dataset, frame: int) -> None:
        """After an attempt that was cut short things may have moved since the last record."""
        for i in dataset.committed if frame == 0 else dataset.where(success=True).indices:
            recipe = dataset.spec(i).objects[0]
            corners = find_set(recipe.object_set).model(recipe.object_id).corners() * recipe.scale
            cloud = dataset.point_cloud(i, frame=frame, of="target", in_frame="object")
            assert (cloud.points > corners.min(axis=0) - 1e-4).all()
            assert (cloud.points < corners.max(axis=0) + 1e-4).all()

    @BOTH
    def test_is_in_the_hand_what_the_camera_on_the_hand_sees(
        self, dataset: Dataset, frame: int
    ) -> None:
        mount = CAMERAS["wrist"].config
        T_tcp_camera = look_at(mount.eye, mount.target, mount.up)
        for i in dataset.where(success=True).indices:
            seen, in_hand = (
                dataset.point_cloud(i, "wrist", frame, in_frame=name).points
                for name in ("camera", "tcp")
            )
            np.testing.assert_allclose(in_hand, apply(T_tcp_camera, seen), atol=2e-5)

    def test_has_what_was_grasped_between_the_pads(self, dataset: Dataset) -> None:
        """Where the target's points pass the TCP they lie within the opening, along y."""
        seen = 0
        for i in dataset.where(success=True).indices:
            cloud = dataset.point_cloud(i, of="target", in_frame="grasp")
            half = dataset.value(i, "grasp_width") / 2.0
            near = np.abs(cloud.points[:, [0, 2]]).max(axis=1) < 0.005
            assert (np.abs(cloud.points[near, 1]) < half).all()
            seen += np.count_nonzero(near)
        assert seen > 0

    def test_comes_back_from_every_frame(self, dataset: Dataset) -> None:
        i = int(dataset.where(success=True).indices[0])
        world = dataset.point_cloud(i, "front", 1)
        episode = dataset[i]
        grasp = [episode.columns[f"grasp_{part}"] for part in ("position", "quat_xyzw")]
        poses = {
            "world": np.eye(4),
            "camera": episode.cameras["front"].T_world_camera[1],
            "tcp": pose_matrices(episode.streams["tcp_pose"][-1]),
            "grasp": pose_matrices(np.concatenate(grasp)),
            "object": pose_matrices(episode.streams["object_pose"][-1, 0]),
        }
        assert set(poses) == set(FRAMES)
        for name, T_world_frame in poses.items():
            cloud = dataset.point_cloud(i, "front", 1, in_frame=name)
            np.testing.assert_allclose(apply(T_world_frame, cloud.points), world.points, atol=1e-9)
            assert same(cloud, dataclasses.replace(world, points=cloud.points))

    @BOTH
    def test_is_its_image_pixel_by_pixel(self, dataset: Dataset, frame: int) -> None:
        i = int(dataset.committed[-1])
        images = {
            kind: dataset.image(i, "front", kind, frame).reshape(96 * 72, -1)
            for kind in ("rgb", "depth", "segmentation")
        }
        cloud = dataset.point_cloud(i, "front", frame, in_frame="camera")
        seen = images["depth"][:, 0] < dataset.spec(i).cameras["front"].far * FAR_SHARE
        np.testing.assert_allclose(cloud.points[:, 2], images["depth"][seen, 0], rtol=1e-12)
        assert cloud.rgb.tobytes() == images["rgb"][seen].tobytes()
        assert cloud.labels.tobytes() == images["segmentation"][seen].tobytes()

    def test_of_all_cameras_is_that_of_each(self, dataset: Dataset) -> None:
        for part in ("scene", "objects", "object_2"):
            clouds = [dataset.point_cloud(1, name, of=part) for name in WITH_WRIST.cameras]
            assert same(dataset.point_cloud(1, of=part), joined(clouds))

    def test_of_the_objects_is_that_of_target_and_others(self, dataset: Dataset) -> None:
        objects = dataset.point_cloud(0, of="objects")
        parts = [dataset.point_cloud(0, of=name) for name in ("target", "object_1", "object_2")]
        assert len(objects) == sum(map(len, parts)) > 0
        assert set(objects.labels) == {label for part in parts for label in part.labels}

    def test_with_noise_is_that_of_the_noisy_images(self, path: Path) -> None:
        noisy = Dataset(path, noise="stereo", noise_seed=3)
        depth = noisy.image(2, "front", "depth", 0)
        rgb = noisy[2].cameras["front"].rgb[0]
        cloud = noisy.point_cloud(2, "front", in_frame="camera")
        assert np.count_nonzero(depth == 0.0) > 0
        np.testing.assert_allclose(cloud.points[:, 2], depth[depth > 0.0], rtol=1e-12)
        assert cloud.rgb.tobytes() == rgb[depth > 0.0].tobytes()

    @pytest.mark.parametrize(
        "how", [{"checked": True}, {"noise": "structured_light", "noise_seed": 5}], ids=str
    )
    def test_is_the_same_in_another_process(
        self, path: Path, tmp_path: Path, how: dict[str, Any]
    ) -> None:
        dataset = Dataset(path, **how)
        (tmp_path / "dataset").write_bytes(pickle.dumps(dataset))
        code = (
            "import hashlib, pickle, sys\n"
            "dataset = pickle.load(open(sys.argv[1], 'rb'))\n"
            "print(hashlib.sha256(dataset.point_cloud(1).points.tobytes()).hexdigest())"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "dataset")],
            capture_output=True, check=True, text=True,
        )  # fmt: skip
        here = hashlib.sha256(dataset.point_cloud(1).points.tobytes()).hexdigest()
        assert done.stdout.strip() == here


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Return a store of one episode in which nothing was planned, seen by two cameras."""
    view = {"eye": [1.0, 0.0, 0.5], "target": [0.5, 0.0, 0.0]}
    config = small_config(cameras={"left": view, "right": view})
    path = tmp_path_factory.mktemp("idle") / "store"
    prepare_store(path, config, JOINTS, 5, {})
    episode = make_episode(config, 0, n_steps=0)
    columns = {
        **episode.columns,
        "grasp_position": np.full(3, np.nan),
        "grasp_quat_xyzw": np.full(4, np.nan),
    }
    episode = dataclasses.replace(episode, outcome=Outcome.NO_PLAN, columns=columns)
    ZarrWriter(path).write_block(0, [episode, *(make_episode(config, i) for i in (1, 2, 3))])
    return Dataset(path)


class TestACloudThatThereIsNotIsRefused:
    @pytest.mark.parametrize(
        ("asked", "message"),
        [
            (
                {"in_frame": "grasp"},
                "in_frame='grasp': episode 0 has none (its outcome is no_plan),"
                " valid: rows of where(grasp_width=Range(0.0))",
            ),
            (
                {"in_frame": "tcp"},
                "in_frame='tcp': episode 0 has none (its outcome is no_plan),"
                " valid: rows of where(n_steps=Range(1))",
            ),
            (
                {"in_frame": "camera"},
                "in_frame='camera': got no camera, valid: camera='left' or camera='right'",
            ),
            (
                {"in_frame": "cam"},
                "unknown frame 'cam'; did you mean 'camera'?"
                " (valid: camera, grasp, object, tcp, world)",
            ),
            ({"camera": "lft"}, "unknown camera 'lft'; did you mean 'left'? (valid: left, right)"),
        ],
    )
    def test_with_what_is_valid(self, idle: Dataset, asked: Any, message: str) -> None:
        with pytest.raises(UsageError) as caught:
            idle.point_cloud(0, **asked)
        assert str(caught.value) == message

    def test_as_an_image_is(self, idle: Dataset) -> None:
        with pytest.raises(IndexError, match=r"frame 2: valid: 0 \(before\) and 1 \(after\)"):
            idle.point_cloud(0, frame=2)
        with pytest.raises(StoreError, match="episode 4 is missing"):
            idle.point_cloud(-1)


def test_noise_is_the_episodes_own_in_a_store_that_was_taken_out_of_another(
    path: Path, tmp_path: Path
) -> None:
    split(path, tmp_path / "two", [2, 5])
    whole, two = (Dataset(p, noise="stereo") for p in (path, tmp_path / "two"))
    for row, was in enumerate((2, 5)):
        episode = whole[was]
        front = episode.cameras["front"]
        assert two[row].checksum() == episode.checksum()
        assert two.image(row, "front", "depth", 1).tobytes() == front.depth[1].tobytes()
        assert two.image(row, "front", "rgb", 0).tobytes() == front.rgb[0].tobytes()
        assert same(two.point_cloud(row), whole.point_cloud(was))
        for name in ("tactile_force", "wrist_wrench", "joint_velocities"):
            felt = episode.streams[name].tobytes()
            assert two.series(row, name)[name].tobytes() == felt
