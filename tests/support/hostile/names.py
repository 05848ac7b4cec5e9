"""Files and folders with odd names."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from support.hostile.table import ATTACKS, ESCAPE, attack, write

for _name in (
    f"episodes/status/{'9' * 30}", f"episodes/status/{'9' * 200}", "episodes/status/007",
    "episodes/status/\u0663", "episodes/status/\u00b2", f"packed/0-{'9' * 30}.npz",
    f"packed/{'9' * 100}-{'9' * 101}.npz", "packed/9-1.npz", f"labels/{'x' * 250}",
    "labels/a\nb", "streams/\x1b[2J", f"videos/{'9' * 30}.0.0.0.0",
):  # fmt: skip
    ATTACKS[f"a file is called {_name[:40]!r}"] = lambda s, o, name=_name: write(s / name, b"x")


@attack("a label with a name that is a path")
def _(store: Path, outside: Path) -> None:
    (store / "labels/gentle").rename(store / "labels/..x")


@attack("a label with a name of escape sequences")
def _(store: Path, outside: Path) -> None:
    (store / "labels/gentle").rename(store / f"labels/{ESCAPE}")


@attack("20,000 folders in it")
def _(store: Path, outside: Path) -> None:
    for i in range(20_000):
        (store / "labels" / f"l{i}").mkdir()


@attack("40,000 files beside the labels")
def _(store: Path, outside: Path) -> None:
    for i in range(20_000):
        (store / "labels" / f".l{i}").touch()
        (store / "labels" / f"l{i}").touch()


@attack("200 labels")
def _(store: Path, outside: Path) -> None:
    for i in range(200):
        shutil.copytree(store / "labels" / "gentle", store / "labels" / f"l{i}")


@attack("folders 1,000 deep in it")
def _(store: Path, outside: Path) -> None:
    here = os.open(store / "labels", os.O_RDONLY)
    for _ in range(1000):
        os.mkdir("d", dir_fd=here)
        below = os.open("d", os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = below
    os.close(here)


@attack("files with names of escape sequences")
def _(store: Path, outside: Path) -> None:
    (store / f"episodes/{ESCAPE}").write_text("x")
    (store / "episodes/a\nb").write_text("x")
    (store / "labels" / ESCAPE).write_text("x")
