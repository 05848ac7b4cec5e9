"""Touch: the contact forces on each finger pad."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label
from grasp_factory.core.geometry import Array, pose_matrices
from grasp_factory.core.linear import product, turned_back
from grasp_factory.core.sensors import MAX_CONTACTS
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class TactilePads(Sensor):
    """The contact points of both pads, with the force of the other body on the pad at each.

    Forces are means over the last physics step. Bullet does not report torsional and rolling
    friction, so the wrench lacks them. Bullet's points are from before the step,
    its poses from after it: at 720 Hz and lift speed, the difference is 0.8 mm.
    """

    def __init__(self, scene: Scene) -> None:
        self._robot, self._label_of = scene.robot, scene.label_of
        self._pad_of = {link: i for i, link in enumerate(scene.robot.pads)}
        self._records = 0
        self._frames, self._rows = array("d"), array("d")

    def sample(self, tick: Tick) -> None:
        """Store the loaded contacts of the pads and the pads' frames."""
        body, record = self._robot.body, self._records
        self._records += 1
        for position, quat in tick.frames[1:]:
            self._frames.extend((*position, *quat))
        for c in tick.contacts:
            if c[9] <= 0.0:  # within the breaking threshold, but not touching
                continue
            if c[1] == body and c[3] in self._pad_of:
                pad, sign, position, other = self._pad_of[c[3]], 1.0, c[5], (c[2], c[4])
            elif c[2] == body and c[4] in self._pad_of:
                pad, sign, position, other = self._pad_of[c[4]], -1.0, c[6], (c[1], c[3])
            else:
                continue
            place = (record, pad, self._label_of(*other), sign, *position)
            self._rows.extend((*place, *c[7], c[9], c[10], *c[11], c[12], *c[13], -c[8]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return wrench, points, forces, normals and bodies of the contacts, in pad frames."""
        samples = self._records
        rows = np.array(self._rows, np.float64).reshape(-1, 20)
        record, pad, label = (rows[:, i].astype(int) for i in range(3))
        sign, point, normal = rows[:, 3:4], rows[:, 4:7], rows[:, 7:10]
        force = sign * (normal * rows[:, 10:11] + rows[:, 12:15] * rows[:, 11:12]
                        + rows[:, 16:19] * rows[:, 15:16])  # fmt: skip
        T_world_pad = self._pad_frames()
        R = T_world_pad[record, pad, :3, :3]
        point = turned_back(R, point - T_world_pad[record, pad, :3, 3])
        normal, force = turned_back(R, sign * normal), turned_back(R, force)

        wrench = np.zeros((samples, 2, 6))
        np.add.at(wrench, (record, pad), np.hstack([force, np.cross(point, force)]))
        slot, kept = _slots(record * 2 + pad, label != Label.TARGET, rows[:, 10])
        where = (record[kept], pad[kept], slot[kept])
        out: dict[str, NDArray[Any]] = {"tactile_wrench": wrench.astype(np.float32)}
        for name, values in (("position", point), ("force", force), ("normal", normal)):
            stream = np.full((samples, 2, MAX_CONTACTS, 3), np.nan, np.float32)
            stream[where] = values[kept]
            out[f"tactile_{name}"] = stream
        bodies = np.zeros((samples, 2, MAX_CONTACTS), np.uint8)
        bodies[where] = label[kept]
        depth = np.full((samples, 2, MAX_CONTACTS), np.nan, np.float32)
        depth[where] = rows[kept, 19]
        return out | {"tactile_body": bodies, "tactile_depth": depth}

    def _pad_frames(self) -> Array:
        """Return ``T_world_pad``, (samples, 2, 4, 4)."""
        frames = np.array(self._frames, np.float64).reshape(-1, 2, 7)
        return product(pose_matrices(frames), self._robot.pad_offsets())


def _slots(
    group: NDArray[np.int_], is_other: NDArray[np.bool_], strength: Array
) -> tuple[NDArray[np.int_], NDArray[np.bool_]]:
    """Return each row's slot within its group, and whether it is kept.

    Contacts with the target come first, because labels depend on them. Within the target's contacts
    and within the others, the strongest come first.
    """
    order = np.lexsort((-strength, is_other, group))
    starts = np.r_[True, group[order][1:] != group[order][:-1]] if len(group) else np.zeros(0, bool)
    position = np.arange(len(group))
    first = np.maximum.accumulate(np.where(starts, position, 0))
    slot = np.empty(len(group), int)
    slot[order] = position - first
    return slot, slot < MAX_CONTACTS
