from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from support import nasty_meshes

from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.geometry import Array
from grasp_factory.objects.base import MAX_HULLS
from grasp_factory.objects.folder_archive import pack_folder, unpack_folder
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.convert import convert
from grasp_factory.objects.importing.hulls import MAX_CORNERS, convex_parts, reduced
from grasp_factory.objects.importing.mesh_reader import read_mesh
from grasp_factory.objects.importing.messages import Converted, Job, Shape
from grasp_factory.objects.importing.point_groups import joined
from grasp_factory.objects.importing.solid_mesh import (
    MAX_FACES,
    closed_bodies,
    tidied,
    without_dust,
)
from grasp_factory.objects.importing.units import guess_scale, sides
from grasp_factory.objects.obj_file import triangles

pytestmark = pytest.mark.slow

SHAPES = nasty_meshes.shapes()


def tidy(name: str) -> trimesh.Trimesh:
    return tidied(*SHAPES[name])[0]


def converted(
    vertices: Array, faces: NDArray[np.int64], kind: str = "obj"
) -> tuple[Converted, dict[str, bytes]]:
    shape = Shape(kind=kind, size=(1.0, 1.0, 1.0), blob=0)
    return convert(Job(collision=(shape,)), [nasty_meshes.encode(kind, vertices, faces)])


class TestHulls:
    def test_a_convex_mesh_is_one_hull_with_its_volume_and_few_corners(self) -> None:
        mesh = tidy("ball")
        (hull,), is_closed = convex_parts(mesh, MAX_HULLS, [])
        assert is_closed
        assert MAX_CORNERS <= len(hull.vertices) <= 2 * MAX_CORNERS < len(mesh.vertices)
        assert hull.volume == pytest.approx(mesh.volume, rel=0.01)

    def test_a_box_keeps_its_corners(self) -> None:
        (hull,), _ = convex_parts(tidy("box"), MAX_HULLS, [])
        assert sorted(hull.points[hull.vertices].tolist()) == pytest.approx(
            np.array(sorted(SHAPES["box"][0].tolist()))
        )

    def test_a_ring_keeps_its_hole(self) -> None:
        mesh = tidy("ring")
        hulls, _ = convex_parts(mesh, MAX_HULLS, [])
        assert 6 <= len(hulls) <= MAX_HULLS
        for hull in hulls:
            assert (hull.equations[:, 3] > 0.012).any()  # the middle lies that far outside
        assert sum(hull.volume for hull in hulls) == pytest.approx(mesh.volume, rel=0.15)

    @pytest.mark.soak
    def test_a_bowl_keeps_its_hollow(self) -> None:
        vertices, faces = SHAPES["ball"]
        below = vertices[faces].mean(axis=1)[:, 2] < 0.005
        hulls, is_closed = convex_parts(tidied(vertices, faces[below])[0], MAX_HULLS, [])
        assert not is_closed
        for hull in hulls:
            assert (hull.equations[:, 3] > 0.005).any()

    def test_two_runs_give_the_same_hulls(self) -> None:
        ring = SHAPES["ring"]
        assert converted(*ring) == converted(*ring)

    def test_what_is_flat_has_no_hull(self) -> None:
        vertices, faces = SHAPES["box"]
        with pytest.raises(UnusableError, match="it is flat"):
            converted(vertices * [1.0, 1.0, 0.0], faces)


def parts_of(vertices: Array, faces: NDArray[np.int64]) -> tuple[int, tuple[str, ...]]:
    found, _ = converted(vertices, faces)
    return found.geometry.hulls, found.warnings


