"""The shape of the code, as a test: who may import whom. The rule lives here and nowhere else."""

from __future__ import annotations

import ast
import statistics
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

import grasp_factory

PACKAGE = Path(grasp_factory.__file__).parent

ROOMS = (
    "cli apps curation capture factory simulation sampling dataset policies writers signals labels"
    " objects robots core"
).split()
"""A room imports rooms to its right, never to its left."""
OUTSIDE = {"": -1, "__main__": -1, "torch": -1, "errors": len(ROOMS)}
"""Modules of the package's root; the public names of ``__init__`` are loaded when they are used."""
RANK = {room: place for place, room in enumerate(ROOMS)} | OUTSIDE

SIMULATES = {"simulation", "factory", "curation", "apps", "cli"}
WALLS = {
    "policies": {"simulation", "objects"},
    "writers": {"simulation", "objects", "policies"},
    "dataset": {"simulation", "policies"},
    "sampling": {"simulation"},
    "signals": {"simulation", "objects", "policies", "writers"},
    "robots": {"simulation", "objects"},
}
"""What a room must not reach, not even through others."""

OWNERS = {
    "pybullet": {"simulation/world"},
    "pybullet_data": {"simulation/world"},
    "zarr": {"writers/zarr", "writers/exporters/replay_buffer_file.py", "dataset"},
    "numcodecs": {"writers/zarr", "writers/exporters/replay_buffer_file.py"},
    "google_crc32c": {"writers/zarr", "writers/exporters/tfrecord_file.py"},
    "h5py": {"writers/exporters/robomimic.py", "writers/exporters/hdf5_file.py"},
    "click": {"__main__.py", "cli"},
    "sqlite3": {"dataset/index", "writers/exporters/rosbag"},
    "rosbags": {"apps/bag_import", "capture", "writers/exporters/rosbag"},
    "mcap": {"capture"},
    "zstandard": {"capture/session"},
    "cyclonedds": {"capture/ros2"},
    "serial": {"capture/transport/serial_port.py"},
    "pyrealsense2": {"capture/devices/realsense.py", "capture/simulators/realsense.py"},
    "trimesh": {"objects/importing", "simulation/make_link_hulls.py"},
    "coacd": {"objects/importing"},
    "tqdm": {"core/progress.py"},
    "multiprocessing": {"core/executors"},
    "ray": {"core/executors/cluster/ray_cluster.py"},
    "torch": {"apps/learning", "policies/networks", "torch.py"},
    "rerun": {"apps/rerun"},
    "safetensors": {"policies/networks"},
    "sklearn": {"apps/learning"},
    "pyarrow": {"writers/exporters/lerobot"},
    "pandas": {"dataset/pandas_table.py", "dataset/dataset.py"},
    "av": {"writers/exporters/lerobot"},
    "flask": {"apps/browse", "apps/cutting_page", "apps/session_page"},
    "waitress": {"apps/browse"},
    "werkzeug": {"apps/browse"},
    "matplotlib": {
        *("apps/learning", "apps/active_learning", "apps/pictures/plot"),
        "capture/calibration/allan_plot.py",
    },
    "ahrs": {"signals/orientation"},
    "imufusion": {"signals/orientation/fusion.py"},
    "obstore": {"core/object_storage"},
    "allantools": {"capture/calibration/allan.py"},
}
"""Who alone may import a library: folders and files of the package."""

LONGEST_MODULE, MEDIAN_MODULE = 300, 120
"""Lines."""
IN_MANY_ROOMS = {"__init__.py", "base.py"}
"""File names that more than two rooms may have."""


@cache
def modules() -> tuple[Path, ...]:
    return tuple(sorted(PACKAGE.rglob("*.py")))


def room(path: Path) -> str:
    """Return the room of a module; of one in the package's root, its own name."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py").replace("__init__", "")


@cache
def imports(path: Path) -> frozenset[str]:
    """Return all imported modules, also those inside functions and under TYPE_CHECKING."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} has a relative import, which this test cannot see"
            assert node.module
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


@cache
def rooms_and_root_modules() -> frozenset[str]:
    return frozenset(map(room, modules()))


def own_imports(path: Path) -> set[str]:
    """Return the rooms and root modules of this package that a module imports."""
    parts = [name.split(".") for name in imports(path)]
    found = {p[1] for p in parts if p[0] == "grasp_factory" and len(p) > 1}
    return found & rooms_and_root_modules()


@cache
def arrows() -> Mapping[str, set[str]]:
    """Return what each room imports."""
    graph: dict[str, set[str]] = {}
    for path in modules():
        graph.setdefault(room(path), set()).update(own_imports(path))
    return graph


