"""The addresses of one episode: its facts, series, pictures, clips and points."""

from __future__ import annotations

from flask import Blueprint, Response, abort, request

from grasp_factory.apps.browse import facts
from grasp_factory.apps.browse.clips import SIZES, WantedClip, no_clip
from grasp_factory.apps.browse.image_files import (
    KINDS,
    THUMB_WIDTH,
    picture,
    thumbnail,
    video_frame,
)
from grasp_factory.apps.browse.numbers import json_bytes
from grasp_factory.apps.browse.open_stores import OpenStore
from grasp_factory.apps.browse.points import cloud_bytes, visible_points
from grasp_factory.apps.browse.request_parameters import integer
from grasp_factory.apps.browse.responses import BYTES, cached_answer, json_answer
from grasp_factory.apps.browse.series import episode_series, tactile
from grasp_factory.apps.browse.site import Site
from grasp_factory.errors import GraspFactoryError
from grasp_factory.writers.zarr.header import read_array


def routes(site: Site) -> Blueprint:
    """Return the addresses of one episode."""
    pages = Blueprint("viewing", __name__)

    @pages.get("/api/episode/<n:store>/<n:row>")
    def episode(store: int, row: int) -> Response:
        site.freshness.soon()
        opened, indexed = site.store(store), site.row(store, row)
        if indexed is None:
            abort(404, f"store {store} has no episode {row}")
        return json_answer(facts.episode(opened, row, indexed))

    @pages.get("/api/series/<n:store>/<n:row>")
    def series(store: int, row: int) -> Response:
        opened, version = site.episode(store, row)
        make = lambda: json_bytes(episode_series(opened, row))  # noqa: E731
        return cached_answer(version, "application/json", make)

    @pages.get("/api/tactile/<n:store>/<n:row>")
    def touch(store: int, row: int) -> Response:
        opened, version = site.episode(store, row)
        return cached_answer(version, BYTES, lambda: tactile(opened, row))

    @pages.get("/image/<n:store>/<n:row>/<camera>/<kind>/<n:frame>.png")
    def image(store: int, row: int, camera: str, kind: str, frame: int) -> Response:
        opened, version = site.episode(store, row)
        _check_camera(opened, camera)
        if kind not in KINDS or frame > 1:
            abort(404, f"there is no such image; kinds: {', '.join(KINDS)}; frames: 0 and 1")
        return cached_answer(
            version, "image/png", lambda: picture(opened.dataset, row, camera, kind, frame)
        )

    @pages.get("/video/<n:store>/<n:row>/<camera>/<n:frame>.jpg")
    def video(store: int, row: int, camera: str, frame: int) -> Response:
        opened, version = site.episode(store, row)
        _check_camera(opened, camera)
        films = opened.arrays.get(f"videos/{camera}/rgb")
        if films is None or frame >= int(opened.dataset.value(row, "n_video")):
            abort(404, "there is no such frame")
        return cached_answer(
            version, "image/jpeg", lambda: video_frame(read_array(films, row, frame))
        )

    @pages.get("/thumb/<n:store>/<n:row>.jpg")
    def thumb(store: int, row: int) -> Response:
        opened, version = site.episode(store, row)
        camera = _asked_camera(opened) or next(iter(opened.dataset.config.cameras))
        frame = integer("frame", 0, 1)
        key = f"{version} {row} {frame} {camera} {THUMB_WIDTH} outlined"
        make = lambda: thumbnail(opened.dataset, row, camera, frame)  # noqa: E731
        return cached_answer(version, "image/jpeg", lambda: site.thumbnails.get(key, make))

    @pages.get("/clip/<n:store>/<n:row>/<camera>/<size>")
    def clip(store: int, row: int, camera: str, size: str) -> Response:
        opened, version = site.episode(store, row)
        _check_camera(opened, camera)
        if size not in SIZES:
            abort(404, f"there is no such clip; sizes: {', '.join(SIZES)}")
        is_gone = request.environ.get("waitress.client_disconnected", lambda: False)
        wanted = WantedClip(opened=opened, row=row, version=version, camera=camera, size=size)
        try:
            return cached_answer(version, BYTES, lambda: site.clips.get(wanted, is_gone))
        except GraspFactoryError as error:
            return Response(no_clip(str(error)), content_type=BYTES)

    @pages.get("/cloud/<n:store>/<n:row>/<n:frame>")
    def cloud(store: int, row: int, frame: int) -> Response:
        opened, version = site.episode(store, row)
        if frame > 1:
            abort(404, "there is no such cloud; frames: 0 and 1")
        camera = _asked_camera(opened)
        make = lambda: cloud_bytes(visible_points(opened.dataset, row, camera, frame))  # noqa: E731
        return cached_answer(version, BYTES, make)

    return pages


def _asked_camera(opened: OpenStore) -> str | None:
    """Return the camera that the request names; None if it names no camera."""
    camera = request.args.get("camera")
    if not camera:
        return None
    _check_camera(opened, camera)
    return camera


def _check_camera(opened: OpenStore, camera: str) -> None:
    cameras = opened.dataset.config.cameras
    if camera not in cameras:
        abort(404, f"there is no such camera; cameras: {', '.join(cameras)}")
