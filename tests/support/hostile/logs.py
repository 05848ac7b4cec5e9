"""Logs of annotations."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from support.hostile.table import ATTACKS, DEEP, ESCAPE, Attack, write

from grasp_factory.dataset.annotations import Change
from grasp_factory.dataset.annotations.lines import encode


def logged(make: Callable[[], bytes]) -> Attack:
    """Write the log of annotations."""

    def replace(store: Path, outside: Path) -> None:
        write(store / "annotations/log.jsonl", make() + b"\n")

    return replace


ATTACKS["a log of a million lines"] = logged(lambda: b"{}\n" * 1_000_000)
ATTACKS["a log with a line of 30 MB"] = logged(lambda: b'{"tag": "' + b"x" * 30_000_000 + b'"}')
ATTACKS["a log that is nested deep"] = logged(DEEP.encode)
ATTACKS["a log that is no UTF-8"] = logged(lambda: b"\xff\xfe\x00")
ATTACKS["a log with escape sequences"] = logged(json.dumps({"who": ESCAPE, "note": ESCAPE}).encode)


def _changes(kind: str, values: Iterable[Any]) -> bytes:
    """Return a log of changes of the first row."""
    when = "2026-01-31T08:15:00.250Z"
    made = (Change(when=when, who="ann", row=0, kind=kind, value=value) for value in values)
    return b"".join(map(encode, made))


def _mark(number: int) -> dict[str, Any]:
    place = {"camera": "front", "frame": 0, "shape": "point", "pixels": [1.0, 2.0]}
    return {"id": f"{number:012x}", "label": "", **place}


ATTACKS["a log of 70000 tags of a row"] = logged(lambda: _changes("tag", map(str, range(70_000))))
ATTACKS["a log of 35000 marks of a row"] = logged(
    lambda: _changes("mark", map(_mark, range(35_000)))
)
ATTACKS["a log of 70000 changes"] = logged(lambda: _changes("quality", [1, 2]) * 35_000)
