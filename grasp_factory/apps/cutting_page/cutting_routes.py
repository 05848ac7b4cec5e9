"""The addresses of the page on which a session is cut: what it shows, its pictures, its list."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np
from flask import Blueprint, Flask, Response, abort, request

from grasp_factory.apps.browse import static_files
from grasp_factory.apps.browse.guard import Guard
from grasp_factory.apps.browse.guarded_app import guarded_app
from grasp_factory.apps.browse.responses import json_answer
from grasp_factory.apps.cutting_page.cutting_document import CuttingDocument
from grasp_factory.apps.cutting_page.preview_images import Previews
from grasp_factory.capture.importing.cut_overview import CutOverview, OverviewCurve
from grasp_factory.capture.importing.cuts import Cut, cut_of
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.errors import UsageError, shown

UNITS = {"force": "N", "angular_velocity": "rad/s"}
"""Units of curves that have none in ``SHOWN_UNITS``."""
_LONGEST_TEXT = 100


def cutting_app(
    overview: CutOverview, previews: Previews, document: CuttingDocument, guard: Guard
) -> Flask:
    """Return the application.

    Args:
        overview: the session.
        previews: its pictures.
        document: the list of episodes.
        guard: decides who may look, and who may write.
    """
    app = guarded_app("grasp_factory.apps.cutting_page", guard)
    app.register_blueprint(static_files.routes("cutting.html"))
    app.register_blueprint(_routes(overview, previews, document, guard))
    return app


def _routes(
    overview: CutOverview, previews: Previews, document: CuttingDocument, guard: Guard
) -> Blueprint:
    pages = Blueprint("cutting", __name__)

    @pages.get("/api/cutting")
    def state() -> Response:
        return json_answer(_state(overview, document))

    @pages.get("/api/previews")
    def times() -> Response:
        found = {name: list(values) for name, values in list(previews.times_s.items())}
        is_done, trouble = previews.is_done, previews.trouble
        return json_answer({"times": found, "done": is_done, "trouble": trouble})

    @pages.get("/preview/<camera>/<int:number>.jpg")
    def preview(camera: str, number: int) -> Response:
        data = previews.picture(camera, number)
        if data is None:
            abort(404, "there is no such picture")
        return Response(data, content_type="image/jpeg")

    @pages.post("/api/cuts")
    def save() -> Response:
        guard.check_writing(request)
        document.save(_asked_cuts(request.get_json(silent=True)))
        return json_answer({"cuts": [_plain(cut) for cut in document.cuts()]})

    return pages


def _state(overview: CutOverview, document: CuttingDocument) -> dict[str, Any]:
    contents = overview.contents
    session, file = shlex.quote(contents.path), shlex.quote(str(document.file))
    return {
        "name": contents.name,
        "path": contents.path,
        "file": str(document.file),
        "command": f"grasp-factory capture import {session} --out real.zarr --cuts {file}",
        "duration_s": overview.duration_s,
        "cameras": list(overview.cameras),
        "curves": [_curve(curve) for curve in overview.curves],
        "events": [
            {"name": event.name[:_LONGEST_TEXT], "at": overview.since_start(event.time_ns)}
            for event in overview.events
        ],
        "proposals": {
            method.name.lower(): [_plain(cut, overview.start_ns) for cut in cuts]
            for method, cuts in overview.proposals.items()
        },
        "outcomes": list(names(Outcome)),
        "cuts": [_plain(cut) for cut in document.cuts()],
    }


def _curve(curve: OverviewCurve) -> dict[str, Any]:
    shown_unit = SHOWN_UNITS.get(curve.name)
    factor = shown_unit.factor if shown_unit else 1.0
    return {
        "name": curve.name,
        "unit": shown_unit.unit if shown_unit else UNITS[curve.name],
        "times": np.round(curve.times_s, 4).tolist(),
        "values": [float(f"{factor * value:.5g}") for value in curve.values],
    }


def _plain(cut: Cut, origin_ns: int = 0) -> list[Any]:
    """Return start and end of an episode in seconds, to 1 ms inwards, and its outcome."""
    start_ms = -((origin_ns - cut.start_ns) // 1_000_000)
    end_ms = (cut.end_ns - origin_ns) // 1_000_000
    return [start_ms / 1e3, end_ms / 1e3, cut.outcome]


def _asked_cuts(asked: Any) -> list[Cut]:
    """Return the cuts of a request.

    Raises:
        UsageError: if one is wrong, by its number.
    """
    match asked:
        case {"cuts": [*rows]}:
            return [_asked_cut(number, row) for number, row in enumerate(rows, 1)]
    raise UsageError("cuts: valid: a list of [start, end, outcome]")


def _asked_cut(number: int, row: Any) -> Cut:
    match row:
        case [int() | float() as start, int() | float() as end, str(outcome)]:
            return cut_of(start, end, outcome, f"episode {number}")
    raise UsageError(f"episode {number}: got {shown(row)}, valid: [start, end, outcome]")
