"""Files of a store are opened by ``core/place.py``, and texts are printed by ``cli/printing.py``.

A name that is opened in another way would be followed if it is a link. The first test reads the
code; the others run commands, and see which files Python opens by name.
"""

from __future__ import annotations

import ast
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest
from architecture.test_rooms import PACKAGE, modules
from support.places import TINY

OPENS: Mapping[str, str] = {
    **dict.fromkeys(
        ("core/place.py", "core/place_tree.py", "core/directories.py", "core/regular_file.py"),
        "stores, without following links",
    ),
    **dict.fromkeys(
        (
            "apps/browse/thumbnail_cache.py",
            "apps/learning/example_cache.py",
            "core/cache.py",
            "core/scratch_folder.py",
            "dataset/index/database.py",
            "dataset/index/made_here.py",
            "policies/model_registry.py",
        ),
        "the user's cache or temporary files, or an index that was made here",
    ),
    **dict.fromkeys(
        (
            "apps/active_learning/journal.py",
            "apps/active_learning/round_loop.py",
            "cli/active_learning.py",
            "cli/train.py",
        ),
        "the folder of a training",
    ),
    **dict.fromkeys(
        (
            "apps/bag_import/camera_sequence.py",
            "apps/bag_import/image_folder.py",
            "apps/bag_import/sequence_layout.py",
            "apps/bag_import/series_file.py",
            "apps/card/folder.py",
            "apps/card/making.py",
            "apps/card/table.py",
            "apps/pictures/sheet.py",
            "apps/playback/video_file.py",
            "apps/rerun/recording.py",
            "apps/rerun/robot_urdf.py",
            "apps/rerun/sdk.py",
            "capture/ros2/topic_file.py",
            "capture/privacy/blurring.py",
            "capture/session_copy.py",
            "core/atomic_file.py",
            "core/mp4_file.py",
            "core/output_file.py",
            "core/output_folder.py",
            "factory/dry_run_pilots.py",
        ),
        "an output, or a folder that was just made for it",
    ),
    **dict.fromkeys(
        ("core/config/yaml_loader.py", "objects/importing/folder_listing.py"),
        "a config or a mesh of the user",
    ),
    **dict.fromkeys(
        (
            "objects/blobs.py",
            "objects/make_unit_meshes.py",
            "objects/obj_file.py",
            "simulation/make_link_hulls.py",
            "simulation/world/bodies.py",
            "simulation/world/engine.py",
            "simulation/world/names.py",
            "simulation/world/urdf.py",
        ),
        "files of this package or of PyBullet",
    ),
    **dict.fromkeys(
        ("__main__.py", "capture/ros2/network.py", "core/machine.py", "core/executors/limited.py"),
        "/dev/null, /proc",
    ),
    **dict.fromkeys(
        ("capture/bags/bag_file.py", "capture/bags/topic_bounds.py"),
        "a bag of the user, read in a process with limits",
    ),
    "capture/session/camera_info.py": "a calibration file of the user",
    "cli/capture_demo.py": "a temporary folder",
    **dict.fromkeys(
        ("capture/calibration/csv_columns.py", "capture/calibration/board_images.py"),
        "recordings of the user, read in a process with limits",
    ),
    **dict.fromkeys(
        ("capture/calibration/document.py", "capture/calibration/imu_calibrating.py"),
        "an output, or a folder that was just made for it",
    ),
    "capture/devices/opencv.py": "a camera, or a video of the user, read in a process with limits",
    "capture/simulators/opencv.py": "a video that was just made",
    "capture/simulators/recordings.py": "a folder that was just made",
    "capture/simulators/serial_line.py": "a folder that was just made, with the link to a terminal",
    "curation/signing.py": "the user's public key, temporary files of ssh-keygen",
    "dataset/annotations/log.py": "a descriptor",
    "factory/run_log.py": "a descriptor",
    "writers/zarr/column_segments.py": "a descriptor",
    "writers/zarr/files.py": "facts of a store's own folder",
    "writers/zarr/lock.py": "a store's own folder",
    "core/executors/cluster/ray_cluster.py": "a temporary folder of Ray",
    "core/disk_usage.py": "facts of files; none is opened",
    "core/object_storage/bounded_answer.py": "the memory of this process",
    "core/plugins/plugin_sources.py": "code of the user, a file that the user names",
    "core/plugins/entry_points.py": "installed packages",
    "writers/zarr/header.py": "a store whose files ``core/place.py`` opens",
}
"""Modules that call a function which can open a file by name, and what they open."""

