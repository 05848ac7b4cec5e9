"""The schema of the store: every array with its dimensions, type, unit, frame and meaning.

The writer, the reader, the checks and the table in docs/reference/format.md use it.
The arrays of sensors are defined in ``sensors.py``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.sensor_array import fields_of
from grasp_factory.core.enums import Outcome, label_names, names
from grasp_factory.core.field import LABELS, Field
from grasp_factory.core.field import field as _f
from grasp_factory.core.real_columns import REAL_COLUMNS
from grasp_factory.core.real_series import REAL_SERIES
from grasp_factory.core.sensors import (
    MAX_CONTACTS,
    SENSORS,
    STREAMS,
    series_groups,
)
from grasp_factory.core.series_group import SeriesGroup

__all__ = [
    "CHECKSUM",
    "DIGESTS",
    "ERROR",
    "FIELDS",
    "FINGERPRINT",
    "FORMAT",
    "FORMAT_VERSION",
    "MAX_CONTACTS",
    "NOT_IN_AN_EPISODE",
    "STATUS",
    "Field",
    "digested",
    "dimension_names",
    "expand",
    "markdown_table",
    "shape",
    "sizes",
]

FORMAT = "grasp-factory"
FORMAT_VERSION = 1

_OUTCOMES = tuple(names(Outcome))
_STATUS = ("missing", "committed", "quarantined")

STATUS = _f("episodes/status", (), "uint8", "commit marker, written last", names=_STATUS)
CHECKSUM = _f("episodes/checksum", (), "string", "SHA-256 over the episode's contents")
DIGESTS = _f(
    "episodes/array_crc32c",
    ("A",),
    "uint32",
    "CRC-32C of the episode's values of each array that the attribute arrays names",
)
FINGERPRINT = _f(
    "episodes/fingerprint", (), "string", "fingerprint of the platform that made the row"
)
ERROR = _f("episodes/error", (), "string", "why the episode is quarantined")
NOT_IN_AN_EPISODE = (STATUS.path, CHECKSUM.path, DIGESTS.path, FINGERPRINT.path, ERROR.path)
"""Arrays that describe an episode's contents but are not part of these contents."""


def _length(group: SeriesGroup) -> Field:
    return _f(
        group.length_column, (), "int32", f"valid length of {group.title}", is_real=group.is_real
    )


def _fields_of(group: SeriesGroup) -> Iterator[Field]:
    """Yield the fields of all sensors of a group."""
    for model in SENSORS.values():
        if model.group == group:
            yield from model.fields


