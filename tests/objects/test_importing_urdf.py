from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import nasty_meshes
from support.conversion import convert_here

from grasp_factory.core.cache import VARIABLE
from grasp_factory.objects.base import Compound, ObjectModel
from grasp_factory.objects.folder import load_folder
from grasp_factory.objects.importing import FolderReport, import_folder, object_source
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.folder_listing import list_files, read_inside
from grasp_factory.objects.importing.object_source import load_source
from grasp_factory.objects.importing.references import mesh_file
from grasp_factory.objects.importing.settings import Settings
from grasp_factory.objects.importing.urdf import parse_urdf

pytestmark = pytest.mark.slow

BOX = '<collision><geometry><box size="0.03 0.04 0.06"/></geometry></collision>'
MESH = nasty_meshes.encode("obj", *nasty_meshes.shapes()["ring"])


@pytest.fixture
def real_child() -> None:
    """Ask for conversions in a child process, as a user has them."""


@pytest.fixture(autouse=True)
def quick(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "real_child" not in request.fixturenames:
        convert_here(monkeypatch)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    path = tmp_path / "folder"
    (path / "meshes").mkdir(parents=True)
    return path


def urdf(*inside: str, more: str = "") -> bytes:
    return f'<robot name="r"><link name="a">{"".join(inside)}</link>{more}</robot>'.encode()


def mesh(filename: str, more: str = "") -> str:
    return f'<collision><geometry><mesh filename="{filename}"{more}/></geometry></collision>'


def imported(folder: Path, data: bytes) -> FolderReport:
    (folder / "thing.urdf").write_bytes(data)
    return import_folder(folder, "mine", 0.11)


def model(report: FolderReport) -> ObjectModel:
    assert report.refused == ()
    return load_folder("mine", report.sha256).model("mine/thing")


def compound(report: FolderReport) -> Compound:
    body = model(report).body
    assert isinstance(body, Compound)
    return body


class TestShapes:
    @pytest.mark.usefixtures("real_child")
    def test_primitives_stay_what_they_are(self, folder: Path) -> None:
        capsule = (
            '<collision><origin xyz="0 0 0.05" rpy="0 1.5707963267948966 0"/><geometry>'
            '<capsule radius="0.01" length="0.03"/></geometry></collision>'
        )
        thing = model(imported(folder, urdf(BOX, capsule)))
        body = thing.body
        assert isinstance(body, Compound)
        assert [part.shape for part in body.parts] == ["box", "capsule"]
        assert body.parts[1].size == pytest.approx((0.02, 0.02, 0.05))
        assert thing.upper == pytest.approx((0.025, 0.02, 0.06))
        assert body.visual == ()

    @pytest.mark.usefixtures("real_child")
    def test_a_mesh_is_found_beside_the_urdf_and_is_no_object_of_its_own(
        self, folder: Path
    ) -> None:
        (folder / "meshes/ring.obj").write_bytes(MESH)
        report = imported(folder, urdf(mesh("meshes/ring.obj", ' scale="2 2 2"')))
        assert [item.object_id for item in report.usable] == ["mine/thing"]
        assert max(model(report).upper) == pytest.approx(0.08, rel=1e-3)

    @pytest.mark.parametrize(
        "name", ["package://any/meshes/ring.obj", "package://meshes/ring.obj", "./x/../ring.obj"]
    )
    def test_a_package_is_a_folder_or_the_root(self, folder: Path, name: str) -> None:
        (folder / ("ring.obj" if "x" in name else "meshes/ring.obj")).write_bytes(MESH)
        assert imported(folder, urdf(mesh(name))).refused == ()

    def test_a_mesh_and_the_urdf_around_it_are_in_one_split(self, folder: Path) -> None:
        (folder / "meshes/ring.obj").write_bytes(MESH)
        (folder / "copy.obj").write_bytes(MESH)
        report = imported(folder, urdf(mesh("meshes/ring.obj")))
        models = load_folder("mine", report.sha256).models
        assert models["mine/copy"].split_by == models["mine/thing"].split_by

    def test_links_that_are_fixed_together_are_one_body(self, folder: Path) -> None:
        more = (
            f'<link name="b">{BOX}</link><joint name="j" type="fixed"><parent link="a"/>'
            '<child link="b"/><origin xyz="0.03 0 0"/></joint>'
        )
        body = compound(imported(folder, urdf(BOX, more=more)))
        assert [part.pose.position[0] for part in body.parts] == pytest.approx([0.0, 0.03])
        assert body.inertial_frame.position == pytest.approx((0.015, 0.0, 0.0))

    def test_what_is_seen_is_the_visual_mesh(self, folder: Path) -> None:
        (folder / "meshes/ring.obj").write_bytes(MESH)
        seen = mesh("meshes/ring.obj").replace("collision", "visual")
        body = compound(imported(folder, urdf(BOX, seen)))
        assert len(body.visual) == 1
        assert len(Path(body.visual[0].shape).read_text().split("\nf ")) > 100

    @pytest.mark.parametrize("name", ["meshes/bad.obj", "../absent.obj", "absent.obj", "seen.dae"])
    def test_a_visual_mesh_that_cannot_be_read_is_done_without(
        self, folder: Path, name: str
    ) -> None:
        if "bad" in name:
            (folder / name).write_bytes(b"no mesh")
        report = imported(folder, urdf(BOX, mesh(name).replace("collision", "visual")))
        assert compound(report).visual == ()
        assert "seen as it collides, for its" in report.usable[0].warnings[0]


class TestPhysics:
    def test_mass_friction_and_color_are_those_of_the_file(self, folder: Path) -> None:
        seen = (
            '<visual><geometry><box size="0.03 0.04 0.06"/></geometry>'
            '<material name="m"><color rgba="0.1 0.2 0.3 1"/></material></visual>'
        )
        inertial = '<inertial><mass value="0.3"/></inertial>'
        contact = '<contact><lateral_friction value="0.7"/></contact>'
        thing = model(imported(folder, urdf(BOX, seen, inertial, contact)))
        assert (thing.mass, thing.lateral_friction, thing.color) == (0.3, 0.7, (0.1, 0.2, 0.3))

    def test_an_inertia_that_can_be_is_taken_over(self, folder: Path) -> None:
        inertial = (
            '<inertial><origin xyz="0 0 0.01"/><mass value="0.2"/>'
            '<inertia ixx="8e-5" iyy="7e-5" izz="4e-5" ixy="0" ixz="0" iyz="0"/></inertial>'
        )
        body = compound(imported(folder, urdf(BOX, inertial)))
        assert body.inertial_frame.position == (0.0, 0.0, 0.01)
        assert body.gyration_squared == pytest.approx((4e-4, 3.5e-4, 2e-4))

    @pytest.mark.parametrize(
        "inertia",
        [
            'ixx="1" iyy="1" izz="1"',  # pybullet_data's placeholder
            'ixx="1e-5" iyy="1e-5" izz="9e-5"',
            'ixx="0" iyy="0" izz="0"',
            'ixx="-1e-5" iyy="1e-5" izz="1e-5"',
        ],
    )
    def test_an_inertia_that_cannot_be_is_computed_with_a_warning(
        self, folder: Path, inertia: str
    ) -> None:
        text = f'<inertial><mass value="0.2"/><inertia {inertia}/></inertial>'
        report = imported(folder, urdf(BOX, text))
        assert "computed instead" in report.usable[0].warnings[0]
        squares = np.array([0.03, 0.04, 0.06]) ** 2 / 12.0
        assert compound(report).gyration_squared == pytest.approx(squares.sum() - squares)

    @pytest.mark.parametrize("mass", ["0", "-1", "700"])
    def test_a_mass_that_cannot_be_is_left_aside(self, folder: Path, mass: str) -> None:
        inertial = f'<inertial><mass value="{mass}"/></inertial>'
        assert model(imported(folder, urdf(BOX, inertial))).mass == pytest.approx(0.036)


class TestRefusals:
    @pytest.mark.parametrize(
        ("data", "reason"),
        [
            (b"<robot", "it is no XML"),
            (b"\xff\xfe<\x00r\x00", "it is not UTF-8 text"),
            (b"<sdf/>", "its outermost element is 'sdf'"),
            (b"<robot/>", "it has no link"),
            (urdf(), "it has no shapes"),
            (urdf(mesh("a.dae")), "its mesh 'a.dae' is no obj, stl, ply file"),
            (urdf(mesh("absent.obj")), "its mesh 'absent.obj' is not in the folder"),
            (urdf(BOX.replace("0.03 0.04", "0.03")), "its box has size '0.03 0.06', valid: 3"),
            (urdf(BOX.replace("0.03", "nan")), "its box has size 'nan 0.04 0.06'"),
            (urdf(BOX.replace("0.03", "${x}")), "its box has size '${x} 0.04 0.06'"),
            (urdf(BOX.replace("0.03", "-1")), "it has a box of the size"),
            (urdf(BOX.replace("box", "blob")), "it has a shape 'blob', valid: box"),
            (urdf(BOX * 16), "it has more than 15 primitive shapes"),
            (urdf(BOX * 300), "it has more than 256 elements collision"),
            (urdf(BOX, more='<joint type="revolute"/>'), "a joint that moves ('revolute')"),
            (urdf(BOX, more='<link name="b"/>'), "it has 2 bodies that no joint holds"),
            (urdf(BOX, more='<link name="a"/>'), "a link without a name of its own: 'a'"),
            (b'<!DOCTYPE r [<!ENTITY a "b">]><robot>&a;</robot>', "it declares a document type"),
            (b"<a>" * 100_000, "it is no XML"),
        ],
    )
    def test_a_urdf_that_cannot_be_used_says_why(
        self, folder: Path, data: bytes, reason: str
    ) -> None:
        report = imported(folder, data)
        assert report.usable == ()
        assert reason in report.refused[0].reason

    def test_joints_in_a_circle_are_refused(self) -> None:
        joint = '<joint type="fixed"><parent link="{}"/><child link="{}"/></joint>'
        more = f'<link name="b"/><link name="c"/>{joint.format("b", "c")}{joint.format("c", "b")}'
        with pytest.raises(UnusableError, match="in a circle"):
            parse_urdf(urdf(BOX, more=more))


def visual(filename: str, more: str = "") -> str:
    return mesh(filename, more).replace("collision", "visual")


class TestVisuals:
    def test_a_visual_of_another_size_is_done_without(self, folder: Path) -> None:
        vertices, faces = nasty_meshes.shapes()["box"]
        (folder / "meshes/mm.obj").write_bytes(nasty_meshes.encode("obj", vertices * 1e3, faces))
        report = imported(folder, urdf(BOX, visual("meshes/mm.obj")))
        assert compound(report).visual == ()
        assert "it is 7e+04 mm long" in report.usable[0].warnings[0]
        report = imported(folder, urdf(BOX, visual("meshes/mm.obj", ' scale="1e-3 1e-3 1e-3"')))
        assert len(compound(report).visual) == 1
        assert report.usable[0].warnings == ()

    def test_a_visual_that_lies_elsewhere_is_done_without(self, folder: Path) -> None:
        vertices, faces = nasty_meshes.shapes()["box"]
        (folder / "meshes/off.obj").write_bytes(nasty_meshes.encode("obj", vertices + 0.1, faces))
        report = imported(folder, urdf(BOX, visual("meshes/off.obj")))
        assert "mm outside what collides" in report.usable[0].warnings[0]

    def test_the_color_of_the_visual_mesh_goes_first(self, folder: Path) -> None:
        box = nasty_meshes.shapes()["box"]
        for name, color in (("red", "1 0 0"), ("blue", "0 0 1")):
            lines = nasty_meshes.encode("obj", *box).decode().splitlines()
            text = "\n".join(f"{line} {color}" if line[0] == "v" else line for line in lines)
            (folder / f"meshes/{name}.obj").write_text(text)
        report = imported(folder, urdf(mesh("meshes/red.obj"), visual("meshes/blue.obj")))
        assert model(report).color == (0.0, 0.0, 1.0)


class TestMeshesOfUrdfs:
    @pytest.fixture(autouse=True)
    def ring(self, folder: Path) -> None:
        (folder / "meshes/ring.obj").write_bytes(MESH)

    def test_the_meshes_of_a_urdf_that_is_refused_are_named(self, folder: Path) -> None:
        joint = '<joint name="j" type="revolute"/>'
        report = imported(folder, urdf(mesh("meshes/ring.obj"), more=joint))
        reasons = {refusal.file: refusal.reason for refusal in report.refused}
        assert sorted(reasons) == ["meshes/ring.obj", "thing.urdf"]
        assert "a part of thing.urdf, which is refused" in reasons["meshes/ring.obj"]

    def test_the_meshes_of_a_urdf_that_is_skipped_are_objects(self, folder: Path) -> None:
        (folder / "objects.yaml").write_text("objects: {thing.urdf: {skip: true}}")
        report = imported(folder, urdf(mesh("meshes/ring.obj")))
        assert [item.file for item in report.usable] == ["meshes/ring.obj"]
        assert [refusal.file for refusal in report.refused] == ["thing.urdf"]

    def test_meshes_that_a_urdf_does_not_read_are_objects(self, folder: Path) -> None:
        (folder / "any/meshes").mkdir(parents=True)
        (folder / "any/meshes/ring.obj").write_bytes(MESH)
        report = imported(folder, urdf(mesh("package://any/meshes/ring.obj")))
        assert [item.file for item in report.usable] == ["meshes/ring.obj", "thing.urdf"]

    def test_a_file_is_read_once_however_it_is_called(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        names = [f"{'./' * i}meshes/ring.obj" for i in range(30)]
        (folder / "thing.urdf").write_bytes(urdf(*map(mesh, names)))
        source = load_source(folder, "thing.urdf", Settings(), Settings())
        assert len(source.blobs) == 1
        assert {shape.blob for shape in source.job.collision} == {0}
        monkeypatch.setattr(object_source, "MAX_BYTES", len(MESH) - 1)
        with pytest.raises(UnusableError, match="MiB together"):
            load_source(folder, "thing.urdf", Settings(), Settings())

    def test_a_urdf_cannot_ask_for_endless_work(self) -> None:
        link = "".join(mesh(f"{i}.obj") for i in range(65))
        with pytest.raises(UnusableError, match="it names more than 64 meshes"):
            parse_urdf(urdf(link))
        with pytest.raises(UnusableError, match="it has more than 128 collision shapes"):
            parse_urdf(urdf(mesh("a.obj") * 129))

    def test_more_meshes_than_may_collide_are_refused(self, folder: Path) -> None:
        report = imported(folder, urdf(mesh("meshes/ring.obj") * 65))
        assert "it has more than 64 meshes that collide" in report.refused[-1].reason

    @pytest.mark.parametrize("mass", ["0", "-1"])
    def test_a_mass_of_nothing_is_left_aside_with_a_warning(self, folder: Path, mass: str) -> None:
        report = imported(folder, urdf(BOX, f'<inertial><mass value="{mass}"/></inertial>'))
        assert report.usable[-1].warnings == (f"a mass of {mass} kg is left aside",)


class TestNothingOutsideIsRead:
    @pytest.mark.parametrize(
        "name",
        [
            "/etc/passwd.obj",
            "file:///etc/passwd.obj",
            "http://example.org/a.obj",
            "../secret.obj",
            "meshes/../../secret.obj",
            "package://../secret.obj",
            "package:///etc/passwd.obj",
            "..\\secret.obj",
            "~/secret.obj",
            "link.obj",
            "linked/secret.obj",
        ],
    )
    def test_a_urdf_cannot_reach_out_of_its_folder(self, folder: Path, name: str) -> None:
        (folder.parent / "secret.obj").write_bytes(MESH)
        (folder / "link.obj").symlink_to(folder.parent / "secret.obj")
        (folder / "linked").symlink_to(folder.parent)
        report = imported(folder, urdf(mesh(name)))
        assert report.usable == ()
        assert any("thing.urdf" in refusal.file for refusal in report.refused)

    @pytest.mark.parametrize("name", ["a\0b.obj", "package://\0.obj"])
    def test_a_name_with_a_zero_byte_lies_outside(self, name: str) -> None:
        with pytest.raises(UnusableError, match="lies outside the folder"):
            mesh_file(name, "thing.urdf")

    @pytest.mark.parametrize("path", ["../secret.obj", "/etc/passwd", "a/../../b", "", "a\0"])
    def test_reading_refuses_paths_that_lead_out(self, folder: Path, path: str) -> None:
        with pytest.raises(UnusableError, match="lies outside the folder"):
            read_inside(folder, path)

    def test_reading_follows_no_link(self, folder: Path) -> None:
        (folder.parent / "secret.obj").write_bytes(MESH)
        (folder / "link.obj").symlink_to(folder.parent / "secret.obj")
        (folder / "linked").symlink_to(folder.parent)
        for path in ("link.obj", "linked/secret.obj"):
            with pytest.raises(UnusableError, match="cannot be read"):
                read_inside(folder, path)

    def test_reading_a_pipe_does_not_wait(self, folder: Path) -> None:
        os.mkfifo(folder / "pipe.obj")
        with pytest.raises(UnusableError, match="no regular file"):
            read_inside(folder, "pipe.obj")

    def test_a_folder_is_not_left_through_links_that_go_round(self, folder: Path) -> None:
        (folder / "meshes/up").symlink_to(folder)
        (folder / "meshes/ring.obj").write_bytes(MESH)
        assert list_files(folder).files == ("meshes/ring.obj",)

    @pytest.mark.usefixtures("real_child")
    def test_the_import_opens_nothing_but_the_folder_and_the_cache(self, folder: Path) -> None:
        (folder / "evil.obj").write_bytes(b"mtllib ../../../../etc/passwd\nusemtl a\n" + MESH)
        (folder / "away.urdf").write_bytes(urdf(mesh("/etc/passwd.obj"), mesh("../x.obj")))
        opened = watched(lambda: imported(folder, urdf(BOX)))
        allowed = (str(folder), str(folder.parent / "cache"))
        outside = {path for path in opened if not path.startswith(allowed)}
        assert not {path for path in outside if "passwd" in path or "secret" in path}
        assert not [path for path in outside if path.startswith(str(folder.parent))]

    def test_the_conversion_opens_no_file_at_all(self) -> None:
        from grasp_factory.objects.importing.convert import convert
        from grasp_factory.objects.importing.messages import Job, Shape

        texture = MESH.replace(b"v ", b"mtllib /etc/passwd\nusemtl a\nv ", 1)
        ply = nasty_meshes.encode("ply", *nasty_meshes.shapes()["box"])
        ply = ply.replace(b"ascii 1.0\n", b"ascii 1.0\ncomment TextureFile /etc/passwd\n")
        for kind, data in (("obj", texture), ("ply", ply)):
            job = Job(collision=(Shape(kind=kind, size=(1.0, 1.0, 1.0), blob=0),))
            convert(job, [data])  # what is imported lazily has been, now
            assert watched(lambda job=job, data=data: convert(job, [data])) == []


_LOGS: list[list[str]] = []


def _hook(event: str, args: tuple[Any, ...]) -> None:
    if event == "open" and _LOGS and not isinstance(args[0], int):
        _LOGS[-1].append(os.fsdecode(args[0]))


sys.addaudithook(_hook)


def watched(action: Any) -> list[str]:
    """Return the paths of all files that Python code opens in an action."""
    _LOGS.append([])
    try:
        action()
    finally:
        log = _LOGS.pop()
    return log
