from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.scenes import SMALL, cube_spec, take_images

from grasp_factory.core.enums import Label, Outcome
from grasp_factory.core.geometry import Pose
from grasp_factory.errors import UnknownNameError
from grasp_factory.robots import ROBOTS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.scene import build_scene, observe, settle
from grasp_factory.simulation.world import World


@pytest.fixture(scope="module")
def world():
    with World() as world:
        yield world


def test_a_dropped_cube_comes_to_rest_on_the_table(world):
    scene = build_scene(world, cube_spec((0.55, 0.05, 0.10), (0.1, 0.2, 0.0, 0.97468)))
    assert settle(scene).outcome is None
    assert scene.com()[2] == pytest.approx(0.025, abs=1e-3)


def test_an_object_that_is_let_go_outside_has_left_the_workspace(world):
    scene = build_scene(world, cube_spec((0.9, 0.0, 0.05)))
    assert settle(scene).outcome is Outcome.LEFT_WORKSPACE


def test_an_object_that_falls_off_the_table_has_left_the_workspace(world):
    scene = build_scene(world, cube_spec((1.14, 0.0, 0.05), (0.0, 0.3, 0.0, 0.954)))
    assert settle(scene).outcome is Outcome.LEFT_WORKSPACE


def test_an_object_that_still_moves_when_time_is_over_never_settled(world):
    hurried = dataclasses.replace(SMALL.physics, settle_s=0.1)
    scene = build_scene(world, cube_spec((0.55, 0.0, 0.25), physics=hurried))
    assert settle(scene).outcome is Outcome.NEVER_SETTLED


def test_most_default_objects_settle_inside_the_workspace(world):
    outcomes = [settle(build_scene(world, sample_spec(SMALL, i))).outcome for i in range(60)]
    assert outcomes.count(None) >= 54


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_policy_sees_images_and_robot_state_in_the_scenes_units(world, robot):
    scene = build_scene(world, cube_spec(robot=robot))
    settle(scene)
    view = observe(scene, take_images(scene))
    assert set(view.images) == {"front"}
    assert view.joint_positions == pytest.approx(ROBOTS[robot].home, abs=2e-3)
    assert view.T_world_tcp == pytest.approx(scene.robot.T_world_tcp())
    assert view.target_label == Label.TARGET
    assert np.isin(Label.TARGET, view.images["front"].segmentation)


def test_every_link_and_body_of_the_scene_has_a_label(world):
    scene = build_scene(world, cube_spec())
    links = world.links(scene.robot.body)
    assert scene.label_of(scene.robot.body, -1) == Label.ARM
    assert scene.label_of(scene.robot.body, links["link_7"]) == Label.ARM
    for name in ("ft_sensor", "hand", "left_pad", "right_finger"):
        assert scene.label_of(scene.robot.body, links[name]) == Label.GRIPPER
    assert scene.label_of(scene.objects[0], -1) == Label.TARGET


def test_the_object_has_the_mass_and_friction_of_its_recipe(world):
    spec = cube_spec()
    heavy = dataclasses.replace(spec.objects[0], mass=0.35, lateral_friction=0.31)
    scene = build_scene(world, dataclasses.replace(spec, objects=(heavy,)))
    assert world.mass(scene.objects[0]) == 0.35
    import pybullet

    info = pybullet.getDynamicsInfo(scene.objects[0], -1, physicsClientId=world._client)
    assert info[1] == 0.31


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": "kuka"}, "unknown robot 'kuka'; did you mean 'kuka_iiwa'?"),
        ({"object_id": "classic/cub"}, "did you mean 'classic/cube'?"),
        ({"object_set": "clasic"}, "unknown object set 'clasic'; did you mean 'classic'?"),
    ],
    ids=["robot", "object", "set"],
)
def test_names_that_no_table_has_are_named(world, change, message):
    spec = cube_spec()
    if "robot" in change:
        spec = dataclasses.replace(spec, **change)
    else:
        spec = dataclasses.replace(spec, objects=(dataclasses.replace(spec.objects[0], **change),))
    with pytest.raises(UnknownNameError, match=message.replace("?", r"\?")):
        build_scene(world, spec)


@pytest.mark.parametrize("index", [11, 17, 31, 42])
def test_an_object_that_no_longer_moves_has_settled_though_its_velocity_chatters(world, index):
    scene = build_scene(world, sample_spec(SMALL, index))
    outcome = settle(scene).outcome
    before = scene.com()
    for _ in range(240):
        world.step()
    moved = np.linalg.norm(scene.com() - before)
    assert (outcome is None) == (moved < 0.003)


def test_a_neighbor_that_rolls_outside_the_workspace_is_not_waited_for_and_says_so(world):
    spec = cube_spec()
    ball = dataclasses.replace(
        spec.objects[0],
        object_id="classic/sphere",
        drop_pose=Pose((0.95, 0.3, 0.4), (0.0, 0.0, 0.0, 1.0)),
    )
    hurried = dataclasses.replace(spec.physics, settle_s=0.6)
    settled = settle(
        build_scene(world, cube_spec(objects=(spec.objects[0], ball), physics=hurried))
    )
    assert settled.outcome is None
    assert settled.at_rest.tolist() == [True, False]


def test_a_neighbor_that_still_moves_above_the_workspace_is_waited_for(world):
    spec = cube_spec()
    high = dataclasses.replace(
        spec.objects[0], drop_pose=Pose((0.6, -0.1, 1.4), (0.0, 0.0, 0.0, 1.0))
    )
    hurried = dataclasses.replace(spec.physics, settle_s=0.5)
    settled = settle(
        build_scene(world, cube_spec(objects=(spec.objects[0], high), physics=hurried))
    )
    assert settled.outcome is Outcome.NEVER_SETTLED


def test_a_texture_that_is_shown_many_times_is_loaded_once(world):
    scene = build_scene(world, cube_spec())
    loaded = []
    for _ in range(3):
        world.set_look(scene.stage.table, (1.0, 1.0, 1.0), "wood/1")
        loaded.append(dict(world._textures.loaded))
    assert loaded[0] == loaded[1] == loaded[2]
    assert list(loaded[0]) == ["wood/1"]
