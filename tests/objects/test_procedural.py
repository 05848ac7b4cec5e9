from __future__ import annotations

import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pytest

from grasp_factory.core.camera import Camera, Intrinsics, Light, deproject, zbuffer_to_depth
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.geometry import IDENTITY, Array, Pose, apply, inverse, look_at
from grasp_factory.errors import UnknownNameError
from grasp_factory.objects import Compound, ObjectModel, Part, visual_parts
from grasp_factory.objects.base import PRIMITIVES
from grasp_factory.objects.make_unit_meshes import unit_meshes
from grasp_factory.objects.obj_file import triangles
from grasp_factory.objects.procedural import FAMILIES, PROCEDURAL, generator
from grasp_factory.objects.unit_meshes import ASSETS, mesh_file
from grasp_factory.simulation.world import World

MESHES = unit_meshes()
SETTLE_S = 3.0
REST_S = 0.25
REST_WAY = 0.0005
"""Metres that a corner of the bounding box of what rests may move in ``REST_S``."""
PROBE_RADIUS = 0.001
PROBE_AT = 0.003
"""Metres before a surface."""
BALL = Compound(
    parts=(Part(shape="sphere", size=(2 * PROBE_RADIUS,) * 3),), gyration_squared=(1.0, 1.0, 1.0)
)
families = pytest.mark.parametrize("family", FAMILIES)


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World() as world:
        yield world


def some(count: int, seed: int = 0) -> list[ObjectModel]:
    rng = np.random.default_rng(seed)
    return [PROCEDURAL.draw(rng) for _ in range(count)]


def body_of(model: ObjectModel) -> Compound:
    assert isinstance(model.body, Compound)
    return model.body


def drop(world: World, model: ObjectModel, rng: np.random.Generator) -> tuple[int, int]:
    """Build a world of a plane and an object above it, turned at random; return both bodies."""
    physics = PhysicsConfig()
    world.reset(physics)
    plane = world.add_box((1.0, 1.0, 0.05), (0.0, 0.0, -0.05), (0.5, 0.5, 0.5, 1.0))
    world.change_dynamics(plane, -1, lateralFriction=1.0, rollingFriction=0.001)
    quat = rng.normal(size=4)
    x, y, z, w = (float(q) for q in quat / np.linalg.norm(quat))
    turned = Pose((0.0, 0.0, 0.0), (x, y, z, w))
    height = 0.01 - float(apply(turned.matrix(), model.corners())[:, 2].min())
    pose = Pose((0.0, 0.0, height), turned.quat_xyzw)
    body = world.add_compound(body_of(model), pose, mass=model.mass)
    world.change_dynamics(
        body, -1, lateralFriction=model.lateral_friction, spinningFriction=0.0, rollingFriction=0.0
    )
    return plane, body


def comes_to_rest(world: World, model: ObjectModel, body: int) -> bool:
    """Step until no corner of the bounding box moves any more, or time is up."""
    steps = round(REST_S * PhysicsConfig().free_hz)
    before = world_corners(world, model, body)
    for _ in range(round(SETTLE_S / REST_S)):
        for _ in range(steps):
            world.step()
        after = world_corners(world, model, body)
        assert np.isfinite(after).all()
        if np.linalg.norm(after - before, axis=1).max() < REST_WAY:
            return True
        before = after
    return False


def world_from_own(world: World, model: ObjectModel, body: int) -> Array:
    """Return the pose (4, 4) of an object's own frame."""
    T_world_com = Pose(*world.com_frame(body)).matrix()
    return np.asarray(T_world_com @ inverse(body_of(model).inertial_frame.matrix()))


def world_corners(world: World, model: ObjectModel, body: int) -> Array:
    return apply(world_from_own(world, model, body), model.corners())


def lowest(world: World, model: ObjectModel, body: int) -> float:
    """Return the lowest point of the parts' surface as it is seen, metres above the plane."""
    T_world_own = world_from_own(world, model, body)
    vertices = (
        apply(
            T_world_own @ part.pose.matrix(), triangles(Path(part.shape)).reshape(-1, 3) * part.size
        )
        for part in visual_parts(body_of(model))
    )
    return min(float(points[:, 2].min()) for points in vertices)


