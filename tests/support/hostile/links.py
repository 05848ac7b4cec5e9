"""Links, pipes, sockets, and second names of files."""

from __future__ import annotations

import os
import shutil
import socket
from pathlib import Path

from support.hostile.table import ATTACKS, Attack, attack, remove


def link(name: str, target: str = "docs") -> Attack:
    """Replace something in the store with a link to something of the victim."""

    def replace(store: Path, outside: Path) -> None:
        remove(store / name)
        (store / name).parent.mkdir(parents=True, exist_ok=True)
        (store / name).symlink_to(outside / target)

    return replace


def beside(suffix: str, target: str = "bashrc") -> Attack:
    """Lay a link beside the store."""

    def lay(store: Path, outside: Path) -> None:
        name = suffix.replace("NAME", store.name)
        (store.parent / name).symlink_to(outside / target)

    return lay


LINKED_FOLDERS = (
    "packed", "labels", "annotations", "episodes", "episodes/error", "episodes/status",
    "episodes/spec", "cameras", "streams", "streams/tcp_pose", "labels/gentle", "videos",
)  # fmt: skip
LINKED_FILES = (
    "zarr.json", "episodes/zarr.json", "episodes/status/zarr.json", "episodes/status/0",
    "episodes/spec/0", "labels/zarr.json", "annotations/log.jsonl", "packed/0-1.npz",
    "labels/zarr.json.partial", "annotations/zarr.json.partial", "zarr.json.partial",
    "episodes/error/zarr.json.partial", "episodes/status/0.partial", "packed/0-1.npz.partial",
    "labels/.x.creating", "signature",
)  # fmt: skip
for _name in LINKED_FOLDERS:
    ATTACKS[f"{_name} is a link"] = link(_name)
for _name in LINKED_FILES:
    ATTACKS[f"{_name} is a link to a file"] = link(_name, "bashrc")
for _name in ("NAME.runs.jsonl", ".NAME.grasp-factory.lock", ".NAME.runs.jsonl.partial"):
    ATTACKS[f"{_name} beside it is a link"] = beside(_name)
for _name in (".NAME.repairing", ".NAME.creating", "NAME.card", ".out.zarr.merging"):
    ATTACKS[f"{_name} beside it is a link to a folder"] = beside(_name, "docs")
for _name in ("zarr.json", "episodes/spec/0", "episodes/status/zarr.json", "annotations/log.jsonl"):

    def _pipe(store: Path, outside: Path, name: str = _name) -> None:
        remove(store / name)
        (store / name).parent.mkdir(exist_ok=True)
        os.mkfifo(store / name)

    def _zero(store: Path, outside: Path, name: str = _name) -> None:
        remove(store / name)
        (store / name).parent.mkdir(exist_ok=True)
        (store / name).symlink_to("/dev/zero")

    ATTACKS[f"{_name} is a pipe"] = _pipe
    ATTACKS[f"{_name} leads to /dev/zero"] = _zero


@attack("a socket is in the store")
def _(store: Path, outside: Path) -> None:
    here = Path.cwd()
    os.chdir(store / "episodes" / "status")
    with socket.socket(socket.AF_UNIX) as made:
        (store / "episodes/status/0").unlink()
        made.bind("0")
    os.chdir(here)


@attack("a chunk is a second name of the victim's file")
def _(store: Path, outside: Path) -> None:
    for name in ("episodes/spec/0", "annotations/log.jsonl"):
        remove(store / name)
        (store / name).parent.mkdir(exist_ok=True)
        os.link(outside / "bashrc", store / name)


@attack("the run log is a second name of the victim's file")
def _(store: Path, outside: Path) -> None:
    os.link(outside / "bashrc", store.with_name(f"{store.name}.runs.jsonl"))


for _name in ("lock", "shard-3-of-9.lock"):
    for _what, _content in {"empty": b"", "zeros": bytes(4096), "a lock": b"host 12\n"}.items():

        @attack(f"the {_name} is a second name of the victim's file of {_what}")
        def _(store: Path, outside: Path, name: str = _name, content: bytes = _content) -> None:
            (outside / "docs" / "image").write_bytes(content)
            (store.parent / f".{store.name}.grasp-factory.{name}").hardlink_to(
                outside / "docs" / "image"
            )


@attack("a new index is a second name of the victim's file")
def _(store: Path, outside: Path) -> None:
    for name in ("i.sqlite.building", "i.sqlite-journal"):
        (store.parents[1] / "out" / f".{name}").hardlink_to(outside / "bashrc")


for _name in (
    *("annotations/zarr.json", "annotations/zarr.json.partial", "annotations/log.jsonl"),
    *("packed/zarr.json", "packed/0-1.npz", "signature/zarr.json", "signature/SHA256SUMS"),
    *("labels/zarr.json", "labels/gentle/zarr.json", "zarr.json.partial"),
):

    @attack(f"{_name} is a folder")
    def _(store: Path, outside: Path, name: str = _name) -> None:
        (store / name).unlink(missing_ok=True)
        (store / name).mkdir(parents=True)


for _name in ("annotations", "packed", "labels", "signature", "objects", "models"):

    @attack(f"{_name} is a file")
    def _(store: Path, outside: Path, name: str = _name) -> None:
        shutil.rmtree(store / name, ignore_errors=True)
        (store / name).touch()