FIELDS: tuple[Field, ...] = (
    STATUS,
    CHECKSUM,
    DIGESTS,
    FINGERPRINT,
    _f("episodes/success", (), "bool", "the label: outcome is success"),
    _f("episodes/outcome", (), "uint8", "how the attempt ended", names=_OUTCOMES,
       empty=255),
    _f("episodes/spec", (), "string", "JSON recipe: running it gives this episode again"),
    ERROR,
    _f("episodes/seed", (), "int64", "seed of the config that the recipe was drawn from",
       empty=-1),
    _f("episodes/index", (), "int64", "index of the recipe under that seed; in a store that"
       " generate made it is the row's number", empty=-1),
    *(_length(group) for group in series_groups() if not group.is_real),
    _f("episodes/object_id", (), "string", "target object"),
    _f("episodes/object_set", (), "string", "set that the target comes from"),
    _f("episodes/object_family", (), "string", "kind of shape of the target: box, mug, blob"),
    _f("episodes/split", (), "string", "train, val or test, by object"),
    _f("episodes/policy", (), "string", "policy that planned the grasp"),
    _f("episodes/grasp_proposer", (), "string",
       "policy that thought of the grasp: another one for policies that build on others"),
    _f("episodes/object_mass", (), "float64", "mass of the target", units="kg"),
    _f("episodes/object_com", ("M", 3), "float64", "centre of mass", units="m", frame="object"),
    _f("episodes/object_ids", ("M",), "string", "every object, the target first"),
    _f("episodes/object_rest_pose", ("M", 7), "float64",
       "position (m) and quat_xyzw of each object before the attempt", frame="world"),
    _f("episodes/object_settled", ("M",), "bool",
       "whether each object was at rest then; one outside the workspace need not be"),
    _f("episodes/object_displacement", ("M",), "float64",
       "way of each object's centre of mass from its rest to the end of the attempt", units="m",
       gaps=True),
    _f("episodes/object_lift", ("M",), "float64",
       "rise of each object's centre of mass by the end of the hold (or of the attempt)",
       units="m", gaps=True),
    _f("episodes/grasp_position", (3,), "float64", "executed (else first planned) TCP position",
       units="m", frame="world", gaps=True),
    _f("episodes/grasp_quat_xyzw", (4,), "float64", "its orientation: +z approaches, +y closes",
       frame="world", gaps=True),
    _f("episodes/grasp_width", (), "float64", "gripper width before closing", units="m", gaps=True),
    _f("episodes/grasp_score", (), "float64", "the policy's own figure of merit", gaps=True),
    _f("episodes/rest_height", (), "float64", "height of the target's centre of mass at rest",
       units="m", frame="world"),
    _f("episodes/lift_height", (), "float64",
       "rise of the centre of mass by the end of the hold (or of the attempt)", units="m",
       gaps=True),
    _f("episodes/slip_distance", (), "float64",
       "way of the target's centre of mass in the hand from the end of the closing to the end",
       units="m", frame="tcp", gaps=True),
    _f("episodes/slip_angle", (), "float64", "turn of the target in the hand over the same time",
       units="rad", gaps=True),
    _f("episodes/min_grip_force", (), "float64",
       "smallest normal force of either pad on the target during the hold", units="N", gaps=True),
    _f("episodes/hold_duration", (), "float64", "time held by both pads after the lift", units="s"),
    _f("episodes/shake_level", (), "float64", "highest level of the shake that it survived",
       units="9.80665 m/s2"),
    _f("episodes/loss_time", (), "float64",
       "when both pads had touched the target for the last time; NaN if they still do", units="s",
       gaps=True),
    _f("episodes/max_penetration", (), "float64",
       "deepest overlap of a pad and the target during the hold", units="m", gaps=True),
    _f("episodes/contact_area", (), "float64",
       "area that contact points span on a pad at the end of the hold, mean of both; 0 for lines",
       units="m2", gaps=True),
    _f("episodes/table_penetration", (), "float64",
       "deepest overlap of the robot and the table in the attempt", units="m"),
    _f("episodes/collision_body", (), "uint8", "what was touched, for outcome collision",
       names=LABELS),
    _f("episodes/quality", (), "uint8", "score from 1 to 5, the best, by the config's thresholds"),
    _f("episodes/sharpness", (), "float64",
       "share of the Laplacian's variance that a blur of 3 x 3 pixels takes; worst image before"),
    _f("episodes/exposure", (), "float64",
       "mean grey value, 0 black to 1 white, of the image before that is farthest from 0.5"),
    _f("episodes/clipped", (), "float64", "share of black or white pixels; worst image before"),
    _f("episodes/target_visibility", (), "float64",
       "share of the target that nothing hides before; best camera"),
    _f("episodes/target_pixels", (), "float64", "of the target before; best camera", units="px"),
    _f("episodes/depth_holes", (), "float64", "share of pixels without depth; worst image before"),
    _f("episodes/stream_gap", (), "float64",
       "longest time without a record in any series, in periods of its rate", gaps=True),
    _f("episodes/force_residual", (), "float64",
       "hand's force on the target against m (a - g), mean over the hold, of its weight",
       gaps=True),
    _f("cameras/{camera}/rgb", (2, "H", "W", 3), "uint8", "frame 0 before, 1 after"),
    _f("cameras/{camera}/depth", (2, "H", "W"), "float32", "along the optical axis", units="m"),
    _f("cameras/{camera}/segmentation", (2, "H", "W"), "uint8", "scene labels", names=LABELS),
    _f("cameras/{camera}/intrinsics", (3, 3), "float64", "K, integer coordinates at pixel samples",
       units="px"),
    _f("cameras/{camera}/T_world_camera", (2, 4, 4), "float64",
       "camera pose at each frame, OpenCV axes", units="m", frame="world"),
    _f("cameras/{camera}/visibility", (2, "M"), "float32",
       "share of each object's pixels in the image that nothing hides"),
    *_fields_of(STREAMS),
    STREAMS.series("reward", (), "float32", "1 on the last record of a success, else 0"),
    *(row for group in series_groups() if group is not STREAMS for row in _fields_of(group)),
    *REAL_COLUMNS,
    *(_length(group) for group in series_groups() if group.is_real),
    *REAL_SERIES,
)  # fmt: skip


