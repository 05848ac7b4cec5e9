from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet
import pytest
from support.scenes import SMALL

from grasp_factory.core.camera import Camera, Intrinsics, Light, deproject, zbuffer_to_depth
from grasp_factory.core.config.physics import PhysicsConfig, Stepping
from grasp_factory.core.geometry import IDENTITY, Pose, apply, look_at
from grasp_factory.errors import GraspFactoryError, RecipeError
from grasp_factory.objects import MAX_PARTS, OBJECT_SETS, Compound, Part
from grasp_factory.simulation.world import DATA, World

WHITE = (1.0, 1.0, 1.0, 1.0)
BOTTLE = OBJECT_SETS["procedural"].model("procedural/bottle/1")


@pytest.fixture
def world():
    with World() as world:
        world.reset(PhysicsConfig())
        yield world


def force_on(rows, body):
    """Sum the contact forces on a body as the class's docstring says they are signed."""
    total = np.zeros(3)
    for c in rows:
        force = c[9] * np.array(c[7]) + c[10] * np.array(c[11]) + c[12] * np.array(c[13])
        if c[1] == body:
            total += force
        if c[2] == body:
            total -= force
    return total


@pytest.mark.parametrize("order", ["box first", "floor first"])
@pytest.mark.parametrize("hz", [240, 960])
def test_contact_forces_carry_weight_and_friction_whatever_the_order_of_creation(world, order, hz):
    def floor():
        return world.add_box((1, 1, 0.1), (0, 0, -0.1), WHITE)

    def box():
        return world.add_box((0.1, 0.1, 0.1), (0, 0, 0.1), WHITE, mass=2.0)

    if order == "box first":
        body = box()
        ground = floor()
    else:
        ground = floor()
        body = box()
    for b in (body, ground):
        world.change_dynamics(b, -1, lateralFriction=1.0)
    world.set_stepping(Stepping(hz, 100, 1, 1e-7))
    pybullet.setGravity(3.0, 0.0, -9.81, physicsClientId=world._client)
    for _ in range(hz):
        world.step()
    forces = []
    for _ in range(hz // 4):
        world.step()
        forces.append(force_on(world.contacts(), body))
    # One step's force rocks by 2 % at 960 Hz; its mean is Newton's.
    assert np.mean(forces, axis=0) == pytest.approx([-6.0, 0.0, 19.62], abs=0.02)


def test_a_body_in_free_fall_falls_without_damping(world):
    body = world.add_box((0.1, 0.1, 0.1), (0, 0, 10), WHITE, mass=1.0)
    heights = []
    for _ in range(240):
        world.step()
        heights.append(world.com_frame(body)[0][2])
    assert (heights[-1] - heights[-2]) * 240 == pytest.approx(-9.81, rel=1e-9)


def test_reset_undoes_the_settings_that_survive_bullets_own_reset(world):
    client = world._client
    pybullet.setPhysicsEngineParameter(
        fixedTimeStep=1 / 100, numSubSteps=4, contactBreakingThreshold=0.5, physicsClientId=client
    )
    world.reset(PhysicsConfig())
    found = pybullet.getPhysicsEngineParameters(physicsClientId=client)
    assert found["fixedTimeStep"] == 1 / 240
    assert found["numSubSteps"] == 0
    assert found["numSolverIterations"] == SMALL.physics.solver_iterations


def test_reset_undoes_a_contact_threshold_that_another_client_set(world):
    with World() as other:
        pybullet.setPhysicsEngineParameter(
            contactBreakingThreshold=0.5, physicsClientId=other._client
        )
    world.reset(PhysicsConfig())
    world.add_box((1, 1, 0.1), (0, 0, -0.1), WHITE)
    world.add_box((0.1, 0.1, 0.1), (0, 0, 0.15), WHITE, mass=1.0)
    world.step()
    assert world.contacts() == ()


@pytest.mark.parametrize(
    "build",
    [
        lambda world: world.add_box((1, 1, 1), (0, 0, 0), WHITE),
        lambda world: world.load_urdf(DATA / "cube_small.urdf", IDENTITY, fixed=False),
        lambda world: world.place_joints(0, [0], [0.0]),
    ],
    ids=["add_box", "load_urdf", "place_joints"],
)
def test_a_sealed_world_refuses_to_be_built_on(world, build):
    world.seal()
    with pytest.raises(GraspFactoryError, match="only physics moves it now"):
        build(world)


def test_a_missing_file_is_a_recipe_error_that_names_it(world):
    with pytest.raises(RecipeError, match=r"nowhere\.urdf"):
        world.load_urdf(DATA / "nowhere.urdf", IDENTITY, fixed=False)


def test_link_frames_are_up_to_date_after_a_step(world):
    body = world.load_urdf(DATA / "kuka_iiwa/model.urdf", IDENTITY, fixed=True)
    joints = list(range(7))
    world.command_velocities(body, joints, [1.0] * 7, [300.0] * 7)
    for _ in range(10):
        world.step()
    measured = world.link_frames(body, [6])[0]
    angles = [state[0] for state in world.joint_states(body, joints)]
    other = World()
    other.reset(PhysicsConfig())
    twin = other.load_urdf(DATA / "kuka_iiwa/model.urdf", IDENTITY, fixed=True)
    other.place_joints(twin, joints, angles)
    expected = other.link_frames(twin, [6])[0]
    other.close()
    assert measured[0] == pytest.approx(expected[0], abs=1e-9)


def camera_above(height=1.0, size=(64, 48)):
    T = look_at((0.0, 0.0, height), (0.0, 0.0, 0.0), up=(1.0, 0.0, 0.0))
    return Camera("above", Intrinsics.from_fov(*size, np.radians(40)), T, 0.1, 4.0)


def test_the_rendered_depth_of_a_plane_at_one_metre_is_one_metre(world):
    world.add_box((2, 2, 0.1), (0, 0, -0.1), WHITE)
    camera = camera_above()
    _, zbuffer, _ = world.render(camera, Light())
    depth = zbuffer_to_depth(zbuffer, camera.near, camera.far)
    assert depth == pytest.approx(np.ones((48, 64)), abs=2e-5)


def test_rendered_points_lie_where_the_scene_has_them_within_a_tenth_of_a_millimetre(world):
    world.add_box((2, 2, 0.1), (0, 0, -0.1), WHITE)
    T = look_at((0.8, 0.3, 0.5), (0.0, 0.0, 0.0))
    camera = Camera("side", Intrinsics.from_fov(320, 240, np.radians(40)), T, 0.1, 4.0)
    _, zbuffer, mask = world.render(camera, Light())
    depth = zbuffer_to_depth(zbuffer.astype(float), camera.near, camera.far)
    points = apply(T, deproject(depth, camera.intrinsics.matrix()))
    assert np.abs(points[mask >= 0][:, 2]).max() < 1e-4


def test_an_earlier_light_does_not_change_a_later_image(world):
    world.add_box((0.2, 0.2, 0.2), (0, 0, 0), WHITE)
    camera = camera_above()
    first, _, _ = world.render(camera, Light())
    other, _, _ = world.render(camera, Light(direction=(1, 0, 0.1), ambient=0.1, diffuse=0.9))
    again, _, _ = world.render(camera, Light())
    assert (first != other).any()
    assert (first == again).all()


def test_a_pose_is_the_bodys_own_frame_not_its_centre_of_mass(world):
    pose = Pose((0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0))
    duck = world.load_urdf(DATA / "duck_vhacd.urdf", pose, fixed=False)
    assert world.inertial_frame(duck).position == pytest.approx((0.0, 0.02, 0.0))
    assert world.com_frame(duck)[0] == pytest.approx((0.1, 0.22, 0.3))


def test_importing_the_world_prints_nothing():
    code = "import grasp_factory.simulation.world as w; w.World().close()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")


