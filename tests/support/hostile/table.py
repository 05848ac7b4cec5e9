"""The table of attacks: what a hostile store, or something beside it, could contain."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grasp_factory.core.place import place_at
from grasp_factory.writers.zarr.metadata_checksum import SEAL, write_sealed

Attack = Callable[[Path, Path], None]
ESCAPE = "\x1b]0;owned\x07\x1b[2J\x9b31m"
FORMULA = '=HYPERLINK("http://evil.example","open")'
ATTACKS: dict[str, Attack] = {}
GB = 2**30
DEEP = "[" * 200_000 + "]" * 200_000
BYTES = {"name": "bytes", "configuration": {"endian": "little"}}


def attack(name: str) -> Callable[[Attack], Attack]:
    """Add an attack to the table."""

    def add(function: Attack) -> Attack:
        ATTACKS[name] = function
        return function

    return add


def victim(folder: Path) -> Path:
    """Make the folder of a victim, with files that a link may lead to."""
    outside = folder / "home"
    (outside / "docs").mkdir(parents=True)
    (outside / "bashrc").write_text("# mine\n")
    for name in ("0-0.npz", "0-1.npz", "zarr.json", "report.partial", "0", "0.0", "log.jsonl"):
        (outside / "docs" / name).write_text("precious\n")
    return outside


def edited(name: str, change: Callable[[dict[str, Any]], Any]) -> Attack:
    """Change the metadata of an array or group, and seal it again."""

    def edit(store: Path, outside: Path) -> None:
        file = store / name / "zarr.json"
        document = json.loads(file.read_text())
        changed = change(document)
        document = document if changed is None else changed
        if isinstance(document, dict) and SEAL in document.get("attributes", {}):
            write_sealed(place_at(file), document)
        else:
            file.write_text(json.dumps(document))

    return edit


def configured(**more: Any) -> Attack:
    """Change values of the config that the store claims to be made from, and its digest."""

    def change(document: dict[str, Any]) -> None:
        attributes = document["attributes"]
        attributes["config"].update(more)
        text = json.dumps(attributes["config"], sort_keys=True, separators=(",", ":"))
        attributes["config_sha256"] = hashlib.sha256(text.encode()).hexdigest()

    return edited("", change)


def coded(name: str, codecs: Any) -> Attack:
    """Change the codecs of an array."""
    return edited(name, lambda document: document.update(codecs=codecs))


def write(file: Path, data: bytes) -> None:
    """Write a file, in a folder that may be new."""
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(data)


def remove(path: Path) -> None:
    """Remove a file, a link or a folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
