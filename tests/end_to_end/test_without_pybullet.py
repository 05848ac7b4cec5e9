"""Without PyBullet all runs that simulates nothing; the rest says in a line what to install."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support import bags
from support.browse_process import Running, browsing
from support.browser import chromium
from support.environments import PYBULLET, environment
from support.helpers import tree
from support.places import REPOSITORY, TINY
from support.stored import varied

from grasp_factory.cli.main import COMMANDS
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate

pytestmark = pytest.mark.slow

RUNS: Mapping[str, tuple[str, ...]] = {
    "generate": ("--print-config",),
    "objects": ("", "meshes"),
    "robots": ("",),
    "policies": ("",),
    "cameras": ("",),
    "sensors": ("",),
    "conformance": ("top_down",),
    "info": ("tiny.zarr",),
    "sheet": ("tiny.zarr s.png", "tiny.zarr t.png --tiles"),
    "plot": ("tiny.zarr 0",),
    "rerun": ("tiny.zarr 0", "panda.zarr 0"),
    "card": ("tiny.zarr",),
    "index": ("tiny.zarr",),
    "query": ("tiny.zarr --where status=committed",),
    "tag": ("tiny.zarr --episodes 0 --add odd",),
    "tags": ("tiny.zarr",),
    "verify": ("tiny.zarr", "panda.zarr"),
    "repair": ("tiny.zarr", "no-metadata.zarr"),
    "sign": ("tiny.zarr --key key",),
    "relabel": ("tiny.zarr --name strict --min-lift 0.12",),
    "merge": ("merged.zarr tiny.zarr",),
    "split": ("tiny.zarr few.zarr --episodes 0,2",),
    "pack": ("tiny.zarr packed.zarr --shard 64",),
    "snapshot": ("tiny.zarr -m first",),
    "log": ("tiny.zarr",),
    "provenance": ("tiny.zarr", "exported"),
    "diff": ("tiny.zarr panda.zarr --arrays",),
    "export": ("--list", "tiny.zarr out --to sequences"),
    "import": ("drive.bag --list", "drive.bag out --to sequences", "exported again.zarr"),
    "capture": ("devices",),
    "calibrate": ("ft ft.yaml --tare still.csv",),
    "train": ("learn.zarr --epochs 1",),
    "learning-curve": ("learn.zarr --sizes 8 --seeds 1 --epochs 1",),
    "browse": (),  # below
}
"""What exits with 0, by command."""

SIMULATES: Mapping[str, tuple[str, ...]] = {
    "generate": ("--n 1 --out new.zarr", "--n 1 --out new.zarr --dry-run", "--n 5 --out tiny.zarr"),
    "preview": ("preview.png --n 1",),
    "check-physics": ("--short",),
    "conformance": ("kuka_iiwa",),
    "replay": ("tiny.zarr 0", "tiny.zarr 0 --video v.mp4"),
    "verify": ("tiny.zarr --deep 1",),
    "repair": ("no-chunk.zarr",),
    "flywheel": ("wheel --start 4 --budget 4 --eval 4",),
}
"""What needs the simulator, by command."""

SIMULATORS = (
    *("simulation.", "apps.active_learning", "apps.physics_check", "apps.pictures.preview"),
    *(f"apps.conformance.{kind}_checks" for kind in ("robot", "object_set", "sensor")),
    *("apps.playback.clip", "apps.playback.playback", "apps.playback.video_process"),
    *("cli.run_progress", "curation.replay"),
    *("factory.block_maker", "factory.dry_run", "factory.generate", "factory.dry_run_pilots"),
    *("factory.node_check", "factory.platform_check"),
)
"""How the names begin of the modules that import the simulator."""
IMPORT_ALL = """
import importlib, pkgutil
import grasp_factory
from grasp_factory.errors import MissingLibraryError
for module in pkgutil.walk_packages(grasp_factory.__path__, "grasp_factory.", onerror=str):
    try:
        importlib.import_module(module.name)
    except MissingLibraryError:
        print(module.name.removeprefix("grasp_factory."))
"""


RUN_ALL = """
import contextlib, io, json, os, sys
from grasp_factory.__main__ import main as command
done = {}
for line, folder in json.load(sys.stdin).items():
    os.chdir(folder)
    sys.argv = ["grasp-factory", *line.split()]
    out, err = io.StringIO(), io.StringIO()
    code = None
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            command()
        except SystemExit as left:
            code = left.code or 0
    done[line] = {"returncode": code, "stdout": out.getvalue(), "stderr": err.getvalue()}
