"""The command that blurs faces and licence plates in a session: ``capture blur``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say, say_lines, show_status
from grasp_factory.core.optional import require
from grasp_factory.core.text_format import count

if TYPE_CHECKING:
    from grasp_factory.capture.privacy.blur_job import BlurResult

_EVERY_S = 30.0
"""Seconds between lines where stderr is no terminal."""


@click.command(
    cls=Command,
    examples=(
        "grasp-factory capture blur session_1 session_1_blurred",
        "grasp-factory capture blur session_1 blurred --plates plates.onnx --report",
        "grasp-factory capture blur session_1 blurred --delete-original",
    ),
)
@click.argument("session", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@option(
    "--plates",
    metavar="MODEL.onnx",
    type=click.Path(path_type=Path),
    help="Also blur the licence plates that this model finds.",
)
@option(
    "--threshold",
    type=float,
    default=0.2,
    show_default=True,
    metavar="SCORE",
    help="Least score of a face; a lower one finds more.",
)
@option(
    "--scale",
    type=float,
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="Search images of this size; 0.5 is faster and finds less.",
)
@option("--report", "with_picture", is_flag=True, help="Also write a picture of what was blurred.")
@option(
    "--delete-original",
    is_flag=True,
    help="Delete SESSION when OUT is complete and was compared with it.",
)
@AS_JSON
def blur(
    session: Path,
    out: Path,
    *,
    plates: Path | None,
    threshold: float,
    scale: float,
    with_picture: bool,
    delete_original: bool,
    as_json: bool,
) -> None:
    """Blur faces and licence plates in a session.

    Writes a new session to the folder OUT, in which all that is found in the images of all cameras
    is a mosaic. Everything else is copied byte for byte. OUT must not exist; it appears when it is
    complete. privacy.json in it says what was found in which image.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.privacy.blur_settings import BlurSettings
    from grasp_factory.capture.privacy.blurring import blur_session

    settings = BlurSettings(face_threshold=threshold, scale=scale, plates=plates)
    progress = _StageProgress()
    try:
        found = blur_session(
            session, out, settings, delete_original=delete_original, on_progress=progress.show
        )
    finally:
        progress.close()
    if with_picture:
        _write_picture(out, found)
    if as_json:
        print_json(found.report)
    else:
        say_lines(_lines(out, found, session if delete_original else None))


def _write_picture(out: Path, found: BlurResult) -> None:
    from grasp_factory.apps.pictures.covered_sheet import draw_covered
    from grasp_factory.apps.pictures.sheet import write_png

    title = f"{found.report.session}: {count(found.report.changed, 'image')} changed"
    write_png(out / "privacy.png", draw_covered(found.pictures, title))


def _lines(out: Path, found: BlurResult, deleted: Path | None) -> Iterator[str]:
    report = found.report
    whats = [model.what for model in report.models]
    boxes = ", ".join(count(report.total(what), what) for what in whats)
    yield f"{out}: {boxes} found, {count(report.changed, 'image')} changed"
    for camera in report.cameras:
        each = ", ".join(count(camera.found[what], what) for what in whats)
        yield f"{camera.topic}: {each} in {count(len(camera.frames), 'image')} of {camera.images}"
        left = sum(camera.left.values())
        if left:
            yield f"{camera.topic}: {left} still found after the mosaic: look at these images"
    for name in report.left_out:
        yield f"{name}: not copied, because it may have images"
    if report.consent.given != "yes":
        yield f"consent of the people in the images: {report.consent.given}"
    if deleted:
        yield f"{deleted}: deleted"


class _StageProgress:
    """Shows the stage and per cent: in place on a terminal, else a line from time to time."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._stage, self._next = "", 0.0

    def show(self, progress: tuple[str, int]) -> None:
        """Show a stage and its per cent."""
        stage, percent = progress
        if self._is_terminal:
            show_status(f"{stage}: {percent} %")
        elif stage != self._stage or time.monotonic() >= self._next:
            say(f"{stage}: {percent} %", err=True)
            self._next = time.monotonic() + _EVERY_S
        self._stage = stage

    def close(self) -> None:
        """Remove the line from a terminal."""
        if self._is_terminal:
            show_status("")