METHODS = {
    *("read_text", "write_text", "write_bytes", "iterdir", "rglob", "lstat", "touch"),
    *("symlink_to", "hardlink_to", "rename"),
}
"""Methods of ``pathlib.Path`` that ``Place`` has not."""
FUNCTIONS: Mapping[str, set[str]] = {
    "os": {
        *("open", "unlink", "rename", "replace", "remove", "rmdir", "mkdir", "makedirs", "scandir"),
        *("listdir", "link", "symlink", "walk", "stat", "lstat"),
    },
    "shutil": {"rmtree", "copy", "copy2", "copyfile", "copytree", "move"},
    "np": {"load", "save", "fromfile", "loadtxt", "memmap"},
    "zarr": {"open", "open_group", "open_array"},
    "sqlite3": {"connect"},
    "cv2": {"imread", "imwrite", "imwriteanimation", "VideoWriter", "VideoCapture"},
    "tempfile": {"TemporaryDirectory", "NamedTemporaryFile", "mkstemp", "mkdtemp"},
    "io": {"open", "FileIO"},
}
"""Functions that open, list, change or remove what has a name."""

PRINTS = {"__main__.py", "cli/main.py", "cli/printing.py"}
"""Modules that may call click's echo: the errors of a command, its help, and everything else."""


def calls(module: Path) -> Iterator[ast.Call]:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    return (node for node in ast.walk(tree) if isinstance(node, ast.Call))


def opens_by_name(call: ast.Call) -> bool:
    """Return whether a call may open a file by name, and not below a descriptor."""
    match call.func:
        case ast.Name("open"):
            return True
        case ast.Attribute(ast.Name(library), name) if library in FUNCTIONS:
            below = {"dir_fd", "src_dir_fd"} & {keyword.arg for keyword in call.keywords}
            return name in FUNCTIONS[library] and not below
        case ast.Attribute(_, "read_bytes"):
            return not call.args  # a place's has a limit
        case ast.Attribute(_, "open"):
            return bool(call.args) and isinstance(call.args[0], ast.Constant)
        case ast.Attribute(_, name):
            return name in METHODS
    return False


EXPORTERS = "writers/exporters"
"""They write to a folder that was just made for an export, and read nothing else."""


def test_only_listed_modules_open_files_by_name() -> None:
    found = {module for module in modules() if any(map(opens_by_name, calls(module)))}
    names = {module.relative_to(PACKAGE) for module in found}
    others = {name.as_posix() for name in names if not name.is_relative_to(EXPORTERS)}
    assert others == set(OPENS)


def test_only_one_module_prints_texts() -> None:
    for module in modules():
        names = {
            call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
            for call in calls(module)
        }
        printing = {"echo", "secho", "print"} & names
        assert not printing or module.relative_to(PACKAGE).as_posix() in PRINTS, printing


COMMANDS = (
    *("info {s}", "verify {s} --workers 1", "query {s} --csv", "tags {s}", "replay {s} 0"),
    *("tag {s} --episodes 0 --add odd", "relabel {s} --name strict --min-lift 0.12", "card {s}"),
    *("merge m.zarr {s}", "split {s} few.zarr --episodes 0", "sheet {s} s.png", "plot {s} 0"),
    *(
        "repair {s} --workers 1",
        "index {s}",
        "generate --n 5 --seed 5 --resolution 96x72 --set block_size=4 --out {s} --workers 1",
    ),
)
"""Commands that touch most files of a store."""


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[list[str]]:
    """Return a list to which all names in a store are added that Python opens from now on."""
    names: list[str] = []
    _watched.append((f"{tmp_path}/s.zarr/", names))
    if len(_watched) == 1:
        sys.addaudithook(_note)
    yield names
    _watched[-1] = ("\0", [])


_watched: list[tuple[str, list[str]]] = []
_EVENTS = ("open", "os.", "shutil.", "sqlite3.connect", "glob.", "pathlib.")


def _note(event: str, arguments: tuple[object, ...]) -> None:
    if event.startswith(_EVENTS):
        folder, names = _watched[-1]
        given = [os.fsdecode(a) for a in arguments if isinstance(a, (str, bytes, os.PathLike))]
        names += [f"{event} {name}" for name in given if name.startswith(folder)]


def test_a_file_that_is_opened_by_name_is_noticed(opened: list[str], tmp_path: Path) -> None:
    store = Path(shutil.copytree(TINY, tmp_path / "s.zarr"))
    opened.clear()
    (store / "zarr.json").read_bytes()
    assert opened == [f"open {store}/zarr.json"]


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_opens_no_file_of_a_store_by_name(
    command: str,
    opened: list[str],
    tmp_path: Path,
    run: Callable[..., tuple[int, str, str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    store = Path(shutil.copytree(TINY, tmp_path / "s.zarr"))
    monkeypatch.chdir(tmp_path)
    opened.clear()
    code, _, err = run(*(part.format(s=store) for part in command.split()))
    assert (code, opened) == (0, []), err
