"""The board's corners in a folder of images, or in the images of a session or a bag."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.calibration.board import BoardSettings, BoardView, find_board
from grasp_factory.capture.calibration.document import read_bytes
from grasp_factory.capture.calibration.recorded_messages import message_file, messages_of
from grasp_factory.core.executors.base import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.image_size import check_pixels
from grasp_factory.core.optional import require
from grasp_factory.errors import CaptureError, UsageError, shown

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_IMAGE = "sensor_msgs/msg/Image"
_ENCODINGS = {"rgb8": 3, "bgr8": 3, "mono8": 1}
_MOST_BYTES = 64 * 2**20
"""Of an image file."""
_MOST_IMAGES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewsJob:
    """The task of the process that looks for the board."""

    source: Path
    board: BoardSettings
    topic: str
    most: int
    """Images that are looked at; of more, evenly spread ones."""


def board_views(
    source: Path,
    board: BoardSettings,
    *,
    topic: str = "",
    most: int = 100,
    on_image: Callable[[], None] = lambda: None,
) -> list[BoardView]:
    """Return what each image shows of the board; a process with limits reads them.

    Args:
        source: a folder of images, the folder of a session, or an MCAP file or bag.
        board: the board.
        topic: of a session or bag; empty if there is one topic of images.
        most: images that are looked at.
        on_image: called after each image.

    Raises:
        UsageError: if the source cannot be opened, or has no images.
        CaptureError: if an image cannot be decoded.
    """
    if message_file(source) is not None:
        require("rosbags", extra="ros")
    job = ViewsJob(source=source, board=board, topic=topic, most=most)
    found: list[BoardView] = in_import_process(views_in, job, source, lambda _: on_image())
    return found


def views_in(job: ViewsJob, report: SendMessage) -> list[BoardView]:
    """Do the job of ``board_views``."""
    file = message_file(job.source)
    images = _recorded(file, job) if file is not None else _in_folder(job)
    views = []
    for name, image in images:
        views.append(find_board(image, name, job.board))
        report(len(views))
    return views


def image_names(folder: Path) -> list[str]:
    """Return the names of the images in a folder, sorted.

    Raises:
        UsageError: if it is no folder, or has no images or too many.
    """
    try:
        names = sorted(n for n in os.listdir(folder) if Path(n).suffix.lower() in SUFFIXES)
    except OSError as error:
        raise UsageError(f"{folder} cannot be read: {error.strerror or error}") from None
    if not 1 <= len(names) <= _MOST_IMAGES:
        valid = f"1 to {_MOST_IMAGES} files {', '.join(SUFFIXES)}, or a session"
        raise UsageError(f"{folder}: got {len(names)} images, valid: {valid}")
    return names


def _in_folder(job: ViewsJob) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    for name in _spread(image_names(job.source), job.most):
        data = read_bytes(job.source / name, _MOST_BYTES)
        try:
            check_pixels(data, job.source / name)
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        except (cv2.error, ValueError):
            image = None
        if image is None:
            raise CaptureError(
                f"{job.source / name} is no PNG, JPEG, BMP or TIFF image that can be read"
            )
        yield name, np.asarray(image, np.uint8)


def _recorded(file: Path, job: ViewsJob) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    count = sum(1 for _ in messages_of(file, (_IMAGE,), job.topic))
    wanted = set(_spread(list(range(count)), job.most))
    for number, (time, message) in enumerate(messages_of(file, (_IMAGE,), job.topic)):
        if number in wanted:
            yield f"image {number} at {time:.3f} s", _grey(file, message)


def _grey(file: Path, message: Any) -> NDArray[np.uint8]:
    encoding, height, width = message.encoding, message.height, message.width
    channels = _ENCODINGS.get(encoding)
    if channels is None:
        valid = ", ".join(_ENCODINGS)
        raise CaptureError(f"{file}: images of encoding {shown(encoding)}, valid: {valid}")
    data = np.asarray(message.data, np.uint8)
    used = width * channels
    if not used or message.step < used or data.size < message.step * height:
        raise CaptureError(f"{file}: an image has fewer bytes than its size needs")
    rows = data[: message.step * height].reshape(height, message.step)[:, :used]
    if channels == 1:
        return np.ascontiguousarray(rows)
    colour = np.ascontiguousarray(rows).reshape(height, width, channels)
    code = cv2.COLOR_RGB2GRAY if encoding == "rgb8" else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(colour, code), np.uint8)


def _spread(items: list[Any], most: int) -> list[Any]:
    if len(items) <= most:
        return items
    return [items[k] for k in np.linspace(0, len(items) - 1, most).round().astype(int)]
