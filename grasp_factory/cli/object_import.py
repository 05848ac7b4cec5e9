"""The import of a user's own object folders, with messages for the command line."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from grasp_factory.cli.printing import say, show_status
from grasp_factory.errors import UsageError, lookup
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.objects.importing import FolderReport, import_folder
from grasp_factory.robots import ROBOTS

WARNINGS = 10
"""Objects whose warnings are printed before a run; `grasp-factory objects` prints all."""
_LONGEST_STEM = 48
"""Bytes of the folder's name in the name of its set."""


def import_for(path: Path, robot: str, taken: Iterable[str] = ()) -> FolderReport:
    """Import a folder for a robot's gripper; show progress where stderr is a terminal.

    Args:
        path: The folder.
        robot: A name of ``ROBOTS``.
        taken: Set names of other folders.

    Raises:
        UsageError: for a folder that cannot be imported.
        UnknownNameError: for an unknown robot.
    """
    widest = lookup(ROBOTS, "robot", robot).gripper.max_width
    name = _set_name(path, taken)
    return import_folder(path, name, widest, _progress if sys.stderr.isatty() else None)


def import_usable(path: Path, robot: str, taken: Iterable[str] = ()) -> FolderReport:
    """Import a folder and report on stderr which files cannot be used.

    Raises:
        UsageError: for a folder that cannot be imported or has no usable object.
    """
    report = import_for(path, robot, taken)
    for warning in report.warnings:
        say(f"{path}: {warning}", err=True)
    for refusal in report.refused:
        say(f"{path}: {refusal.file} is skipped: {refusal.reason}", err=True)
    warned = [(item.file, "; ".join(item.warnings)) for item in report.usable if item.warnings]
    for file, warning in warned[:WARNINGS]:
        say(f"{path}: {file}: {warning}", err=True)
    if len(warned) > WARNINGS:
        more = f"{len(warned) - WARNINGS} more warnings; see `grasp-factory objects {path}`"
        say(f"{path}: {more}", err=True)
    if not report.usable:
        raise UsageError(f"{path}: no usable object; see `grasp-factory objects {path}`")
    return report


def _set_name(path: Path, taken: Iterable[str]) -> str:
    """Return a valid set name that is not taken yet, made from the folder's name."""
    name = re.sub(r"\W", "_", Path(os.path.realpath(path)).name) or "objects"
    name = name.encode()[:_LONGEST_STEM].decode(errors="ignore")
    if name[0].isdigit():
        name = f"_{name}"
    used = {*OBJECT_SETS, *taken}
    while name in used:
        name += "_"
    return name


def _progress(done: int, total: int, file: str) -> None:
    text = f"importing {done + 1} of {total}: {file[:60]}" if file else ""
    show_status(text)
