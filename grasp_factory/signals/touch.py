"""Touch as a sensor would measure it: taxel images and centres of pressure from stored contacts.

The pad's frame: origin at the middle of the pad's face, +x along its width (columns), +z along its
height towards the fingertip (rows), y the closing axis. The axes of both pads are parallel to the
TCP frame's: neither image is mirrored.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.episode import Streams
from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError, lookup

_AXES = {"x": 0, "y": 1, "z": 2}


def contact_values(streams: Streams, component: str = "normal", body: int | None = None) -> Array:
    """Return one component of the force on the pads at each contact point.

    Args:
        streams: ``Episode.streams``, or any mapping with its ``tactile_*`` arrays.
        component: ``normal`` along the contact's own normal, never negative (its sum is
            ``labels.pad_normal_force``); ``x``, ``y`` or ``z`` along an axis of the pad, signed:
            x and z are the shear of a contact with the pad's face.
        body: A label of ``tactile_body``: only contacts with this body count. With None, all
            contacts count, as in a real pad.

    Returns:
        (T, 2, P) newtons, 0 where there is no contact.

    Raises:
        UnknownNameError: for another component.
    """
    force = np.nan_to_num(np.asarray(streams["tactile_force"], np.float64))
    if component == "normal":
        normal = np.nan_to_num(np.asarray(streams["tactile_normal"], np.float64))
        values = (force * normal).sum(axis=-1)
    else:
        values = force[..., lookup(_AXES | {"normal": -1}, "force component", component)]
    return np.asarray(values if body is None else values * (streams["tactile_body"] == body))


def taxel_centers(pad_size: tuple[float, float], rows: int, columns: int) -> Array:
    """Return x and z of each taxel's centre in the pad's frame, (rows, columns, 2) metres.

    The outermost centres are on the pad's edges, row 0 at the lowest z (the palm's side), column 0
    at the lowest x.

    Raises:
        UsageError: with fewer than two rows or columns, which cannot show where a force acts.
    """
    for name, count in (("rows", rows), ("columns", columns)):
        if count < 2:
            raise UsageError(f"taxels: {name} {count}: valid: 2 or more; take the sum for fewer")
    width, height = pad_size
    x, z = np.linspace(-width / 2, width / 2, columns), np.linspace(-height / 2, height / 2, rows)
    return np.stack(np.meshgrid(x, z), axis=-1)


def taxel_image(
    streams: Streams,
    pad_size: tuple[float, float],
    rows: int,
    columns: int,
    *,
    component: str = "normal",
    body: int | None = None,
) -> Array:
    """Return the force on each taxel of both pads over time.

    A contact's force goes to the four taxels around it with bilinear weights (the cloud-in-cell
    scheme of particle codes, Hockney & Eastwood 1988). The weights sum to 1, and their mean
    position is the contact's. So the image has exactly the contacts' total force and centre of
    pressure, at any resolution. A contact beyond the pad's edge counts at the nearest point on the
    edge: the total stays exact, and the centre of pressure moves accordingly.

    Args:
        streams: ``Episode.streams``, or any mapping with its ``tactile_*`` arrays.
        pad_size: Width and height, metres: ``dataset.attributes["robot"]["pad_size"]``.
        rows: Taxels along z; see ``taxel_centers`` for their positions.
        columns: Taxels along x.
        component: See ``contact_values``.
        body: See ``contact_values``.

    Returns:
        (T, 2, rows, columns) newtons; left pad first.

    Raises:
        UsageError: with fewer than two rows or columns.
        UnknownNameError: for an unknown component.
    """
    taxel_centers(pad_size, rows, columns)  # checks rows and columns
    values = contact_values(streams, component, body)
    samples, pads, _ = values.shape
    point = np.nan_to_num(np.asarray(streams["tactile_position"], np.float64))
    column, right = _cells(point[..., 0], pad_size[0], columns)
    row, up = _cells(point[..., 2], pad_size[1], rows)
    image = np.zeros((samples * pads, rows, columns))
    which = np.arange(samples * pads).reshape(samples, pads, 1)
    for i, along_z in ((0, 1.0 - up), (1, up)):
        for j, along_x in ((0, 1.0 - right), (1, right)):
            np.add.at(image, (which, row + i, column + j), values * along_z * along_x)
    return image.reshape(samples, pads, rows, columns)


def center_of_pressure(streams: Streams, body: int | None = None) -> Array:
    """Return where the normal force acts on each pad.

    It is the mean of the contact points, weighted by their normal forces.

    Returns:
        (T, 2, 2): x and z in the pad's frame, metres; NaN where nothing touches.
    """
    values = contact_values(streams, "normal", body)[..., None]
    point = np.nan_to_num(np.asarray(streams["tactile_position"], np.float64))[..., [0, 2]]
    total = values.sum(axis=2)
    loaded = np.broadcast_to(total > 0.0, (*total.shape[:-1], 2))
    moment = (values * point).sum(axis=2)
    return np.asarray(np.divide(moment, total, out=np.full_like(moment, np.nan), where=loaded))


def net_wrench(points: ArrayLike, forces: ArrayLike) -> Array:
    """Return the wrench of forces about the origin of their frame.

    For a pad's stored contacts it is ``tactile_wrench``, unless the pad had more contacts than are
    stored.

    Args:
        points: (..., P, 3) metres; NaN where there is no point.
        forces: (..., P, 3) newtons, at the points.

    Returns:
        (..., 6): force N, torque N m.
    """
    point = np.nan_to_num(np.asarray(points, np.float64))
    force = np.nan_to_num(np.asarray(forces, np.float64))
    return np.concatenate([force.sum(axis=-2), np.cross(point, force).sum(axis=-2)], axis=-1)


def _cells(place: Array, size: float, count: int) -> tuple[NDArray[np.intp], Array]:
    """Return the taxel before each position along an axis, and the fraction to the next taxel."""
    u = np.clip((place / size + 0.5) * (count - 1), 0.0, count - 1.0)
    before = np.minimum(u.astype(np.intp), count - 2)
    return before, u - before