@pytest.mark.parametrize("folder", ["plain", "jos\u00e9", "\u684c\u5b50"])
def test_a_mesh_is_loaded_from_a_folder_of_any_name(world, tmp_path, folder):
    place = tmp_path / folder
    place.mkdir()
    shipped = Path(next(p for p in BOTTLE.body.parts if p.shape.endswith(".obj")).shape)
    mesh = place / "mesh.obj"
    mesh.write_bytes(shipped.read_bytes())
    part = Part(shape=str(mesh), size=(0.1, 0.1, 0.1))
    body = Compound(parts=(part,), gyration_squared=(1e-3, 1e-3, 1e-3))
    created = world.add_compound(body, IDENTITY, mass=0.1)
    lower, upper = world.bounds(created)
    assert np.ptp([lower, upper], axis=0) == pytest.approx([0.1] * 3, abs=0.01)


def test_a_body_of_more_parts_than_the_engine_survives_is_refused(world):
    part = Part(shape="box", size=(0.1, 0.1, 0.1))
    body = Compound(parts=(part,) * (MAX_PARTS + 1), gyration_squared=(1e-3, 1e-3, 1e-3))
    with pytest.raises(RecipeError, match="17 parts, valid: 1 to 16"):
        world.add_compound(body, IDENTITY, mass=0.1)


def test_a_body_whose_mesh_is_gone_is_refused(world, tmp_path):
    part = Part(shape=str(tmp_path / "gone.obj"), size=(1.0, 1.0, 1.0))
    body = Compound(parts=(part,), gyration_squared=(1e-3, 1e-3, 1e-3))
    with pytest.raises(RecipeError):
        world.add_compound(body, IDENTITY, mass=0.1)
