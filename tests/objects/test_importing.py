from __future__ import annotations

import dataclasses
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import nasty_meshes
from support.conversion import convert_here
from support.helpers import assert_same_tree

from grasp_factory.cli import request as cli_request
from grasp_factory.cli.object_import import import_for
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.config.physics import PhysicsConfig, Stepping
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.objects.base import Compound, ObjectModel
from grasp_factory.objects.folder import load_folder
from grasp_factory.objects.importing import (
    FolderReport,
    ImportedObject,
    Refusal,
    import_folder,
    import_report_text,
    worker,
)
from grasp_factory.objects.importing import child as child_module
from grasp_factory.objects.importing.child import Child, CrashError
from grasp_factory.objects.importing.messages import Job, Shape
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow

WIDEST = 0.11
BOX = nasty_meshes.encode("obj", *nasty_meshes.shapes()["box"])
RING = nasty_meshes.encode("stl", *nasty_meshes.shapes()["ring"])


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "cache"
    monkeypatch.setenv(VARIABLE, str(path))
    return path


@pytest.fixture
def real_child() -> None:
    """Ask for conversions in a child process, as a user has them."""


@pytest.fixture(autouse=True)
def quick(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "real_child" not in request.fixturenames:
        convert_here(monkeypatch)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "folder"
    path.mkdir()
    (path / "box.obj").write_bytes(BOX)
    return path


@pytest.fixture
def no_conversion(quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError("something was converted")

    monkeypatch.setattr(Child, "convert", refuse)


def imported(folder: Path, **files: bytes | str) -> FolderReport:
    for name, data in files.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return import_folder(folder, "mine", WIDEST)


def reasons(report: FolderReport) -> dict[str, str]:
    return {refusal.file: refusal.reason for refusal in report.refused}


def model(report: FolderReport, key: str = "box") -> ObjectModel:
    return load_folder("mine", report.sha256).model(f"mine/{key}")


class TestImporting:
    @pytest.mark.usefixtures("real_child")
    def test_a_box_becomes_an_object_with_exact_mass_properties(self, folder: Path) -> None:
        report = imported(folder)
        (item,) = report.usable
        assert (item.object_id, item.file, item.parts) == ("mine/box", "box.obj", 1)
        assert item.sides == pytest.approx((0.03, 0.05, 0.07))
        box = model(report)
        body = box.body
        assert isinstance(body, Compound)
        assert box.mass == pytest.approx(500.0 * 0.03 * 0.05 * 0.07)
        sides = np.array([0.03, 0.05, 0.07])
        squares = (np.sum(sides**2) - sides**2) / 12.0
        assert body.gyration_squared == pytest.approx(squares)
        assert body.inertial_frame.position == pytest.approx((0, 0, 0), abs=1e-9)
        assert box.upper == pytest.approx(sides / 2)

    @pytest.mark.usefixtures("real_child")
    def test_a_set_has_the_same_digest_wherever_its_folder_and_the_cache_are(
        self, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        here = imported(folder, ring_stl=RING)
        shutil.copytree(folder, tmp_path / "elsewhere")
        monkeypatch.setenv(VARIABLE, str(tmp_path / "another"))
        there = imported(tmp_path / "elsewhere")
        assert here == there
        assert_same_tree(tmp_path / "cache", tmp_path / "another")

    def test_another_mass_is_another_digest(self, folder: Path) -> None:
        before = imported(folder).sha256
        assert imported(folder, objects_yaml="defaults: {mass: 0.1}").sha256 != before

    def test_a_second_import_converts_nothing(
        self, folder: Path, request: pytest.FixtureRequest
    ) -> None:
        first = imported(folder, text_stl="I am no mesh")
        request.getfixturevalue("no_conversion")
        assert import_folder(folder, "mine", WIDEST) == first

    def test_an_import_does_not_load_the_libraries_into_this_process(self, folder: Path) -> None:
        code = (
            "import sys; from pathlib import Path;"
            "from grasp_factory.objects.importing import import_folder;"
            f"import_folder(Path({str(folder)!r}), 'mine', 0.1);"
            "print([m for m in ('trimesh', 'coacd', 'scipy', 'pybullet') if m in sys.modules])"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
        assert done.stdout.decode().strip() == "[]"

    @pytest.mark.usefixtures("real_child")
    def test_what_is_damaged_in_the_cache_is_made_again(self, folder: Path, cache: Path) -> None:
        first = imported(folder)
        whole = {path: path.read_bytes() for path in cache.rglob("*.*")}
        for path, data in whole.items():
            path.write_bytes(data[:-3])
        assert imported(folder) == first
        assert {path: path.read_bytes() for path in cache.rglob("*.*")} == whole

    def test_equal_meshes_share_a_split_and_are_named(self, folder: Path) -> None:
        report = imported(folder, more__other_obj=BOX)
        assert model(report).split_by == model(report, "more/other").split_by
        assert report.warnings == ("the same mesh, which is drawn the more often: box, more/other",)

    def test_the_family_is_the_folder(self, folder: Path) -> None:
        report = imported(folder, mugs__ring_stl=RING)
        assert model(report).family == "mesh"
        assert model(report, "mugs/ring").family == "mugs"

    def test_names_that_differ_in_the_suffix_alone_keep_it(self, folder: Path) -> None:
        box = nasty_meshes.encode("stl", *nasty_meshes.shapes()["box"])
        (folder / "box.obj.stl").write_bytes(box)
        report = imported(folder, box_stl=box)
        ids = ["mine/box.obj", "mine/box.obj.stl", "mine/box.stl"]
        assert [item.object_id for item in report.usable] == ids

    def test_a_folder_without_objects_has_no_digest(self, tmp_path: Path) -> None:
        report = import_folder(tmp_path, "mine", WIDEST)
        assert (report.usable, report.refused, report.sha256) == ((), (), "")

    def test_progress_is_told_file_by_file(self, folder: Path) -> None:
        (folder / "ring.stl").write_bytes(RING)
        told: list[tuple[int, int, str]] = []
        import_folder(folder, "mine", WIDEST, lambda *now: told.append(now))
        assert told == [(0, 2, "box.obj"), (1, 2, "ring.stl"), (2, 2, "")]

    def test_what_is_no_folder_is_an_error(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="is no folder with meshes"):
            import_folder(tmp_path / "absent", "mine", WIDEST)

    def test_a_name_that_is_too_long_is_no_folder(self) -> None:
        with pytest.raises(UsageError, match="is no folder with meshes"):
            import_for(Path("x" * 5000), "panda")
        assert not cli_request._is_folder("x" * 5000)
        assert not cli_request._is_folder("")

    def test_one_folder_given_twice_is_refused(self, folder: Path) -> None:
        with pytest.raises(UsageError, match="are the same folder, valid: each folder once"):
            cli_request._import([str(folder), f"{folder}/"], "panda")

    def test_names_do_not_hang_on_the_order_of_folders(self, tmp_path: Path) -> None:
        folders = [str(tmp_path / name / "mugs") for name in ("a", "b")]
        for name in folders:
            Path(name).mkdir(parents=True)
            (Path(name) / "box.obj").write_bytes(BOX)
        found = cli_request._import(folders, "panda")
        assert cli_request._import(folders[::-1], "panda") == found
        assert found[folders[1]][0] == "mugs_"

    def test_a_cache_that_cannot_be_written_is_named(
        self, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "file").touch()
        monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))
        with pytest.raises(UsageError, match=f"cannot be written: .*set {VARIABLE}"):
            imported(folder)

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
    def test_a_file_that_may_not_be_read_is_refused(self, folder: Path) -> None:
        (folder / "box.obj").chmod(0)
        assert "Permission denied" in reasons(imported(folder))["box.obj"]


class TestSizes:
    def test_a_mesh_in_millimetres_is_taken_as_such_with_a_warning(self, folder: Path) -> None:
        vertices, faces = nasty_meshes.shapes()["box"]
        report = imported(folder, box_obj=nasty_meshes.encode("obj", vertices * 1e3, faces))
        assert model(report).upper == pytest.approx((0.015, 0.025, 0.035))
        assert "taken as millimetres" in report.usable[0].warnings[0]

    def test_a_mesh_of_a_doubtful_unit_is_refused_until_its_scale_is_said(
        self, folder: Path
    ) -> None:
        vertices, faces = nasty_meshes.shapes()["box"]
        report = imported(folder, box_obj=nasty_meshes.encode("obj", vertices * 1e2, faces))
        assert "its largest side is 7 units" in reasons(report)["box.obj"]
        report = imported(folder, objects_yaml="objects: {box.obj: {scale: 0.01}}")
        assert report.usable[0].sides == pytest.approx((0.03, 0.05, 0.07))
        assert report.usable[0].warnings == ()

    def test_an_object_that_no_side_of_fits_the_gripper_is_refused(self, folder: Path) -> None:
        report = import_folder(folder, "mine", 0.029)
        assert reasons(report)["box.obj"] == (
            "too large for the gripper: it is 30 mm wide where it is narrowest, and the fingers"
            " open 29 mm"
        )
        assert import_folder(folder, "mine", 0.031).usable

    def test_a_plate_is_used_with_a_warning(self, folder: Path) -> None:
        report = import_folder(folder, "mine", 0.04)
        assert report.usable[0].warnings == (
            "lying flat it is 50 mm wide, and the fingers open 40 mm",
        )

    def test_the_narrowest_width_of_a_turned_box_is_its_smallest_side(self, folder: Path) -> None:
        vertices, faces = nasty_meshes.shapes()["box"]
        R, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
        report = imported(folder, box_obj=nasty_meshes.encode("obj", vertices @ R, faces))
        assert report.usable[0].sides == pytest.approx((0.03, 0.05, 0.07), rel=5e-3)


class TestSettings:
    def test_what_a_file_says_goes_before_the_defaults(self, folder: Path) -> None:
        yaml = """
            defaults: {density: 700, friction: 0.3}
            objects:
              box.obj: {mass: 0.25}
        """
        report = imported(folder, ring_stl=RING, objects_yaml=yaml)
        box, ring = model(report), model(report, "ring")
        assert (box.mass, box.lateral_friction) == (0.25, 0.3)
        assert ring.mass == pytest.approx(700 * 2 * np.pi**2 * 0.03 * 0.01**2, rel=0.06)

    def test_a_guessed_mass_is_not_absurd(self, folder: Path) -> None:
        vertices, faces = nasty_meshes.shapes()["box"]
        small = nasty_meshes.encode("obj", vertices * 0.2, faces)
        assert model(imported(folder, box_obj=small)).mass == 0.02

    def test_a_file_can_be_skipped(self, folder: Path) -> None:
        report = imported(folder, objects_yaml="objects: {box.obj: {skip: true}}")
        assert reasons(report) == {"box.obj": "objects.yaml says to skip it"}

    @pytest.mark.parametrize(
        ("yaml", "message"),
        [
            ("objects: {bix.obj: {}}", "there is no file 'bix.obj'; did you mean 'box.obj'"),
            ("objects: {box.obj: {mas: 1}}", "unknown key 'objects.box.obj.mas'; did you mean"),
            ("defaults: {mass: -1}", r"defaults.mass: got -1.0, valid: 0.001 to 5.0 kg"),
            ("defaults: {mass: heavy}", "defaults.mass: expected a number, got 'heavy'"),
            ("defaults: {scale: .nan}", "defaults.scale: expected a finite number"),
            ("defaults: {mass: 1, density: 200}", "only one of mass and density"),
            ("defaults: {skip: true}", "defaults.skip: got True, valid: said of single files"),
            ("[1, 2]", "expected a mapping of keys"),
            ("a: !!python/object/apply:os.getcwd []", "is not valid YAML"),
            ("\x00", "is not valid YAML"),
        ],
    )
    def test_settings_that_are_not_valid_name_their_key(
        self, folder: Path, yaml: str, message: str
    ) -> None:
        with pytest.raises(ConfigError, match=message) as error:
            imported(folder, objects_yaml=yaml)
        assert "objects.yaml" in str(error.value)

    @pytest.mark.parametrize(
        "yaml", ["", "defaults:", "defaults:\nobjects:\n", "\ufeffobjects: {}"]
    )
    def test_settings_may_be_empty(self, folder: Path, yaml: str) -> None:
        assert imported(folder, objects_yaml=yaml).usable

    def test_a_file_that_is_named_almost_like_the_settings_is_named(self, folder: Path) -> None:
        report = imported(folder, objects_yml="defaults: {mass: 0.1}")
        assert "settings are looked for in objects.yaml" in report.warnings[0]

    def test_a_mesh_of_another_format_is_named(self, folder: Path) -> None:
        report = imported(folder, ball_glb="x", deep__b_GLTF="x", notes_txt="x")
        assert report.warnings == (
            "ball.glb and 1 more are not read: convert to one of obj, stl, ply, urdf",
        )
        assert report.refused == ()

    def test_settings_behind_a_link_are_not_read(self, folder: Path) -> None:
        (folder / "objects.yaml").symlink_to("/etc/hostname")
        with pytest.raises(ConfigError, match=r"objects.yaml: it cannot be read"):
            imported(folder)


class TestReading:
    @pytest.mark.parametrize(
        ("kind", "change", "reason"),
        [
            ("stl", lambda stl: stl[:300], "of 12 faces has 684 bytes, and it has 300"),
            ("stl", lambda stl: stl + b"more", "684 bytes, and it has 688"),
            ("stl", lambda stl: b"\x1f\x8b" + stl, "compressed"),
            ("ply", lambda ply: b"<!DOCTYPE HTML><p>404", "a web page"),
            ("obj", lambda obj: b"version https://git-lfs.github.com/spec/v1", "git lfs pull"),
        ],
    )
    def test_what_a_file_is_instead_is_said(
        self, folder: Path, kind: str, change: Any, reason: str
    ) -> None:
        box = nasty_meshes.shapes()["box"]
        (folder / f"bad.{kind}").write_bytes(change(nasty_meshes.encode(kind, *box)))
        assert reason in reasons(imported(folder))[f"bad.{kind}"]

    @pytest.mark.parametrize("kind", ["obj", "ply"])
    def test_a_byte_order_mark_is_no_part_of_the_text(self, folder: Path, kind: str) -> None:
        (folder / "box.obj").unlink()
        data = nasty_meshes.encode(kind, *nasty_meshes.shapes()["box"])
        (folder / f"box.{kind}").write_bytes(b"\xef\xbb\xbf" + data)
        assert imported(folder).usable[0].warnings == ()

    def test_comments_may_follow_in_a_line(self, folder: Path) -> None:
        report = imported(folder, box_obj=BOX.replace(b"\n", b" # a corner\n"))
        assert report.usable[0].sides == pytest.approx((0.03, 0.05, 0.07))


@pytest.mark.usefixtures("real_child")
class TestChild:
    JOB = Job(collision=(Shape(kind="obj", size=(1.0, 1.0, 1.0), blob=0),))

    @pytest.fixture
    def replace_child(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
        def replace(code: str) -> None:
            def start() -> subprocess.Popen[bytes]:
                pipe = subprocess.PIPE
                command = [sys.executable, "-c", f"import os, sys, time; {code}"]
                process = subprocess.Popen(command, stdin=pipe, stdout=pipe, bufsize=0)
                assert process.stdin
                os.set_blocking(process.stdin.fileno(), False)
                return process

            monkeypatch.setattr(child_module, "_start", start)

        yield replace

    @pytest.mark.parametrize(
        ("code", "reason"),
        [
            ("os.abort()", r"crashed \(SIGABRT\)"),
            ("sys.exit(3)", r"crashed \(exit code 3\)"),
            ("time.sleep(60)", "took more than 1 s"),
            ("os.write(1, b'x' * 100)", "returned too much data"),
        ],
    )
    def test_a_conversion_that_dies_or_hangs_is_a_reason(
        self, replace_child: Any, code: str, reason: str
    ) -> None:
        replace_child(code)
        with Child(time_limit_s=1.0) as child, pytest.raises(CrashError, match=reason):
            child.convert(self.JOB, [b"x" * 10_000_000])

    def test_a_crash_is_not_remembered(
        self, folder: Path, replace_child: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with monkeypatch.context():
            replace_child("os.abort()")
            assert "crashed" in reasons(imported(folder))["box.obj"]
        monkeypatch.undo()
        monkeypatch.setenv(VARIABLE, str(folder.parent / "cache"))
        assert imported(folder).usable

    def test_libraries_that_are_missing_are_named_with_the_remedy(
        self, folder: Path, replace_child: Any
    ) -> None:
        use = "from grasp_factory.objects.importing.messages import encode"
        send = f"{use}; os.write(1, encode({{'missing': 'x'}}))"
        replace_child(f"{send}; time.sleep(9)")
        told = r"this needs x, which is not installed: pip install 'grasp-factory\[meshes\]'"
        with pytest.raises(UsageError, match=told):
            imported(folder)

    def test_computing_time_has_a_limit_that_is_a_reason(self, replace_child: Any) -> None:
        limit = "import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 9))"
        replace_child(f"{limit}\nwhile True: pass")
        with Child() as child, pytest.raises(CrashError, match="too much computing time"):
            child.convert(self.JOB, [b"x"])

    def test_each_object_has_its_own_computing_time(self) -> None:
        before = resource.getrlimit(resource.RLIMIT_CPU)
        try:
            worker._limit_cpu()
            used = time.process_time()
            assert 0 <= resource.getrlimit(resource.RLIMIT_CPU)[0] - used <= 121
        finally:
            resource.setrlimit(resource.RLIMIT_CPU, before)

    @pytest.mark.skipif(sys.platform != "linux", reason="a call of Linux")
    def test_the_child_ends_with_an_importer_that_is_killed(self) -> None:
        code = (
            "import subprocess, sys, time;"
            "inner = 'from grasp_factory.objects.importing import worker;'"
            "'worker._end_with_parent(); print(1, flush=True); import time; time.sleep(60)';"
            "child = subprocess.Popen([sys.executable, '-c', inner], stdout=subprocess.PIPE);"
            "child.stdout.readline(); print(child.pid, flush=True); time.sleep(60)"
        )
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as parent:
            assert parent.stdout
            child = int(parent.stdout.readline())
            parent.kill()
        deadline = time.monotonic() + 10.0
        while _runs(child) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert not _runs(child)

    def test_memory_has_a_limit(self) -> None:
        code = (
            "import resource, sys, io; from grasp_factory.objects.importing import worker;"
            "sys.stdin = open('/dev/null'); worker.main();"
            "print(resource.getrlimit(resource.RLIMIT_AS)[0], file=sys.stderr)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
        assert int(done.stderr) == 6 * 2**30


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class TestReport:
    REPORT = FolderReport(
        name="mine",
        sha256="0" * 64,
        usable=(
            ImportedObject(
                object_id="mine/Größe",
                file="Größe.obj",
                sides=(0.03, 0.05, 0.07),
                mass=0.0525,
                parts=3,
                split="train",
                warnings=("no closed\x1b[2J surface",),
            ),
        ),
        refused=(Refusal(file="two\nlines\udcff.obj", reason="it is flat"),),
    )

    def test_a_report_is_a_table_of_what_is_used_and_a_list_of_what_is_not(self) -> None:
        assert import_report_text(self.REPORT).splitlines() == [
            "1 usable, 1 refused",
            "",
            "  object          size, mm  mass, g  parts  split",
            "  mine/Größe  30 x 50 x 70       52      3  train",
            "      no closed\\x1b[2J surface",
            "",
            "Refused:",
            "  two\\nlines\\udcff.obj: it is flat",
        ]

    def test_a_long_name_is_cut_in_the_table(self) -> None:
        item = dataclasses.replace(self.REPORT.usable[0], object_id="x" * 300)
        report = dataclasses.replace(self.REPORT, usable=(item,))
        assert "  " + "x" * 59 + "…  30 x 50 x 70" in import_report_text(report)

    def test_an_empty_report_is_one_line(self) -> None:
        empty = dataclasses.replace(self.REPORT, usable=(), refused=())
        assert import_report_text(empty) == "0 usable, 0 refused"


@pytest.mark.usefixtures("real_child")
class TestNasty:
    @pytest.fixture(autouse=True)
    def world(self) -> Iterator[World]:
        with World() as world:
            yield world

    def test_a_few_of_what_a_user_might_bring_is_used_or_refused(
        self, tmp_path: Path, world: World
    ) -> None:
        folder = tmp_path / "few"
        folder.mkdir()
        expected = nasty_meshes.write_oddities(folder)
        check(folder, world, expected)

    @pytest.mark.soak
    @pytest.mark.timeout(900)
    def test_two_hundred_of_what_a_user_might_bring_are_used_or_refused(
        self, tmp_path: Path, world: World
    ) -> None:
        folder = tmp_path / "many"
        folder.mkdir()
        expected = nasty_meshes.write_oddities(folder)
        (folder / "half_a_million.stl").write_bytes(nasty_meshes.many_triangles(500_000))
        written = nasty_meshes.write_meshes(folder, every=1)
        assert written + len(expected) >= 200
        report = check(folder, world, expected)
        assert len(report.usable) + len(report.refused) == written + len(expected) + 1
        used = {item.file.partition("/")[0] for item in report.usable}
        refused = {refusal.file.partition("/")[0] for refusal in report.refused}
        good = {"plain", "mm", "inverted", "soup", "slivers", "strays", "pair", "hollow", "rough"}
        bad = {"cm", "tiny", "minute", "huge", "nan", "inf", "astronomic", "flat", "wild_index"}
        assert good <= used - refused
        assert bad <= refused - used


def check(folder: Path, world: World, expected: dict[str, bool]) -> FolderReport:
    """Import a folder, and drop everything that can be used onto a floor."""
    report = import_folder(folder, "mine", WIDEST)
    used = {item.file for item in report.usable}
    refused = reasons(report)
    assert not used & set(refused)
    assert {file: file in used for file in expected} == expected
    assert set(expected) <= used | set(refused)
    assert all(refused.values())
    text = import_report_text(report)
    assert all(line.isprintable() for line in text.split("\n"))
    for item in load_folder("mine", report.sha256).models.values():
        assert fall(world, item) > 0.0, item.object_id
    return report


def fall(world: World, item: ObjectModel) -> float:
    """Drop an object for a second and return the height of its centre of mass, metres."""
    assert isinstance(item.body, Compound)
    assert 0.0 < item.mass <= 5.0
    world.reset(PhysicsConfig())
    world.set_stepping(Stepping(240, 100, 1, 1e-7))
    world.add_box((1.0, 1.0, 0.05), (0.0, 0.0, -0.05), (1.0, 1.0, 1.0, 1.0))
    body = world.add_compound(item.body, drop_pose(item), mass=item.mass)
    assert world.mass(body) == pytest.approx(item.mass)
    for _ in range(240):
        world.step()
    position = np.array(world.com_frame(body)[0])
    assert np.isfinite(position).all()
    assert np.abs(position[:2]).max() < 0.5
    return float(position[2])


def drop_pose(item: ObjectModel) -> Any:
    from grasp_factory.core.geometry import Pose

    low, high = np.array(item.lower), np.array(item.upper)
    x, y = -(low + high)[:2] / 2.0
    return Pose((float(x), float(y), float(0.01 - low[2])), (0.0, 0.0, 0.0, 1.0))
