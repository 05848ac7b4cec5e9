"""The third pass: the new session is the old one but for the covered parts of its images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from grasp_factory.capture.privacy.camera_images import camera_image, is_camera_image
from grasp_factory.capture.session_reader import SessionMessage, SessionReader
from grasp_factory.errors import CaptureError, shown


def check_copy(
    old: SessionReader,
    new: SessionReader,
    changed: Mapping[str, int],
    on_message: Callable[[], None],
) -> None:
    """Compare a blurred session with its original, message by message.

    Args:
        old: the original.
        new: the blurred one, with one more event at its end.
        changed: how many images of each topic of colour images may differ.
        on_message: called after each message.

    Raises:
        CaptureError: if a message is missing, or something else than pixels differs.
    """
    copies, differing = new.messages(), Counter[str]()
    for message in old.messages():
        copy = next(copies, None)
        if copy is None or _place(copy) != _place(message):
            raise _wrong(new, message.topic.name)
        if copy.data != message.data:
            _check_image(new, message, copy)
            differing[message.topic.name] += 1
        on_message()
    if sum(1 for _ in copies) != 1:
        raise _wrong(new, "the end")
    for name, count in changed.items():
        if differing[name] > count:
            raise _wrong(new, name)


def _check_image(new: SessionReader, message: SessionMessage, copy: SessionMessage) -> None:
    if not is_camera_image(message.topic):
        raise _wrong(new, message.topic.name)
    before, after = camera_image(message), camera_image(copy)
    if before.pixels.shape != after.pixels.shape:
        raise _wrong(new, message.topic.name)
    after.pixels[:] = before.pixels
    if after.message() != before.message():
        raise _wrong(new, message.topic.name)


def _place(message: SessionMessage) -> tuple[object, ...]:
    return message.topic, message.log_time_ns, message.publish_time_ns, message.sequence


def _wrong(new: SessionReader, what: str) -> CaptureError:
    return CaptureError(
        f"{new.path}: the blurred session differs from its original in {shown(what)} where it must"
        " not; nothing was changed"
    )