def reachable(start: str) -> set[str]:
    """Return every room that one imports, directly or through others."""
    seen, todo = set[str](), [start]
    while todo:
        for name in arrows()[todo.pop()] - seen:
            seen.add(name)
            todo.append(name)
    return seen


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_an_import_points_to_a_room_on_the_right(path: Path) -> None:
    me = room(path)
    if not me:
        return
    assert me in RANK, f"give {me} its place in ROOMS"
    for other in own_imports(path) - {me}:
        assert RANK[other] > RANK[me], f"{me} may not import {other}"


def test_there_are_no_other_rooms() -> None:
    assert set(RANK) == {room(path) for path in modules()}
    assert len(ROOMS) <= 15
    assert all((PACKAGE / name / "__init__.py").is_file() for name in ROOMS)


@pytest.mark.parametrize("name", WALLS)
def test_a_wall_holds_also_on_detours(name: str) -> None:
    assert WALLS[name] & set(reachable(name)) == set()


def test_only_rooms_that_simulate_reach_the_simulator() -> None:
    assert {name for name in ROOMS if "simulation" in {name, *reachable(name)}} == SIMULATES


def test_modules_are_short() -> None:
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules()}
    long = {str(path.relative_to(PACKAGE)): n for path, n in lines.items() if n > LONGEST_MODULE}
    assert long == {}
    assert statistics.median(lines.values()) <= MEDIAN_MODULE


def test_a_file_name_occurs_in_two_rooms_at_most() -> None:
    rooms: dict[str, set[str]] = {}
    for path in modules():
        rooms.setdefault(path.name, set()).add(room(path))
    assert {name for name, found in rooms.items() if len(found) > 2} <= IN_MANY_ROOMS


def test_a_public_type_is_defined_once() -> None:
    places: dict[str, list[str]] = {}
    for path in modules():
        for name in type_names(ast.parse(path.read_text(encoding="utf-8"))):
            places.setdefault(name, []).append(str(path.relative_to(PACKAGE)))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def type_names(tree: ast.Module) -> Iterator[str]:
    """Return the public classes, type aliases and type variables that a module defines."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            names = [node.name]
        elif isinstance(node, ast.Assign):
            names = [target.id for target in node.targets if isinstance(target, ast.Name)]
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names = [node.target.id]
        else:
            continue
        yield from (n for n in names if n[0].isupper() and not n.isupper())


def test_the_package_root_holds_what_is_public_and_little_else() -> None:
    assert len(list(PACKAGE.glob("*.py"))) <= 6


@pytest.mark.parametrize("library", OWNERS)
def test_a_library_has_its_owners(library: str) -> None:
    owners = [PACKAGE / owner for owner in OWNERS[library]]
    users = [p for p in modules() if library in {name.split(".")[0] for name in imports(p)}]
    strangers = [p for p in users if not any(p.is_relative_to(owner) for owner in owners)]
    assert [str(p.relative_to(PACKAGE)) for p in strangers] == []
    assert users, f"nothing imports {library}: take it out of OWNERS"


def test_the_tests_eyes_see_every_kind_of_import(tmp_path: Path) -> None:
    file = tmp_path / "m.py"
    file.write_text(
        "import zarr.codecs\nfrom grasp_factory.simulation import world\n"
        "def f():\n    from grasp_factory.robots.base import Robot\n"
    )
    assert {
        "zarr.codecs",
        "grasp_factory.simulation.world",
        "grasp_factory.robots.base",
    } <= imports(file)
    assert own_imports(file) == {"simulation", "robots"}


def in_a_fresh_process(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_importing_the_package_loads_neither_simulator_nor_store() -> None:
    code = (
        "import sys, grasp_factory; dir(grasp_factory); grasp_factory.FactoryConfig();"
        "print([m for m in ('pybullet', 'zarr', 'cv2', 'click') if m in sys.modules])"
    )
    assert in_a_fresh_process(code) == "[]"


def test_the_help_of_the_command_loads_no_large_library() -> None:
    code = (
        "import sys, grasp_factory.cli.main;"
        "print([m for m in ('numpy', 'pybullet', 'zarr', 'cv2') if m in sys.modules])"
    )
    assert in_a_fresh_process(code) == "[]"


def test_reading_a_store_does_not_load_the_simulator() -> None:
    code = "import sys; from grasp_factory import Dataset; print('pybullet' in sys.modules)"
    assert in_a_fresh_process(code) == "False"


@pytest.mark.parametrize("name", grasp_factory.__all__)
def test_a_public_name_is_there_and_comes_from_where_it_lives(name: str) -> None:
    value = getattr(grasp_factory, name)
    assert value.__name__ == name
    assert value.__module__ == f"grasp_factory.{grasp_factory._HOMES[name]}"
    assert value.__doc__


def test_public_names_are_sorted_and_all_of_them() -> None:
    assert grasp_factory.__all__ == sorted(grasp_factory.__all__)
    assert set(grasp_factory.__all__) == set(grasp_factory._HOMES)
    assert set(grasp_factory.__all__) <= set(dir(grasp_factory))


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'grasp_factory' has no attribute 'Datset'"):
        _ = grasp_factory.Datset
