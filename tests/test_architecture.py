"""The shape of the code, as a test: who may import whom. The rule lives here and nowhere else."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import grasp_factory
from grasp_factory.cameras import CAMERAS
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.outcome import Outcome, names
from grasp_factory.policies import POLICIES
from grasp_factory.robots import ROBOTS

PACKAGE = Path(grasp_factory.__file__).parent
README = PACKAGE.parent / "README.md"

# A module may import from the layers above it in this list, never from its own or below.
LAYERS = (
    ("linear",),
    ("elementary",),
    ("errors", "geometry", "gripper", "outcome", "renderer"),
    (
        *("cache", "camera", "kinematics", "machine", "platforms", "records", "report_words"),
        *("splits", "stopping"),
        *("textures", "trouble"),
    ),
    ("descent",),
    ("ik", "looks", "objects", "outfile", "randomize", "sections", "stepping", "thresholds"),
    ("cameras", "placement", "quality", "variation", "videofile"),
    ("config", "yamltext"),
    ("labels", "meshes", "request", "schema"),
    ("balance", "conditions", "episode", "even_draws", "finite", "selection", "signals"),
    ("crops", "curves", "episode_distance"),
    ("networks",),
    ("models",),
    ("clouds", "inspection", "motion", "noise", "painting", "policies", "rows", "writers"),
    ("annotations", "checked", "episodes", "indexing", "readings", "sampling"),
    ("table",),
    ("views",),
    ("dataset", "runlog"),
    (
        *("carried", "collecting", "examples", "executors", "index", "kept", "plot", "sheet"),
        *("summary", "world"),
    ),
    (
        *("baselines", "fingerprint", "report_distance", "report_store", "robots", "tiles"),
        "torch",
    ),
    ("sensors",),
    ("stage", "track", "visibility"),
    ("scene",),
    ("shaking",),
    ("attempt",),
    ("rollout",),
    ("blocks", "checks", "playback", "preview", "recordings", "relabel", "replay"),
    ("losses", "resuming"),
    ("factory",),
    ("pilots", "verifying"),
    ("dryrun",),
    ("report",),
    ("browse",),
    ("live",),
    ("arguments", "card", "flywheel", "folders", "progress"),
    (
        *("cli_browse", "cli_card", "cli_index", "cli_merge", "cli_replay", "cli_store", "cli_tag"),
        *("cli_train", "options"),
    ),
    ("cli_flywheel", "cli_look"),
    ("cli",),
    ("__main__",),
)
LAYER = {module: depth for depth, modules in enumerate(LAYERS) for module in modules}

SIMULATOR = {"world", "scene", "robots", "sensors", "attempt", "rollout"}
WALLS = {
    "policies": SIMULATOR | {"objects"},
    "writers": SIMULATOR | {"objects", "policies"},
    "dataset": SIMULATOR | {"objects", "policies"},
    "sampling": SIMULATOR,
    "signals": SIMULATOR | {"objects", "policies", "writers"},
    "noise": SIMULATOR | {"objects", "policies", "writers"},
}
"""What a module must not reach, not even through others."""

OWNERS = {
    "pybullet": {"world"},
    "pybullet_data": {"world"},
    "zarr": {"writers", "dataset"},
    "numcodecs": {"writers"},
    "google_crc32c": {"writers"},
    "click": {
        *("__main__", "arguments", "cli", "cli_browse", "cli_card", "cli_flywheel"),
        *("cli_index", "cli_look", "cli_merge"),
        *("cli_replay", "cli_store", "cli_tag", "cli_train", "folders", "options", "progress"),
    },
    "sqlite3": {"index"},
    "trimesh": {"meshes", "robots"},
    "coacd": {"meshes"},
    "tqdm": {"progress"},
    "multiprocessing": {"executors"},
    "torch": {"baselines", "networks", "torch"},
    "rerun": {"recordings"},
    "safetensors": {"networks"},
    "sklearn": {"baselines"},
    "flask": {"browse"},
    "waitress": {"browse"},
    "werkzeug": {"browse"},
    "matplotlib": {"baselines", "flywheel", "plot"},
}
"""Who alone may import a library."""


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def unit(path: Path) -> str:
    """Return a module's name in the layers: its own, or its folder's."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


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


def own_imports(path: Path) -> set[str]:
    """Return the units of this package that a module imports."""
    parts = [name.split(".") for name in imports(path)]
    units = {p[1] for p in parts if p[0] == "grasp_factory" and len(p) > 1}
    return units & {unit(module) for module in modules()}


def reachable(start: str) -> Iterator[str]:
    """Return every unit that one imports, directly or through others."""
    graph: dict[str, set[str]] = {}
    for path in modules():
        graph.setdefault(unit(path), set()).update(own_imports(path))
    seen, todo = set[str](), [start]
    while todo:
        for name in graph[todo.pop()] - seen:
            seen.add(name)
            todo.append(name)
    yield from seen


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_an_import_points_to_a_lower_layer(path: Path) -> None:
    me = unit(path)
    if me == "__init__":
        return
    assert me in LAYER, f"give {me} its place in LAYERS"
    for other in own_imports(path) - {me}:
        assert LAYER[other] < LAYER[me], f"{me} may not import {other}"


def test_the_layers_name_only_what_exists() -> None:
    assert set(LAYER) == {unit(path) for path in modules()} - {"__init__"}


@pytest.mark.parametrize("module", WALLS)
def test_a_wall_holds_also_on_detours(module: str) -> None:
    assert WALLS[module] & set(reachable(module)) == set()


@pytest.mark.parametrize("library", OWNERS)
def test_a_library_has_its_owners(library: str) -> None:
    users = {unit(p) for p in modules() for name in imports(p) if name.split(".")[0] == library}
    assert users <= OWNERS[library]


def test_the_tests_eyes_see_every_kind_of_import(tmp_path: Path) -> None:
    file = tmp_path / "m.py"
    file.write_text(
        "import zarr.codecs\nfrom grasp_factory import world\n"
        "def f():\n    from grasp_factory.robots.base import Robot\n"
    )
    assert {"zarr.codecs", "grasp_factory.world", "grasp_factory.robots.base"} <= imports(file)
    assert own_imports(file) == {"world", "robots"}


def in_a_fresh_process(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_importing_the_package_loads_neither_simulator_nor_store() -> None:
    code = (
        "import sys, grasp_factory; dir(grasp_factory); grasp_factory.FactoryConfig();"
        "print([m for m in ('pybullet', 'zarr', 'cv2', 'click') if m in sys.modules])"
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


TABLES: dict[str, Any] = {
    "cameras": CAMERAS,
    "objects": OBJECT_SETS,
    "policies": POLICIES,
    "robots": ROBOTS,
}


@pytest.mark.parametrize("kind", TABLES)
def test_a_tables_rows_bear_their_names_and_a_line_of_description(kind: str) -> None:
    assert TABLES[kind]
    for name, row in TABLES[kind].items():
        assert row.name == name
        assert name.isidentifier()
        assert 10 < len(row.description) <= 100
        assert "\n" not in row.description


@pytest.mark.parametrize("kind", [*TABLES, "outcomes"])
def test_a_tables_names_are_in_the_readme(kind: str) -> None:
    text = README.read_text(encoding="utf-8")
    words = names(Outcome) if kind == "outcomes" else TABLES[kind]
    assert [word for word in words if not re.search(rf"\b{word}\b", text)] == []
