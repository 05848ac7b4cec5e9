"""Commands on hostile stores: each is refused in a line, or harmless, and nothing else happens.

A normal run does one command for each attack in turn, in this process. The soak does all of them,
each in a process of its own whose time and memory are measured, without the imports.
"""

from __future__ import annotations

import itertools
import multiprocessing
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from support.damage import CONFIG, make_store
from support.hostile import ATTACKS, victim
from support.measured_commands import run_apart
from support.scale import IS_SOAK, sampled

from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.cli.main import COMMANDS
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import fresh
from grasp_factory.errors import GraspFactoryError, StoreError

pytestmark = pytest.mark.slow

LINES: Mapping[str, tuple[str, ...]] = {
    "info": ("{store}",),
    "verify": ("{store} --workers 1",),
    "snapshot": ("{store} --message x",),
    "log": ("{store}",),
    "diff": ("{store} {store} --arrays",),
    "provenance": ("{store}",),
    "pack": ("{store} {out}/packed.zarr --shard 8",),
    "query": ("{store} --csv", "{store} --count"),
    "tags": ("{store}",),
    "tag": ("{store} --ids {ids} --add odd",),
    "relabel": ("{store} --name other --min-shake 0.5",),
    "card": ("{store}", "{store} --out {out}/card"),
    "merge": ("{out}/m.zarr {store}",),
    "split": ("{store} {out}/split.zarr --ids {ids}",),
    "sheet": ("{store} {out}/s.png",),
    "plot": ("{store} 0 {out}/p.png",),
    "rerun": ("{store} 0 --out {out}/r.rrd",),
    "export": ("{store} {out}/export --to webdataset", "{store} {out}/bop --to bop"),
    "repair": ("{store} --workers 1",),
    "index": ("{store} --out {out}/i.sqlite",),
    "sign": ("{store} --key {key}",),
    "train": ("{store} --out {out}/models --epochs 1",),
    "learning-curve": ("{store} --out {out}/curve --sizes 4 --seeds 1 --epochs 1",),
    "browse": (),  # below
}
"""What is run on each attack, by command."""
SIMULATING: Mapping[str, tuple[str, ...]] = {
    "replay": ("{store} 0", "{store} 0 --video {out}/v.mp4"),
    "verify": ("{store} --deep 1 --workers 1",),
    "generate": ("--config {config} --n 10 --workers 1 --out {store}",),
    "capture": ("demo {store} --out {out}/session", "publish {store} 0 --rate max --wait 0.1"),
}
"""What may simulate a recipe or play an episode, and takes longer."""
WITHOUT_STORE = {
    *("preview", "objects", "robots", "policies", "cameras", "sensors", "check-physics"),
    *("flywheel", "import", "calibrate", "conformance"),
}
"""Commands that read no store of others; tests/curation/test_restore.py imports hostile exports."""
PAGES = (
    *("api/library", "api/episodes", "api/ids", "api/histogram?column=outcome", "api/live"),
    *("api/neighbours/0/{row}", "api/episode/0/{row}", "api/series/0/{row}", "thumb/0/{row}.jpg"),
    *("api/tactile/0/{row}", "image/0/{row}/front/rgb/0.png", "image/0/{row}/front/depth/1.png"),
    *("video/0/{row}/front/0.jpg", "cloud/0/{row}/0"),
)
"""What the page is asked for."""
RECIPES = [name for name in ATTACKS if "row with a recipe" in name]
FEW_RECIPES = 2
USUAL = 100
"""Attacks in a normal run; a soak runs all of them."""
MOST_S, MOST_KB = 10.0, 1_000_000
TOLD = (" is complete: ", " already has the ", "Using the config of ")
"""What is said of a run that is no error."""


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store, beside which there is a ``key``."""
    folder = tmp_path_factory.mktemp("honest")
    (folder / "key").touch()
    if shutil.which("ssh-keygen"):
        (folder / "key").unlink()
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / "key")]
        subprocess.run(command, check=True)
    return make_store(folder / "s.zarr")


@pytest.fixture
def place(honest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a store in ``data``, an empty ``out``, and the files that commands name."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    for name in ("data", "out"):
        (tmp_path / name).mkdir()
    shutil.copytree(honest, tmp_path / "data" / "s.zarr")
    (tmp_path / "ids").write_text("0\n1\n")
    (tmp_path / "config").write_text(yaml.safe_dump(to_plain(CONFIG)))
    shutil.copy(honest.with_name("key"), tmp_path / "key")
    monkeypatch.chdir(tmp_path / "out")
    yield tmp_path
    subprocess.run(["rm", "-rf", str(tmp_path)], check=True)  # rmtree cannot remove deep folders


def state(folder: Path) -> dict[str, Any]:
    """Return all of a folder: types, times and contents."""
    out: dict[str, Any] = {}
    for file in folder.rglob("*"):
        found = file.lstat()
        content = file.read_bytes() if file.is_file() else None
        out[str(file.relative_to(folder))] = (found.st_mode, found.st_mtime_ns, content)
    return out


def command_lines(table: Mapping[str, tuple[str, ...]]) -> list[str]:
    """Return the lines of a table, each with its command."""
    return [f"{command} {line}" for command, lines in table.items() for line in lines]


def arguments(line: str, place: Path) -> list[str]:
    """Return the arguments of a command line."""
    parts = {name: place / name for name in ("out", "ids", "config", "key")}
    return [part.format(store=place / "data" / "s.zarr", **parts) for part in line.split()]


def check(code: int, out: str, err: str) -> None:
    """Check what a command has said."""
    assert code in (0, 1, 2)
    assert "Traceback" not in err
    lines = [line for line in err.splitlines() if not line.startswith("Warning: ")]
    errors = [line for line in lines if not any(told in line for told in TOLD)]
    assert code == 0 or out or len(errors) == 1, err
    assert not {"\x1b", "\x9b", "\x07"} & set(out + err)
    assert "precious" not in out + err


def check_page(store: Path, folder: Path) -> None:
    """Check that the page of a store answers each request, or says in a line why it cannot."""
    try:
        with fresh([store], folder / "index.sqlite") as index:
            app = create_app(index, "", {"localhost"}, thumbnails=Thumbnails(folder))
            for row, page in itertools.product((0, 5, 9), PAGES):
                answer = app.test_client().get("/" + page.format(row=row))
                assert answer.status_code in (200, 304, 400, 404, 409, 413, 503), page
    except GraspFactoryError as error:
        assert "\n" not in str(error)


@pytest.mark.usefixtures("isolated")
@pytest.mark.parametrize("name", sampled(RECIPES, FEW_RECIPES))
def test_the_clip_of_a_hostile_recipe_ends_with_its_process(name: str, place: Path) -> None:
    store, outside = place / "data" / "s.zarr", victim(place)
    ATTACKS[name](store, outside)
    before = state(outside)
    with fresh([store], place / "out" / "index.sqlite") as index:
        app = create_app(index, "", {"localhost"}, thumbnails=Thumbnails(place / "out"))
        answer = app.test_client().get("/clip/0/0/front/small")
    assert answer.status_code in (200, 400, 404, 503)
    if answer.status_code == 200 and answer.data[:4] == bytes(4):
        assert b"\n" not in answer.data
        assert not {0x1B, 0x07} & set(answer.data)
    assert multiprocessing.active_children() == []
    assert state(outside) == before


def test_every_command_that_reads_a_store_meets_the_attacks() -> None:
    commands = {command.name for several in COMMANDS.values() for command in several}
    assert commands == {*LINES, *SIMULATING, *WITHOUT_STORE}


@pytest.mark.parametrize("name", sampled(ATTACKS, USUAL))
def test_an_attack_does_no_harm(
    name: str, place: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    store, outside = place / "data" / "s.zarr", victim(place)
    ATTACKS[name](store, outside)
    before = state(outside)
    lines = ["browse", *command_lines(LINES)]
    turn = list(ATTACKS).index(name) % len(lines)
    for line in lines if IS_SOAK else [lines[turn]]:
        with np.errstate(all="ignore"):  # its warnings would be errors here
            if line == "browse":
                check_page(store, place / "out")
            else:
                check(*run(*arguments(line, place)))
        assert state(outside) == before


def test_a_recipe_of_another_config_is_refused_wherever_it_is_read(place: Path) -> None:
    store = place / "data" / "s.zarr"
    ATTACKS["a whole row with a recipe with another camera"](store, victim(place))
    with pytest.raises(StoreError, match=r"episode 0 is damaged: spec\.cameras: got \['other'\]"):
        Dataset(store).spec(0)
    check_page(store, place / "out")


@pytest.mark.soak
@pytest.mark.skipif(not IS_SOAK, reason="each command in a process of its own")
@pytest.mark.parametrize(
    "line", [*command_lines(LINES), *command_lines(SIMULATING)] if IS_SOAK else []
)
@pytest.mark.parametrize("name", ATTACKS if IS_SOAK else [])
def test_no_command_takes_long_or_much_memory_on_an_attack(
    name: str, line: str, place: Path
) -> None:
    store, outside = place / "data" / "s.zarr", victim(place)
    ATTACKS[name](store, outside)
    before = state(outside)
    done = run_apart(arguments(line, place), place)
    check(done.code, done.out, done.err)
    assert state(outside) == before
    assert done.peak_kb < MOST_KB
    assert done.seconds < MOST_S
