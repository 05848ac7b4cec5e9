from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from support.scenes import SMALL, cube_spec, take_images

from grasp_factory.core.appearance import SurfaceAppearance, Surroundings
from grasp_factory.core.camera import Light, deproject, project
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.geometry import IDENTITY, Pose, apply, inverse
from grasp_factory.robots import ROBOTS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation import static_scene
from grasp_factory.simulation.images import render
from grasp_factory.simulation.robot import Robot
from grasp_factory.simulation.scene import build_scene, render_cameras, settle, take_shots
from grasp_factory.simulation.world import World
from grasp_factory.simulation.world.foot import foot_of

ALL_CAMERAS = {name: camera.config for name, camera in CAMERAS.items()}
CROWD = dataclasses.replace(
    SMALL,
    cameras=ALL_CAMERAS,
    clutter=ClutterConfig(count=4),
    randomize=RANDOMIZE_PRESETS["strong"],
)


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World() as world:
        yield world


def crowd(index: int) -> EpisodeSpec:
    return sample_spec(CROWD, index)


class TestBackgrounds:
    def test_images_are_the_same_whether_the_background_was_there_already(
        self, world: World
    ) -> None:
        static_scene._backgrounds.clear()
        first = render_cameras(build_scene(world, crowd(0)))
        again = render_cameras(build_scene(world, crowd(0)))
        for name, (_, image) in first.items():
            assert np.array_equal(image.rgb, again[name][1].rgb)
            assert np.array_equal(image.zbuffer, again[name][1].zbuffer)

    def test_there_are_never_more_than_memory_allows_and_the_one_used_last_stays(
        self, world: World, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        static_scene._backgrounds.clear()
        build_scene(world, crowd(0))
        size = sum(render.nbytes for render in static_scene._backgrounds.values())
        monkeypatch.setattr(static_scene, "MAX_BACKGROUND_BYTES", 3 * size)
        kept = set(static_scene._backgrounds)
        for index in range(1, 5):
            build_scene(world, crowd(index))
            build_scene(world, crowd(0))
            assert kept <= set(static_scene._backgrounds)
        assert len(static_scene._backgrounds) == 6

    def test_small_ones_are_not_kept_without_end_either(
        self, world: World, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(static_scene, "MAX_BACKGROUNDS", 4)
        for index in range(5):
            build_scene(world, crowd(index))
        assert len(static_scene._backgrounds) == 4

    @pytest.mark.parametrize("robot", ROBOTS)
    def test_the_foot_in_them_is_the_robots_own(self, world: World, robot: str) -> None:
        world.reset(cube_spec().physics)
        whole = Robot(world, ROBOTS[robot])
        foot = world.load_urdf(foot_of(ROBOTS[robot].path()), IDENTITY, fixed=True)
        assert world.joints(foot) == {}
        assert world.bounds(foot) == world.bounds(whole.body)

    def test_surroundings_that_come_again_are_not_rendered_again(
        self, world: World, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        static_scene._backgrounds.clear()
        build_scene(world, cube_spec())
        monkeypatch.delattr(static_scene, "render")
        build_scene(world, cube_spec())


class TestLooks:
    def test_table_and_floor_have_the_colors_of_the_recipe(self, world: World) -> None:
        looks = Surroundings(
            table=SurfaceAppearance(color=(1.0, 0.0, 0.0)),
            floor=SurfaceAppearance(color=(0.0, 0.0, 1.0)),
            light=Light(ambient=1.0, diffuse=0.0, specular=0.0),
        )
        image = take_images(build_scene(world, cube_spec(surroundings=looks)))["front"]
        assert np.median(image.rgb[image.segmentation == Label.TABLE], axis=0) == pytest.approx(
            (255, 0, 0), abs=3
        )
        assert np.median(image.rgb[image.segmentation == Label.FLOOR], axis=0) == pytest.approx(
            (0, 0, 255), abs=3
        )

    @pytest.mark.parametrize("texture", ["checker/1", "wood/2"])
    def test_a_texture_shows_on_table_and_object(self, world: World, texture: str) -> None:
        plain = cube_spec()
        target = dataclasses.replace(plain.objects[0], texture=texture, color=(1.0, 1.0, 1.0))
        looks = Surroundings(table=SurfaceAppearance(color=(1.0, 1.0, 1.0), texture=texture))
        textured = dataclasses.replace(plain, objects=(target,), surroundings=looks)
        for label in (Label.TABLE, Label.TARGET):
            spread = []
            for spec in (plain, textured):
                image = take_images(build_scene(world, spec))["front"]
                spread.append(len(np.unique(image.rgb[image.segmentation == label], axis=0)))
            assert spread[1] > spread[0]

    def test_looks_change_neither_depth_nor_segmentation(self, world: World) -> None:
        plain, looks = (
            take_images(build_scene(world, sample_spec(config, 1)))["front"]
            for config in (SMALL, dataclasses.replace(SMALL, randomize=RANDOMIZE_PRESETS["looks"]))
        )
        assert np.array_equal(plain.depth, looks.depth)
        assert np.array_equal(plain.segmentation, looks.segmentation)
        assert not np.array_equal(plain.rgb, looks.rgb)


class TestWristCamera:
    def test_it_moves_with_the_hand_and_sees_the_world_where_it_is(self, world: World) -> None:
        spec = cube_spec(cameras=ALL_CAMERAS)
        scene = build_scene(world, spec)
        settle(scene)
        seen = []
        for offset in (0.0, 0.15):
            posture = np.array(scene.robot.model.home)
            posture[1] += offset
            scene.robot.command(posture.tolist(), [0.0] * 7, 0.05, 240)
            for _ in range(200):
                world.step()
            image = take_images(scene)["wrist"]
            T = inverse(scene.robot.T_world_tcp()) @ image.T_world_camera
            assert T[:3, 3] == pytest.approx(ALL_CAMERAS["wrist"].eye, abs=1e-9)
            points = apply(image.T_world_camera, deproject(image.depth, image.intrinsics))
            table = points[image.segmentation == Label.TABLE]
            assert np.abs(table[:, 2]).max() < 0.001
            cube = points[image.segmentation == Label.TARGET]
            assert len(cube) > 20
            assert cube.min() > -0.001
            assert np.abs(cube.mean(axis=0) - scene.com()).max() < 0.03
            seen.append(image.T_world_camera)
        assert np.linalg.norm(seen[1][:3, 3] - seen[0][:3, 3]) > 0.05

    def test_it_sees_the_space_between_the_fingertips(self, world: World) -> None:
        scene = build_scene(world, cube_spec(cameras=ALL_CAMERAS))
        image = take_images(scene)["wrist"]
        tip = scene.robot.T_world_tcp()[:3, 3]
        u, v = project(apply(inverse(image.T_world_camera), tip), image.intrinsics)
        height, width = image.depth.shape
        assert 0.2 * width < u < 0.8 * width
        assert 0.1 * height < v < 0.9 * height


class TestVisibility:
    def test_shares_are_those_of_whole_renders_of_each_object_alone(self, world: World) -> None:
        for index in range(3):
            scene = build_scene(world, crowd(index))
            settle(scene)
            shots = take_shots(scene)
            bodies = (scene.robot.body, *scene.objects)
            for name, (camera, whole) in render_cameras(scene).items():
                hidden = {body: world.hide(body) for body in bodies}
                expected = []
                for body in scene.objects:
                    world.show(body, hidden[body])
                    alone = render(world, camera, Light()).pixels_of(body)
                    expected.append(whole.pixels_of(body) / alone if alone else 0.0)
                    world.hide(body)
                for body, looks in hidden.items():
                    world.show(body, looks)
                assert shots[name].visibility == pytest.approx(np.array(expected), abs=1e-6)

    def test_an_object_in_the_open_is_seen_whole_and_one_out_of_view_not_at_all(
        self, world: World
    ) -> None:
        near = cube_spec().objects[0]
        far = dataclasses.replace(near, drop_pose=Pose((0.5, 3.0, 0.1), (0.0, 0.0, 0.0, 1.0)))
        scene = build_scene(world, cube_spec(objects=(near, far)))
        assert take_shots(scene)["front"].visibility.tolist() == [1.0, 0.0]

    def test_one_behind_another_is_hidden(self, world: World) -> None:
        front = cube_spec().objects[0]
        behind = dataclasses.replace(
            front, drop_pose=Pose((0.49, 0.05, 0.026), (0.0, 0.0, 0.0, 1.0)), scale=0.5
        )
        scene = build_scene(world, cube_spec(objects=(front, behind)))
        shares = take_shots(scene)["front"].visibility
        assert shares[0] == 1.0
        assert shares[1] < 0.7

    def test_hiding_and_showing_leaves_no_trace(self, world: World) -> None:
        scene = build_scene(world, crowd(2))
        before = render_cameras(scene)["front"][1]
        for body in (scene.robot.body, *scene.objects):
            world.show(body, world.hide(body))
        after = render_cameras(build_scene(world, crowd(2)))["front"][1]
        again = render_cameras(scene)["front"][1]
        assert np.array_equal(before.rgb, after.rgb)
        assert np.abs(before.rgb.astype(int) - again.rgb).max() <= 1  # see static_scene._background
