"""The result of a replay, as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grasp_factory.core.text_format import escaped, joined_lines, percent, table
from grasp_factory.curation.episode_distance import EpisodeDistance, ImageDistance, PoseDistance

if TYPE_CHECKING:
    from grasp_factory.curation.replay import Replay


def replay_text(result: Replay) -> str:
    """Return the result of a replay: whether the bytes are the same, what differs, and why."""
    episode = f"episode {result.index} ({result.recorded})"
    if result.same:
        lines = [f"{episode} replays to the same bytes"]
    else:
        lines = [f"{episode} does not replay to the same bytes"]
        if result.recorded != result.replayed:
            lines.append(f"outcome: recorded {result.recorded}, replayed {result.replayed}")
        lines.append(f"first difference: {result.difference or 'the reason of the quarantine'}")
    parts = [joined_lines(lines)]
    if result.distance is not None:
        parts.append(_distance_table(result.distance))
    if result.platform:
        parts.append(escaped(f"platform: {result.platform}"))
    if result.changed:
        changes = (f"  {change}" for change in result.changed)
        parts.append(joined_lines(["changed since the recording:", *changes]))
    return "\n".join(parts)


def _distance_table(found: EpisodeDistance) -> str:
    """Return a table of the differences between a recorded episode and its replay."""
    outcome = found.recorded
    if found.replayed != found.recorded:
        outcome = f"recorded {found.recorded}, replayed {found.replayed}"
    longest = max(found.steps_recorded, found.steps_replayed)
    rows = [
        ("outcome", outcome),
        (
            "time steps",
            f"{found.steps_differing} of {longest} differ"
            f" ({found.steps_recorded} recorded, {found.steps_replayed} replayed)",
        ),
        ("objects", _poses(found.objects_at_end, found.objects_largest)),
        ("hand", _poses(found.tcp_at_end, found.tcp_largest)),
        *((f"images {name}", _image(image)) for name, image in found.cameras.items()),
    ]
    return table([("compared", "difference"), *rows])


def _poses(at_end: PoseDistance, largest: PoseDistance) -> str:
    return f"{_pose(at_end)} at the end, at most {_pose(largest)}"


def _pose(distance: PoseDistance) -> str:
    if distance.mm is None or distance.degrees is None:
        return "no pose"
    return f"{distance.mm:.3g} mm and {distance.degrees:.3g} degrees"


def _image(image: ImageDistance) -> str:
    text = f"{image.differing} of {image.pixels} pixels differ ({percent(image.share)})"
    if not image.depth_p99_mm:
        return text
    median, p99 = image.depth_median_mm, image.depth_p99_mm
    return f"{text}, in depth by {median:.3g} mm (median) and {p99:.3g} mm (99th percentile)"