def sizes(config: FactoryConfig, joints: int) -> Mapping[str, int]:
    """Return the length of each lettered dimension, for a config and a robot's number of joints."""
    return {group.dim: group.longest(config) for group in series_groups()} | {
        "J": joints,
        "A": len(digested(expand(config))),
        "P": MAX_CONTACTS,
        **scene_sizes(config),
    }


def scene_sizes(config: FactoryConfig) -> dict[str, int]:
    """Return the lengths of the dimensions of images and objects, the same in every version."""
    width, height = config.resolution
    scene = {"M": config.clutter.count, "H": height, "W": width}
    if config.capture:
        scene |= {"X": config.capture.taxel_rows, "Y": config.capture.taxel_columns}
    return scene


def expand(config: FactoryConfig) -> tuple[Field, ...]:
    """Return the fields of a config's store.

    Fields of cameras are repeated for each camera; groups with rate 0 are left out, and so is what
    only real episodes have, unless the config has room for these. The arrays of a plugin's sensors
    are last.
    """
    absent = tuple(group for group in series_groups() if not group.rate(config))
    may_be_real = config.capture is not None
    own = _expand(tuple(config.cameras), config.clutter.count, absent, may_be_real)
    return (*own, *fields_of(config.sensors)) if config.sensors else own


def digested(fields: Iterable[Field]) -> tuple[str, ...]:
    """Return the paths of those fields that are part of an episode's contents."""
    return tuple(row.path for row in fields if row.path not in NOT_IN_AN_EPISODE)


@lru_cache
def _expand(
    cameras: tuple[str, ...],
    objects: int,
    absent: tuple[SeriesGroup, ...],
    may_be_real: bool,
) -> tuple[Field, ...]:
    labels = tuple(label_names(objects))
    out: list[Field] = []
    for camera in ("", *cameras):
        for row in FIELDS:
            is_absent = row.is_real and not may_be_real
            if is_absent or any(_is_of(row, group) for group in absent):
                continue
            if ("{camera}" in row.path) is bool(camera):
                words = labels if row.names == LABELS else row.names
                path = row.path.format(camera=camera)
                out.append(dataclasses.replace(row, path=path, names=words))
    return tuple(out)


def _is_of(row: Field, group: SeriesGroup) -> bool:
    return row.path == group.length_column or row.path.startswith(f"{group.name}/")


def dimension_names() -> Mapping[str, str]:
    """Return the name of each lettered dimension in the store's arrays."""
    return {group.dim: group.dimension_name for group in series_groups()} | {
        "J": "joint",
        "M": "object",
        "P": "contact",
        "A": "array",
        "H": "row",
        "W": "column",
        "X": "taxel_row",
        "Y": "taxel_column",
    }


def shape(row: Field, size: Mapping[str, int]) -> tuple[int, ...]:
    """Return a field's shape without N, as numbers."""
    return tuple(size[dim] if isinstance(dim, str) else dim for dim in row.dims)


def markdown_table() -> str:
    """Return the table of the store's arrays as Markdown."""
    lines = ["| array | shape | dtype | unit | what |", "|---|---|---|---|---|"]
    for row in FIELDS:
        dims = ", ".join(str(dim) for dim in ("N", *row.dims))
        what = row.description + (f" [{row.frame}]" if row.frame else "")
        lines.append(f"| `{row.path}` | ({dims}) | {row.dtype} | {row.units} | {what} |")
    return "\n".join(lines)