print(json.dumps(done))
"""
"""Runs each line of a table in its folder, all in one process: to start one takes a second."""


def lines(table: Mapping[str, Iterable[str]]) -> list[str]:
    return [f"{name} {rest}" for name, several in table.items() for rest in several]


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return environment(tmp_path_factory.mktemp("environment") / "venv", without=PYBULLET)


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of stores: what ships, of another robot, damaged, and one to learn from."""
    folder = tmp_path_factory.mktemp("stores")
    for name in ("tiny", "no-metadata", "no-chunk"):
        shutil.copytree(TINY, folder / f"{name}.zarr")
    (folder / "no-metadata.zarr/streams/phase/zarr.json").unlink()
    next((folder / "no-chunk.zarr/streams/phase").glob("[0-9]*")).unlink()
    shutil.copytree(varied(), folder / "panda.zarr")
    Dataset(TINY).export("sequences", folder / "exported")
    plain = {"seed": 92, "resolution": [64, 48], "physics": to_plain(PHYSICS_PRESETS["fast"])}
    generate(FactoryConfig.from_plain(plain), 16, folder / "learn.zarr", workers=1)
    bags.ros1(folder / "drive.bag", [("/ft", bags.WRENCH, 0, bags.wrench((0, 0, 1), (0, 0, 0)))])
    rows = "".join(f"{k},{','.join('123456')}\n" for k in range(120))
    (folder / "still.csv").write_text(f"timestamp,fx,fy,fz,tx,ty,tz\n{rows}")
    (folder / "meshes").mkdir()
    corners = itertools.product((0.0, 0.04), repeat=3)
    faces = "1 2 4 3|5 7 8 6|1 5 6 2|3 4 8 7|1 3 7 5|2 6 8 4".split("|")
    text = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {face}" for face in faces]
    (folder / "meshes/cube.obj").write_text("\n".join(text))
    command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / "key")]
    subprocess.run(command, check=True)
    return folder


@pytest.fixture
def variables(tmp_path: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(REPOSITORY), VARIABLE: str(tmp_path / "cache")}


