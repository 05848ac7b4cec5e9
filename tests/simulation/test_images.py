"""The images' geometry against what is known of the scene."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scale import scaled
from support.scenes import SMALL, cube_spec, take_images
from support.worlds import world_of

from grasp_factory.core.camera import deproject, project
from grasp_factory.core.config.cameras import CAMERAS as SHIPPED
from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.geometry import Pose, apply, inverse
from grasp_factory.core.renderer import Renderer
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.robots import ROBOTS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.images import render
from grasp_factory.simulation.scene import Scene, build_scene, render_cameras, settle
from grasp_factory.simulation.world import World

CAMERAS = {
    "front": SMALL.cameras["front"],
    "steep": CameraConfig(eye=(0.75, -0.25, 0.9), target=(0.55, 0.0, 0.0), fov_y_deg=50.0),
    "grazing": CameraConfig(eye=(1.3, 0.5, 0.25), target=(0.55, 0.0, 0.05), fov_y_deg=35.0),
}
CUBE_CORNERS = np.array(np.meshgrid(*[[-0.025, 0.025]] * 3)).reshape(3, -1).T


@pytest.fixture(scope="module")
def tiny_world():
    with World() as world:
        yield world


@pytest.fixture(scope="module", params=Renderer, ids=lambda renderer: renderer.value)
def world(request):
    with world_of(request.param) as world:
        yield world


def floating_cube(world, camera, quat, resolution=(640, 480)):
    """Return the image of a cube in the air, at a pose that is known exactly."""
    spec = cube_spec((0.55, 0.03, 0.12), quat, cameras={"it": CAMERAS[camera]},
                     resolution=resolution, physics=PhysicsConfig())  # fmt: skip
    scene = build_scene(world, spec)
    pose = Pose(*world.com_frame(scene.objects[0]))
    return take_images(scene)["it"], pose


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("resolution", [(640, 480), (320, 200), (161, 121)])
def test_table_pixels_deproject_to_the_table_top_within_a_millimetre(world, camera, resolution):
    spec = cube_spec(cameras={"it": CAMERAS[camera]}, resolution=resolution)
    image = take_images(build_scene(world, spec))["it"]
    points = deproject(image.depth.astype(float), image.intrinsics)
    height = apply(image.T_world_camera, points)[image.segmentation == Label.TABLE][:, 2]
    assert len(height) > 1000
    assert np.mean(np.abs(height) < 1e-3) >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("seed", range(scaled(2, 6)))
def test_a_cubes_mask_is_its_projected_outline_within_one_pixel(world, camera, seed):
    quat = np.random.default_rng(seed).normal(size=4)
    image, pose = floating_cube(world, camera, tuple(quat / np.linalg.norm(quat)))
    corners = apply(inverse(image.T_world_camera), apply(pose.matrix(), CUBE_CORNERS))
    outline = cv2.convexHull(project(corners, image.intrinsics).astype(np.float32))
    mask = image.segmentation == Label.TARGET
    assert mask.sum() > 200
    for v in range(mask.shape[0]):
        for u in range(mask.shape[1]):
            inside = cv2.pointPolygonTest(outline, (float(u), float(v)), measureDist=True)
            if inside > 1.0:
                assert mask[v, u], (u, v, inside)
            elif inside < -1.0:
                assert not mask[v, u], (u, v, inside)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_cubes_pixels_deproject_onto_its_faces(world, camera):
    image, pose = floating_cube(world, camera, (0.2, 0.1, 0.3, 0.9273618495495703))
    points = deproject(image.depth.astype(float), image.intrinsics)
    seen = apply(image.T_world_camera, points)[image.segmentation == Label.TARGET]
    own = np.abs(apply(inverse(pose.matrix()), seen))
    assert np.mean(np.abs(own.max(axis=1) - 0.025) < 1e-3) > 0.9


@pytest.mark.slow
def test_labels_name_what_is_seen_and_the_arm_hides_no_target_before(world):
    seen = 0
    for index in range(25):
        spec = sample_spec(SMALL, index)
        scene = build_scene(world, spec)
        if settle(scene).outcome is not None:
            continue
        image = take_images(scene)["front"]
        found = set(np.unique(image.segmentation))
        assert {Label.BACKGROUND, Label.FLOOR, Label.TABLE, Label.ARM, Label.TARGET} >= found
        K = image.intrinsics
        com = apply(inverse(image.T_world_camera), scene.com())
        u, v = np.round(project(com, K)).astype(int)
        around = image.segmentation[max(v - 12, 0) : v + 12, max(u - 12, 0) : u + 12]
        assert (around == Label.TARGET).any(), spec.objects[0].object_id
        assert not np.isin(around, (Label.ARM, Label.GRIPPER)).any()
        seen += 1
    assert seen > 15


def test_where_nothing_is_seen_depth_is_the_far_plane_and_the_label_background(world):
    up = CameraConfig(eye=(0.5, 0.0, 1.5), target=(1.0, 0.0, 2.0))
    spec = cube_spec(cameras={"sky": up}, resolution=(64, 48))
    image = take_images(build_scene(world, spec))["sky"]
    assert (image.segmentation == Label.BACKGROUND).all()
    assert image.depth == pytest.approx(np.full((48, 64), up.far))


def test_images_have_the_stated_types_and_shapes(world):
    spec = cube_spec(resolution=(64, 48))
    image = take_images(build_scene(world, spec))["front"]
    assert (image.rgb.dtype, image.rgb.shape) == (np.uint8, (48, 64, 3))
    assert (image.depth.dtype, image.depth.shape) == (np.float32, (48, 64))
    assert (image.segmentation.dtype, image.segmentation.shape) == (np.uint8, (48, 64))


@pytest.mark.slow
@settings(max_examples=scaled(6, 40))
@given(st.integers(0, 10**6), st.sampled_from([(320, 240), (640, 480), (161, 121), (64, 48)]))
def test_compositing_gives_the_full_render_bit_for_bit(tiny_world, seed, resolution):
    """Over robots, postures, objects, looks and cameras, resting contact and occlusion included.

    The two are taken after as many renders as each other, because the engine's images hang on
    their number a little (see stage._background).
    """
    rng = np.random.default_rng(seed)
    config = dataclasses.replace(
        SMALL,
        seed=seed,
        resolution=resolution,
        robot=str(rng.choice(sorted(ROBOTS))),
        object_sets=dict.fromkeys(OBJECT_SETS, 1.0),
        randomize=RANDOMIZE_PRESETS[rng.choice(["none", "looks", "strong"])],
        cameras=CAMERAS | {name: camera.config for name, camera in SHIPPED.items()},
        clutter=ClutterConfig(count=int(rng.integers(1, 5))),
    )
    spec = sample_spec(config, 0)
    composed = posed_scene(tiny_world, spec, seed)
    images = render_cameras(composed)
    stage = posed_scene(tiny_world, spec, seed).stage
    for body, surface in (
        (stage.floor, spec.surroundings.floor),
        (stage.table, spec.surroundings.table),
    ):
        tiny_world.set_look(body, surface.color, surface.texture)
    for name, (camera, composite) in images.items():
        whole = render(tiny_world, camera, spec.surroundings.light)
        for kind in ("rgb", "zbuffer", "mask"):
            a, b = getattr(composite, kind), getattr(whole, kind)
            assert np.array_equal(a, b), (seed, name, kind)
    seen = {int(v) for _, image in images.values() for v in np.unique(image.mask & 0xFFFFFF)}
    assert {stage.table, composed.robot.body} <= seen


def posed_scene(world: World, spec: EpisodeSpec, seed: int) -> Scene:
    """Return a settled scene with the arm somewhere."""
    scene = build_scene(world, spec)
    settle(scene)
    target = np.array(scene.robot.model.home) + np.random.default_rng(seed).normal(0, 0.3, 7)
    scene.robot.command(target.tolist(), [0.0] * 7, 0.05, 240)
    for _ in range(120):
        world.step()
    return scene