class TestBoundedWork:
    @pytest.mark.timeout(60)
    def test_random_triangles_are_coarse_hulls_at_once(self) -> None:
        rng = np.random.default_rng(5)
        centers = rng.uniform(-0.03, 0.03, (200, 1, 3))
        vertices = (centers + rng.normal(0.0, 0.01, (200, 3, 3))).reshape(-1, 3)
        parts, warnings = parts_of(vertices, np.arange(600).reshape(-1, 3))
        assert 1 <= parts <= MAX_HULLS
        assert "it falls into many pieces, and collides as convex hulls of these" in warnings

    @pytest.mark.soak
    @pytest.mark.timeout(60)
    def test_a_crumpled_mesh_collides_coarsely(self) -> None:
        x, y = (v.reshape(-1) for v in np.meshgrid(*[np.linspace(-0.03, 0.03, 60)] * 2))
        z = np.sin(x * 600.0) * np.sin(y * 600.0) * 0.01
        i = np.arange(59 * 60).reshape(59, 60)[:, :-1].reshape(-1)
        faces = np.vstack([np.stack([i, i + 1, i + 60], 1), np.stack([i + 1, i + 61, i + 60], 1)])
        parts, warnings = parts_of(np.column_stack([x, y, z]), faces)
        assert 1 <= parts <= MAX_HULLS
        assert "it is crumpled, and collides more coarsely than it looks" in warnings

    def test_many_bodies_are_put_together(self) -> None:
        vertices, faces = SHAPES["box"]
        steps = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), -1).reshape(-1, 1, 3)
        many = (vertices * 0.2 + steps * 0.03).reshape(-1, 3)
        offsets = np.arange(125)[:, None, None] * len(vertices)
        parts, warnings = parts_of(many, (faces + offsets).reshape(-1, 3))
        assert 32 <= parts <= MAX_HULLS
        assert "it falls into many pieces, and collides as convex hulls of these" in warnings

    def test_more_pieces_than_can_be_put_together_are_refused(self) -> None:
        groups = [np.full((1, 3), float(i)) for i in range(1001)]
        with pytest.raises(UnusableError, match="falls into 1001 separate pieces"):
            joined(groups, 64)

    def test_those_next_to_each_other_are_put_together(self) -> None:
        groups = [np.full((1, 3), x) for x in (0.0, 5.0, 0.1, 5.2)]
        assert sorted(len(group) for group in joined(groups, 2)) == [2, 2]
        assert joined(groups, 2)[0][:, 0].tolist() == [0.0, 0.1]

    def test_what_floats_beside_a_scan_does_not_make_it_coarse(self) -> None:
        ring, dust = tidy("ring"), trimesh.creation.box((5e-4,) * 3)
        dust.apply_translation((0.0, 0.0, 0.012))
        assert len(without_dust(trimesh.util.concatenate([ring, dust])).faces) == len(ring.faces)


class TestCloseness:
    def test_a_long_rod_does_not_get_longer(self) -> None:
        rod = trimesh.creation.cylinder(0.01, 0.9, sections=200)
        hull = reduced(np.asarray(rod.vertices))
        assert hull is not None
        assert np.abs(np.ptp(hull.points, axis=0) - rod.extents).max() < 1e-3

    @pytest.mark.parametrize("sides", [(0.02, 0.02, 0.9), (0.06, 0.06, 0.06), (0.1, 0.15, 0.2)])
    def test_a_hull_of_few_corners_is_close_in_every_direction(
        self, sides: tuple[float, float, float]
    ) -> None:
        points = np.asarray(trimesh.creation.icosphere(4, 0.5).vertices) * sides
        hull = reduced(points)
        assert hull is not None
        normals = np.asarray(trimesh.creation.icosphere(3).vertices)
        differ = (hull.points @ normals.T).max(axis=0) - (points @ normals.T).max(axis=0)
        assert np.abs(differ).max() < max(1e-3, 0.02 * min(sides))

    def test_a_body_in_the_hole_of_another_is_no_cavity(self) -> None:
        ring, ball = trimesh.creation.torus(0.03, 0.01), trimesh.creation.icosphere(2, 0.008)
        ball.invert()
        assert len(closed_bodies(trimesh.util.concatenate([ring, ball]))) == 2
        within = ball.copy()
        within.apply_translation((0.03, 0.0, 0.0))
        assert len(closed_bodies(trimesh.util.concatenate([ring, within]))) == 1