def run(
    python: Path, arguments: Iterable[str], folder: Path, variables: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [python, "-W", "error", *arguments],
        cwd=folder, env=variables, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture
def here(stores: Path, tmp_path: Path) -> Path:
    """Return a folder with copies of the stores."""
    return shutil.copytree(stores, tmp_path / "here")


def test_the_environment_has_the_libraries_of_this_one_but_for_pybullet(
    python: Path, tmp_path: Path, variables: dict[str, str]
) -> None:
    code = (
        "from importlib.util import find_spec; import grasp_factory, numpy;"
        "print(grasp_factory.__file__, [find_spec(n) for n in ('pybullet', 'pybullet_data')])"
    )
    done = run(python, ["-c", code], tmp_path, variables)
    assert done.stdout.split(" ", 1) == [
        str(REPOSITORY / "grasp_factory" / "__init__.py"),
        "[None, None]\n",
    ], done.stderr


def test_every_command_is_in_one_of_the_tables() -> None:
    """A new command has a row in ``RUNS``, in ``SIMULATES``, or in both."""
    commands = {command.name for several in COMMANDS.values() for command in several}
    assert commands == {*RUNS, *SIMULATES}


def test_only_what_simulates_imports_the_simulator(
    python: Path, tmp_path: Path, variables: dict[str, str]
) -> None:
    done = run(python, ["-c", IMPORT_ALL], tmp_path, variables)
    assert done.returncode == 0, done.stderr
    found = done.stdout.splitlines()
    assert [name for name in found if not name.startswith(SIMULATORS)] == []
    assert [word for word in SIMULATORS if not any(n.startswith(word) for n in found)] == []


def named(line: str, stores: Path) -> list[Path]:
    """Return what a line names of the folder of stores."""
    return [path for path in sorted(stores.iterdir()) if path.name in line.split()]


def copy_of_named(line: str, stores: Path, place: Path) -> Path:
    """Make a folder for a line with a copy of what it names."""
    place.mkdir()
    for path in named(line, stores):
        copy = shutil.copytree if path.is_dir() else shutil.copy
        copy(path, place / path.name)
    return place


@pytest.fixture(scope="module")
def runs(
    python: Path, stores: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[Path, Any]]:
    """Return, for each line of both tables, its folder and what it did there."""
    folder = tmp_path_factory.mktemp("runs")
    places = {
        line: copy_of_named(line, stores, folder / str(number))
        for number, line in enumerate([*lines(RUNS), *lines(SIMULATES)])
    }
    done = subprocess.run(
        [python, "-W", "error", "-c", RUN_ALL],
        env=os.environ | {"PYTHONPATH": str(REPOSITORY), VARIABLE: str(folder / "cache")},
        input=json.dumps({line: str(place) for line, place in places.items()}),
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = json.loads(done.stdout)
    return {line: (place, SimpleNamespace(**found[line])) for line, place in places.items()}


@pytest.mark.parametrize("line", lines(RUNS))
def test_a_command_that_simulates_nothing_runs(
    line: str, runs: dict[str, tuple[Path, Any]]
) -> None:
    _, done = runs[line]
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize("line", lines(SIMULATES))
def test_a_command_that_simulates_says_what_to_install(
    line: str, runs: dict[str, tuple[Path, Any]], stores: Path
) -> None:
    place, done = runs[line]
    assert done.returncode == 2, done.stderr
    *notes, said = done.stderr.splitlines()
    assert [note for note in notes if not note.startswith("Using the config of")] == []
    assert said.startswith("Error: this simulates or reads PyBullet's models and needs pybullet")
    assert "pip install 'grasp-factory[simulation]' (wheels: CPython up to 3.11" in said
    assert done.stdout == ""
    assert sorted(place.iterdir()) == [place / path.name for path in named(line, stores)]
    for path in named(line, stores):
        assert tree(place / path.name) == tree(path)


def test_a_recording_leaves_out_what_pybullet_draws_and_says_so(
    python: Path, here: Path, variables: dict[str, str]
) -> None:
    done = run(python, ["-m", "grasp_factory", "rerun", "panda.zarr", "0"], here, variables)
    said = done.stderr.splitlines()
    assert said[0] == (
        "Warning: robot panda is left out: its model comes with PyBullet, which is not installed"
    )
    own = run(python, ["-m", "grasp_factory", "rerun", "tiny.zarr", "0"], here, variables)
    assert "robot" not in own.stderr


def test_the_reader_and_the_examples_for_torch_work(
    python: Path, here: Path, variables: dict[str, str]
) -> None:
    code = (
        "import sys; from grasp_factory import Dataset;"
        "from grasp_factory.torch import GraspDataset;"
        "print(*(episode.checksum() for episode in Dataset('learn.zarr')));"
        "print(len(GraspDataset('learn.zarr')), *[n for n in sys.modules if 'pybullet' in n])"
    )
    done = run(python, ["-c", code], here, variables)
    assert done.returncode == 0, done.stderr
    checksums, count = done.stdout.splitlines()
    assert checksums.split() == Dataset(here / "learn.zarr").column("checksum").tolist()
    assert int(count) > 8


@pytest.fixture(scope="module")
def server(
    python: Path, stores: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Running]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        index = tmp_path_factory.mktemp("index") / "i.sqlite"
        paths = (stores / "panda.zarr", stores / "tiny.zarr")
        with browsing(*paths, "--index", index, python=python) as server:
            yield server


def test_the_page_serves_episodes_of_both_robots(server: Running) -> None:
    for store, has_arm in ((0, False), (1, True)):
        for address in ("episode/{}/0", "series/{}/0", "tactile/{}/0"):
            assert server.get(f"/api/{address.format(store)}")[0] == 200
        links = json.loads(server.get(f"/api/series/{store}/0")[1])["links"]
        assert bool(links["positions"]) == has_arm
        assert ("note" in links) != has_arm


def test_the_page_opens_an_episode_and_says_why_its_arm_is_not_drawn(server: Running) -> None:
    with chromium() as page:
        page.open(server.url)
        page.go("#/episode/0/0")
        assert page.text("arm-note").startswith("The arm is not drawn: its model comes with")
        page.until(lambda: "points" in page.text("cloud-status"))
        assert page.trouble() == []
