"""The addresses of a session's page: its state, images, curves, and marks of a person."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flask import Blueprint, Flask, Response, abort, request

from grasp_factory.apps.browse import static_files
from grasp_factory.apps.browse.guard import Guard
from grasp_factory.apps.browse.guarded_app import guarded_app
from grasp_factory.apps.browse.responses import json_answer
from grasp_factory.apps.session_page.session_pictures import picture
from grasp_factory.apps.session_page.session_snapshot import curves, snapshot
from grasp_factory.capture.session.events import EPISODE_END, EPISODE_START
from grasp_factory.capture.session.recorder import SessionRecorder
from grasp_factory.errors import UsageError, shown

NOTE, PAGE = "note", "page"
LONGEST_NOTE = 1000


def session_app(recorder: SessionRecorder, guard: Guard, on_look: Callable[[str], None]) -> Flask:
    """Return the application.

    Args:
        recorder: the session.
        guard: decides who may look, and who may mark and stop.
        on_look: called with each phase that a page was told.
    """
    app = guarded_app("grasp_factory.apps.session_page", guard)
    app.register_blueprint(static_files.routes("session.html"))
    app.register_blueprint(_routes(recorder, guard, on_look))
    return app


def _routes(recorder: SessionRecorder, guard: Guard, on_look: Callable[[str], None]) -> Blueprint:
    pages = Blueprint("session", __name__)
    stations = {station.name: station for station in recorder.stations}

    @pages.get("/api/session")
    def state() -> Response:
        found = snapshot(recorder)
        on_look(found["phase"])
        return json_answer(found)

    @pages.get("/api/curves")
    def latest_curves() -> Response:
        return json_answer({"curves": curves(recorder)})

    @pages.get("/image/<device>/<kind>.jpg")
    def image(device: str, kind: str) -> Response:
        latest = stations[device].statistics.latest if device in stations else None
        data = picture(latest.payload, kind) if latest else None
        if data is None:
            abort(404, "there is no such image")
        return Response(data, content_type="image/jpeg")

    @pages.post("/api/mark")
    def mark() -> Response:
        guard.check_writing(request)
        event, fields = _mark(request.get_json(silent=True))
        made = recorder.log.add(event, fields | {"by": PAGE})
        return json_answer({"event": made.event})

    @pages.post("/api/stop")
    def stop() -> Response:
        guard.check_writing(request)
        recorder.ask_to_end(PAGE)
        return json_answer({"phase": "ended"})

    return pages


def _mark(asked: Any) -> tuple[str, dict[str, Any]]:
    """Return event and fields of a mark.

    Raises:
        UsageError: if it is not one.
    """
    match asked:
        case {"event": "episode_start"}:
            return EPISODE_START, {}
        case {"event": "episode_end", "success": bool(success)}:
            return EPISODE_END, {"success": success}
        case {"event": "episode_end"}:
            return EPISODE_END, {}
        case {"event": "note", "text": str(text)} if 0 < len(text) <= LONGEST_NOTE:
            return NOTE, {"text": text}
    raise UsageError(
        f"mark: got {shown(asked)}, valid: episode_start, episode_end, or note with a text"
    )