class TestMassProperties:
    def test_a_cavity_is_not_a_body_and_has_no_mass(self) -> None:
        change = nasty_meshes.CHANGES["hollow"]
        hollow, _ = tidied(*change(SHAPES["ball"], np.random.default_rng(0)))
        assert len(closed_bodies(hollow)) == 1
        assert hollow.volume == pytest.approx(tidy("ball").volume * 7 / 8)

    def test_separate_bodies_are_each_turned_outwards(self) -> None:
        vertices, faces = SHAPES["box"]
        both = np.vstack([faces, faces[:, ::-1] + len(vertices)])
        mesh, _ = tidied(np.vstack([vertices, vertices + 0.1]), both)
        assert len(closed_bodies(mesh)) == 2
        assert mesh.volume == pytest.approx(2 * 0.03 * 0.05 * 0.07)

    def test_the_inertia_of_a_rod_is_that_of_its_prism(self) -> None:
        found, _ = converted(*SHAPES["rod"])
        long, short = 0.12**2 / 12, 0.01**2 / 4
        squares = sorted(found.geometry.gyration_squared)
        assert squares == pytest.approx([2 * short, long + short, long + short], rel=0.02)

    def test_a_hundred_thousand_triangles_keep_their_volume(self) -> None:
        surface = read_mesh("stl", nasty_meshes.many_triangles(100_000))
        mesh, _ = tidied(surface.vertices, surface.faces)
        assert len(mesh.faces) <= MAX_FACES
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(2 * np.pi**2 * 0.03 * 0.012**2, rel=0.01)


class TestFiles:
    def test_the_files_of_a_conversion_are_those_that_archives_take(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from grasp_factory.objects.importing import import_folder

        (tmp_path / "ring.stl").write_bytes(nasty_meshes.encode("stl", *SHAPES["ring"]))
        monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
        report = import_folder(tmp_path, "mine", 0.11)
        packed = pack_folder(report.sha256)
        monkeypatch.setenv(VARIABLE, str(tmp_path / "another"))
        assert unpack_folder(packed) == report.sha256

    def test_hulls_are_turned_outwards(self, tmp_path: Path) -> None:
        found, files = converted(*SHAPES["rock"])
        path = tmp_path / "rock.obj"
        path.write_bytes(files[found.geometry.collision])
        volume = np.linalg.det(triangles(path)).sum() / 6.0
        assert volume == pytest.approx(found.volume, rel=1e-4)

    def test_what_is_seen_has_unit_normals_and_textures_within_the_picture(self) -> None:
        found, files = converted(*SHAPES["cone"])
        rows = [line.split() for line in files[found.geometry.visual].decode().splitlines()]
        values = {
            kind: np.array([row[1:] for row in rows if row[0] == kind], np.float64)
            for kind in ("vt", "vn")
        }
        assert np.linalg.norm(values["vn"], axis=1) == pytest.approx(1.0, abs=1e-3)
        assert values["vt"].min() >= 0.0
        assert values["vt"].max() <= 1.0

    def test_colors_of_the_vertices_are_averaged(self) -> None:
        vertices, faces = SHAPES["box"]
        lines = nasty_meshes.encode("obj", vertices, faces).decode().splitlines()
        text = "\n".join(line + (" 1 0.5 0" if line[0] == "v" else "") for line in lines)
        assert read_mesh("obj", text.encode()).color == (1.0, 0.5, 0.0)


class TestUnits:
    @pytest.mark.parametrize(
        ("largest", "scale"), [(0.01, 1.0), (0.3, 1.0), (1.0, 1.0), (20.0, 1e-3), (1000.0, 1e-3)]
    )
    def test_likely_sizes_have_a_unit(self, largest: float, scale: float) -> None:
        assert guess_scale(largest)[0] == scale

    @pytest.mark.parametrize("largest", [0.0, 0.009, 1.1, 5.0, 19.0, 1001.0, 1e12])
    def test_other_sizes_have_none(self, largest: float) -> None:
        with pytest.raises(UnusableError, match=r"give its scale in objects\.yaml"):
            guess_scale(largest)

    def test_the_sides_of_a_box_are_its_sides(self) -> None:
        normals = np.vstack([np.eye(3), -np.eye(3)])
        assert sides(SHAPES["box"][0], normals) == pytest.approx((0.03, 0.05, 0.07))
