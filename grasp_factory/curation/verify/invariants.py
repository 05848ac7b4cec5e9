"""Checks that every episode must pass, for all random draws, once its checksum matches.

Each check yields (array, what is wrong) pairs.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Intrinsics
from grasp_factory.core.enums import UNKNOWN
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.finite_check import non_finite
from grasp_factory.core.real_columns import SOURCE, is_real
from grasp_factory.curation.verify.derived_values import label_faults
from grasp_factory.curation.verify.partial_store import PartialStore
from grasp_factory.curation.verify.problems import Fault
from grasp_factory.curation.verify.real_values import real_faults
from grasp_factory.curation.verify.time_series import series_faults
from grasp_factory.dataset.row_codec import Row
from grasp_factory.errors import shown
from grasp_factory.labels.quality import BEST, WORST
from grasp_factory.labels.rule import Measurements
from grasp_factory.writers.zarr.header import SOURCES

UNIT = 1e-5
"""Tolerance of a quaternion's norm in single precision, and of a rotation matrix."""
FAR = 1e-6
"""Relative tolerance: the renderer's depth of a point at ``far`` is ``far`` except for rounding."""
_NOT_NEGATIVE = (
    *("object_displacement", "table_penetration", "grasp_width"),
    *(field.name for field in dataclasses.fields(Measurements) if field.name != "lift_height"),
)


def faults(contents: Row, pieces: PartialStore, i: int) -> Iterator[Fault]:
    """Yield the path of each array of an episode with an impossible value, and what is wrong.

    Args:
        contents: The episode's arrays by path, unpadded, all of them.
        pieces: The store.
        i: The episode's row.
    """
    try:
        spec = EpisodeSpec.from_json(str(contents["episodes/spec"]))
    except (ValueError, RecursionError) as error:
        yield "episodes/spec", f"no recipe: {error}"
        return
    yield from _recipe_faults(contents, spec, pieces, i)
    if pieces.lacks_arrays:
        yield from _range_faults(contents)
        return  # the next checks read arrays that an export may not hold
    path = non_finite(contents, pieces.fields.values())
    if path:
        yield path, "holds infinity, or NaN where it has no meaning"
        return  # the next checks compute with these numbers
    if is_real(contents) != (spec.recording is not None):
        yield SOURCE, "says another origin of the episode than its recipe"
        return
    yield from _code_faults(contents, pieces)
    if spec.recording is not None:
        yield from real_faults(contents, spec)
        return
    yield from _range_faults(contents)
    yield from _pose_faults(contents)
    for camera in pieces.config.cameras:
        yield from _camera_faults(contents, camera, spec, pieces)
    yield from series_faults(contents, spec)
    yield from label_faults(contents, spec)


def _recipe_faults(
    contents: Row, spec: EpisodeSpec, pieces: PartialStore, i: int
) -> Iterator[Fault]:
    """Compare the recipe with the columns that repeat it, and with its place in the store."""
    target = spec.objects[0]
    wanted: dict[str, Any] = {
        "seed": spec.seed,
        "index": spec.index,
        "object_id": target.object_id,
        "object_set": target.object_set,
        "object_family": target.family,
        "split": target.split,
        "policy": spec.policy,
    }
    ids = [recipe.object_id for recipe in spec.objects]
    if spec.recording is None:
        wanted |= {"object_mass": target.mass, "object_ids": ids}
    else:  # of a real scene, only the target is known
        wanted["object_ids"] = ids + [""] * (pieces.config.clutter.count - len(ids))
    for name, value in wanted.items():
        got = contents[f"episodes/{name}"].tolist()
        if got != value:
            yield f"episodes/{name}", f"{shown(got)}, its recipe has {shown(value)}"
    if pieces.is_collected:
        if spec.seed not in pieces.source_seeds:
            yield (
                "episodes/seed",
                f"{spec.seed}, which the store's attribute {SOURCES} does not name",
            )
    else:
        if spec.index != i:
            yield "episodes/index", f"{spec.index}, which is another row's"
        if spec.seed != pieces.config.seed:
            yield "episodes/seed", f"{spec.seed}, the store has seed {pieces.config.seed}"