class TestIds:
    def test_the_same_id_is_the_same_object_for_ever(self) -> None:
        """Pinned: when this fails, raise GENERATOR, for ids of old datasets lose their objects."""
        pins = {
            "procedural/box/0": (0.05153492, 0.05353898, 0.04726185, 0.02998632, 0.766907),
            "procedural/mug/1": (0.08385803, 0.05503299, 0.08922086, 0.1630187, 0.4047211),
            "procedural/hammer/2147483647": (
                0.09769666,
                0.08968098,
                0.02476362,
                0.04921856,
                0.5770478,
            ),
        }
        for object_id, expected in pins.items():
            model = PROCEDURAL.model(object_id)
            values = (*np.ptp(model.corners(), axis=0), model.mass, model.lateral_friction)
            np.testing.assert_allclose(values, expected, rtol=1e-6)

    def test_another_version_of_the_generator_makes_other_objects(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        ours = PROCEDURAL.model("procedural/box/0")
        monkeypatch.setattr(generator, "GENERATOR", generator.GENERATOR + 1)
        assert PROCEDURAL.model("procedural/box/0") != ours

    @families
    def test_every_number_is_another_object(self, family: str) -> None:
        models = [PROCEDURAL.model(f"procedural/{family}/{number}") for number in range(50)]
        assert len({(m.lower, m.upper) for m in models}) == 50
        assert len({m.color for m in models}) == 50

    def test_families_do_not_share_their_draws(self) -> None:
        colors = {PROCEDURAL.model(f"procedural/{family}/0").color for family in FAMILIES}
        assert len(colors) == len(FAMILIES)

    @pytest.mark.parametrize(
        "number",
        [
            "",
            "-1",
            "+1",
            "01",
            " 1",
            "1 ",
            "1.0",
            "1e3",
            "2147483648",
            "9" * 5000,
            "x",
            "1/2",
            "\uff11",
        ],
    )
    def test_a_number_that_is_none_is_refused(self, number: str) -> None:
        with pytest.raises(UnknownNameError, match=r"valid: procedural/<family>/<number from 0"):
            PROCEDURAL.model(f"procedural/box/{number}")

    def test_an_unknown_family_is_refused_with_the_nearest(self) -> None:
        with pytest.raises(UnknownNameError, match=r"'hamer'; did you mean 'hammer'\? \(valid: "):
            PROCEDURAL.model("procedural/hamer/1")

    def test_families_are_drawn_evenly(self) -> None:
        rng = np.random.default_rng(0)
        counts = Counter(PROCEDURAL.draw(rng).family for _ in range(1900))
        assert len(counts) == len(FAMILIES) >= 12
        assert min(counts.values()) > 60
        assert max(counts.values()) < 150


class TestModels:
    def test_masses_and_frictions_are_within_their_ranges(self) -> None:
        for model in some(300):
            assert 0.02 <= model.mass <= 0.5
            assert 0.3 <= model.lateral_friction <= 0.8

    def test_masses_spread_over_the_range(self) -> None:
        masses = np.array([model.mass for model in some(300)])
        assert np.quantile(masses, 0.9) > 0.15
        assert np.quantile(masses, 0.1) < 0.03

    @families
    def test_no_object_is_longer_than_two_hands(self, family: str) -> None:
        for number in range(100):
            sides = np.ptp(PROCEDURAL.model(f"procedural/{family}/{number}").corners(), axis=0)
            assert sides.max() <= 0.2

    def test_making_a_model_takes_less_than_three_milliseconds(self) -> None:
        some(50)
        start = time.process_time()  # a busy machine does not count
        some(100)
        assert (time.process_time() - start) / 100 < 0.003

    def test_everything_that_is_seen_is_a_mesh_file(self) -> None:
        for model in some(200):
            assert all(Path(part.shape).is_file() for part in visual_parts(body_of(model)))


class TestUnitMeshes:
    def test_the_files_are_what_the_module_makes(self) -> None:
        files = {path.stem: path.read_text(encoding="ascii") for path in ASSETS.glob("*")}
        assert files == MESHES

    def test_every_file_is_used(self) -> None:
        used = {part.shape for m in some(2000) for part in visual_parts(body_of(m))}
        assert used == {mesh_file(name) for name in MESHES}

    @pytest.mark.parametrize("name", MESHES)
    def test_the_bounding_box_is_the_unit_box_at_the_origin(self, name: str) -> None:
        points = triangles(Path(mesh_file(name))).reshape(-1, 3)
        np.testing.assert_array_equal(points.min(axis=0), [-0.5] * 3)
        np.testing.assert_array_equal(points.max(axis=0), [0.5] * 3)

    @pytest.mark.parametrize("name", MESHES)
    def test_every_group_is_closed_convex_and_looks_outwards(self, name: str) -> None:
        groups = MESHES[name].split("\no ")[1:]
        assert 1 <= len(groups) <= 16
        lines = MESHES[name].splitlines()
        vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
        for group in groups:
            rows = [line.split()[1:] for line in group.splitlines() if line.startswith("f ")]
            faces = [[int(word.split("/")[0]) - 1 for word in row] for row in rows]
            edges = {
                (a, b) for face in faces for a, b in zip(face, face[1:] + face[:1], strict=True)
            }
            assert edges == {(b, a) for a, b in edges}
            used = vertices[sorted({i for face in faces for i in face})]
            for a, b, c in (vertices[face[:3]] for face in faces):
                normal = np.cross(b - a, c - a)
                assert ((used - a) @ normal / np.linalg.norm(normal)).max() < 1e-6

    @pytest.mark.parametrize("name", MESHES)
    def test_normals_look_outwards_and_textures_cover_the_unit_square(self, name: str) -> None:
        rows = [line.split() for line in MESHES[name].splitlines()]
        v, vt, vn = (
            np.array([row[1:] for row in rows if row[0] == kind], float)
            for kind in ("v", "vt", "vn")
        )
        np.testing.assert_allclose(np.linalg.norm(vn, axis=1), 1.0, atol=1e-6)
        assert vt.min() == 0.0
        assert vt.max() == 1.0
        for row in (row[1:] for row in rows if row[0] == "f"):
            corners = np.array([word.split("/") for word in row], int) - 1
            a, b, c = v[corners[:3, 0]]
            assert (vn[corners[:, 2]] @ np.cross(b - a, c - a) > 0.0).all()


class TestEngine:
    @pytest.mark.slow
    @families
    def test_what_is_seen_is_what_collides(self, world: World, family: str) -> None:
        """Within the 0.2 mm that chords lie inside a circle, but for Bullet's margin on hulls."""
        for number in range(2):
            model = PROCEDURAL.model(f"procedural/{family}/{number}")
            world.reset(PhysicsConfig())
            body = world.add_compound(body_of(model), IDENTITY, mass=0.0)
            shapes = {part.shape for part in body_of(model).parts}
            margin = 0.0 if shapes <= set(PRIMITIVES) else 0.001
            for direction in ((0.25, -0.3, 0.3), (-0.3, 0.2, -0.3)):
                gaps = surface_gaps(world, body, np.array(direction))
                assert len(gaps) >= 50
                assert np.quantile(gaps, 0.05) > -0.0001
                assert np.quantile(gaps, 0.95) < margin + 0.0003, model.object_id

    def test_objects_come_to_rest_on_a_plane_and_are_seen(self, world: World) -> None:
        rng = np.random.default_rng(1)
        models = [PROCEDURAL.model(f"procedural/{f}/{n}") for f in FAMILIES for n in range(4)]
        settled = [comes_to_rest_and_is_seen(world, model, rng) for model in models]
        assert np.mean(settled) > 0.9

    @pytest.mark.soak
    def test_two_thousand_objects_come_to_rest_on_a_plane_and_are_seen(self, world: World) -> None:
        rng = np.random.default_rng(2)
        settled = [comes_to_rest_and_is_seen(world, model, rng) for model in some(2000, seed=2)]
        assert np.mean(settled) > 0.97

    @pytest.mark.soak
    @pytest.mark.slow
    def test_two_thousand_new_objects_leave_no_memory_behind(self) -> None:
        """In a process of its own, whose memory nothing else touches."""
        done = subprocess.run(
            [sys.executable, "-c", MEMORY_CODE], capture_output=True, text=True, check=True
        )
        assert float(done.stdout) < 25.0


def comes_to_rest_and_is_seen(world: World, model: ObjectModel, rng: np.random.Generator) -> bool:
    """Drop an object; fail if it is not seen or falls through, return whether it rests on top.

    At 240 Hz one light hull in some hundred falls into a cycle: it rocks at 5 rad/s, a few
    millimetres deep, and would come out of it at 960 Hz.
    """
    _, body = drop(world, model, rng)
    settled = comes_to_rest(world, model, body)
    depth = -lowest(world, model, body)
    assert depth < 0.005, model.object_id
    _, _, mask = world.render(camera_on(world, body, np.array((0.0, -0.7, 0.7)), (64, 48)), Light())
    assert (mask >= 0).all()
    assert ((mask & 0xFFFFFF) == body).sum() > 50, model.object_id
    return settled and depth < 0.001


def camera_on(world: World, body: int, direction: Array, size: tuple[int, int]) -> Camera:
    """Return a camera half a metre away that is filled by a body."""
    lower, upper = np.array(pybullet.getAABB(body, physicsClientId=world._client))
    middle, radius = (lower + upper) / 2.0, float(np.linalg.norm(upper - lower)) / 2.0
    eye = middle + 0.5 * direction / np.linalg.norm(direction)
    intrinsics = Intrinsics.from_fov(*size, 2.0 * float(np.arctan(radius / 0.5)))
    return Camera("close", intrinsics, look_at(eye, middle), 0.05, 2.0)


def surface_gaps(world: World, body: int, direction: Array) -> Array:
    """Return how far (n,) the shape that collides stands out over points that are seen, metres.

    A small ball near each point measures it, because rays stop up to 1 mm early (the radius in
    btGjkConvexCast). They do tell the way that a surface looks, and where the pixels are next to
    an outline or an edge, which are left out.
    """
    client = world._client
    camera = camera_on(world, body, direction, (120, 120))
    view = camera.T_world_camera
    _, zbuffer, mask = world.render(camera, Light())
    depth = zbuffer_to_depth(zbuffer.astype(np.float64), camera.near, camera.far)
    points = apply(view, deproject(depth, camera.intrinsics.matrix()).reshape(-1, 3))
    origin = view[:3, 3]
    beyond = origin + 1.5 * (points - origin)
    rays = pybullet.rayTestBatch(
        [origin.tolist()] * len(points), beyond.tolist(), physicsClientId=client
    )
    hit = np.array([row[0] == body for row in rays]).reshape(mask.shape) & (mask >= 0)
    normals = np.array([row[4] for row in rays]).reshape(*mask.shape, 3)
    smooth = hit.copy()
    for axis in (0, 1):
        for step in (-2, -1, 1, 2):
            along = (np.roll(normals, step, axis) * normals).sum(axis=-1)
            smooth &= np.roll(hit, step, axis) & (along > 0.9)
    ball = world.add_compound(BALL, IDENTITY, mass=0.0)
    gaps = []
    for i in np.flatnonzero(smooth)[:: max(1, int(smooth.sum()) // 50)]:
        at = points[i] + PROBE_AT * normals.reshape(-1, 3)[i]
        pybullet.resetBasePositionAndOrientation(
            ball, at.tolist(), IDENTITY.quat_xyzw, physicsClientId=client
        )
        near = pybullet.getClosestPoints(ball, body, 0.05, physicsClientId=client)
        gaps.append(PROBE_AT - PROBE_RADIUS - min(row[8] for row in near))
    return np.array(gaps)


MEMORY_CODE = """
import os
import numpy as np
from grasp_factory.core.camera import Camera, Intrinsics, Light
from grasp_factory.core.geometry import IDENTITY, look_at
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.simulation.world import World

def memory():
    pages = int(open("/proc/self/statm").read().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

rng = np.random.default_rng(3)
camera = Camera("c", Intrinsics.from_fov(64, 48, 0.5), look_at((0, -.3, .3), (0, 0, 0)), .05, 2)
with World() as world:
    for i in range(2100):
        if i == 100:
            before = memory()
        world.reset(PhysicsConfig())
        world.add_box((1, 1, .05), (0, 0, -.25), (1, 1, 1, 1))
        model = OBJECT_SETS["procedural"].draw(rng)
        world.add_compound(model.body, IDENTITY, mass=model.mass)
        for _ in range(10):
            world.step()
        world.render(camera, Light())
print(memory() - before)
"""
