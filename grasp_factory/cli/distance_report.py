"""How far apart two episodes are, as a table for people."""

from __future__ import annotations

from grasp_factory.core.text_format import percent, table
from grasp_factory.curation.episode_distance import EpisodeDistance, ImageDistance, PoseDistance


def distance_text(found: EpisodeDistance) -> str:
    """Return a table of what differs between a recorded episode and its replay."""
    same_outcome = found.recorded == found.replayed
    longest = max(found.steps_recorded, found.steps_replayed)
    rows = [
        (
            "outcome",
            found.recorded if same_outcome else f"{found.recorded}, replayed {found.replayed}",
        ),
        (
            "records",
            f"{found.steps_differing} of {longest} differ"
            f" ({found.steps_recorded} recorded, {found.steps_replayed} replayed)",
        ),
        ("objects", _poses(found.objects_at_end, found.objects_largest)),
        ("hand", _poses(found.tcp_at_end, found.tcp_largest)),
        *((f"images {name}", _image(image)) for name, image in found.cameras.items()),
    ]
    return table([("how far apart", ""), *rows])


def _poses(at_end: PoseDistance, largest: PoseDistance) -> str:
    return f"{_pose(at_end)} at the end, {_pose(largest)} at most"


def _pose(distance: PoseDistance) -> str:
    if distance.mm is None or distance.degrees is None:
        return "none to compare"
    return f"{distance.mm:.3g} mm and {distance.degrees:.3g} degrees"


def _image(image: ImageDistance) -> str:
    text = f"{image.differing} of {image.pixels} pixels differ ({percent(image.share)})"
    if not image.depth_p99_mm:
        return text
    median, p99 = image.depth_median_mm, image.depth_p99_mm
    return f"{text}, their depth by {median:.3g} mm (median), {p99:.3g} mm (99th percentile)"