def _code_faults(contents: Row, pieces: PartialStore) -> Iterator[Fault]:
    """Yield each coded array, masks included, that has a value without a name.

    Of a real episode, 255 means that it was not measured.
    """
    real = is_real(contents)
    for path, found in contents.items():
        field = pieces.fields[path]
        names, may_lack = field.names, path != SOURCE and (real or field.is_real)
        values = found[found != UNKNOWN] if may_lack and names else found
        if names and values.size and int(values.max()) >= len(names):
            yield path, f"value {int(values.max())}, which stands for nothing"


def _range_faults(contents: Row) -> Iterator[Fault]:
    for name in _NOT_NEGATIVE:
        value = contents.get(f"episodes/{name}")
        if value is not None and (value < 0.0).any():
            yield f"episodes/{name}", f"{shown(value.tolist())}, valid: at least 0"
    mass = float(contents["episodes/object_mass"])
    if mass <= 0.0:
        yield "episodes/object_mass", f"{mass}, valid: above 0 kg"
    quality = contents.get("episodes/quality")
    if quality is not None and not WORST <= int(quality) <= BEST:
        yield "episodes/quality", f"{int(quality)}, valid: {WORST} to {BEST}"


def _pose_faults(contents: Row) -> Iterator[Fault]:
    quats = {
        "episodes/grasp_quat_xyzw": contents["episodes/grasp_quat_xyzw"],
        "episodes/object_rest_pose": contents["episodes/object_rest_pose"][..., 3:],
        "streams/tcp_pose": contents["streams/tcp_pose"][..., 3:],
        "streams/object_pose": contents["streams/object_pose"][..., 3:],
    }
    for path, quat in quats.items():
        off = np.abs(np.linalg.norm(quat.astype(np.float64), axis=-1) - 1.0)
        if (off > UNIT).any():
            yield path, f"a quaternion that is not unit, by {np.nanmax(off):.2g}"
    grasp = [contents[f"episodes/grasp_{name}"] for name in ("position", "quat_xyzw", "width")]
    is_nan = np.isnan(np.concatenate([value.ravel() for value in grasp]))
    if is_nan.any() and not is_nan.all():
        yield "episodes/grasp_position", "a grasp that is there in part"
    for path, T in contents.items():
        if path.rsplit("/", 1)[-1].startswith("T_") and not _is_rigid(T):
            yield path, "no rigid transform"


def _is_rigid(T: NDArray[Any]) -> bool:
    R, last = T[..., :3, :3], T[..., 3, :]
    is_turn = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0) < UNIT
    return bool(is_turn and (np.linalg.det(R) > 0.0).all() and (last == [0.0, 0.0, 0.0, 1.0]).all())


def _camera_faults(
    contents: Row, name: str, spec: EpisodeSpec, pieces: PartialStore
) -> Iterator[Fault]:
    at, camera = f"cameras/{name}", spec.cameras[name]
    depth, far = contents[f"{at}/depth"], camera.far * (1.0 + FAR)
    if depth.min() <= 0.0 or depth.max() > far:
        yield f"{at}/depth", f"{depth.min()} to {depth.max()} m, valid: above 0 to {camera.far}"
    visible = contents[f"{at}/visibility"]
    if visible.min() < 0.0 or visible.max() > 1.0:
        yield f"{at}/visibility", f"{visible.min()} to {visible.max()}, valid: 0 to 1"
    fov, renderer = math.radians(camera.fov_y_deg), pieces.config.renderer
    K = Intrinsics.from_fov(*spec.resolution, fov, renderer).matrix()
    if not np.allclose(contents[f"{at}/intrinsics"], K, rtol=1e-6, atol=1e-6):
        yield f"{at}/intrinsics", f"not those of a field of view of {camera.fov_y_deg:g} degrees"
