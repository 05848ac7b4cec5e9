"""Values of arrays that no run writes: what is not finite, out of range, or unlike other arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import zarr
from support.hostile.recipes import Recipe
from support.hostile.table import ATTACKS, Attack, remove

EXTREMES = {
    "index": 2**62, "outcome": 99, "policy": "\0", "grasp_proposer": "x" * 10_000, "n_steps": 1,
    "n_imu": 1, "n_video": 1, "hold_duration": np.inf, "object_com": np.nan, "object_mass": -np.inf,
    "rest_height": np.nan, "success": 7, "status": 9, "split": "", "seed": -(2**63),
    "grasp_quat_xyzw": 0.0, "grasp_position": 1e4, "grasp_width": np.nan, "grasp_score": np.nan,
    "object_ids": "\x1b[2J", "object_rest_pose": np.nan, "object_displacement": 1e308,
    "loss_time": np.inf, "quality": 255, "lift_height": np.inf, "target_pixels": 2**31 - 1,
    "collision_body": 200, "shake_level": np.nan, "fingerprint": "\n", "array_crc32c": 0,
}  # fmt: skip
STREAMS = {
    "timestamp": (np.nan, 0.0, 1e308, -1.0), "phase": (255,), "joint_positions": (np.nan, 1e300),
    "object_pose": (np.nan, 0.0, 1e300), "tcp_pose": (np.nan, 0.0), "tactile_body": (255,),
    "tactile_force": (np.inf,), "tactile_position": (np.nan,), "wrist_wrench": (np.inf,),
    "gripper_width": (np.nan, 1e300), "reward": (np.nan,), "hand_force": (np.inf,),
}  # fmt: skip
OTHERS = {
    "imu/timestamp": np.nan, "imu/specific_force": np.inf, "videos/timestamp": np.nan,
    "cameras/front/depth": np.nan, "cameras/front/segmentation": 255,
    "cameras/front/intrinsics": 0.0, "cameras/front/T_world_camera": np.nan,
}  # fmt: skip


def filled(path: str, value: Any) -> Attack:
    """Set all values of an array."""

    def fill(store: Path, outside: Path) -> None:
        remove(store / "packed")  # it would show the columns as they were
        array = zarr.open_array(store / path, mode="r+")
        kind = np.asarray(array[:1]).dtype
        with np.errstate(over="ignore"):
            array[:] = np.full(array.shape, value, kind)

    return fill


def _cameras(plain: dict[str, Any]) -> None:
    plain["cameras"] = {"side": next(iter(plain["cameras"].values()))}


ATTACKS |= {
    **{
        f"all of episodes/{name} is {value!r:.20}": filled(f"episodes/{name}", value)
        for name, value in EXTREMES.items()
    },
    **{
        f"all of streams/{name} is {value!r}": filled(f"streams/{name}", value)
        for name, values in STREAMS.items()
        for value in values
    },
    **{f"all of {path} is {value!r}": filled(path, value) for path, value in OTHERS.items()},
    "a whole row with a recipe of another robot": Recipe(
        lambda plain: plain.update(robot="panda"), is_quarantined=False
    ),
    "a whole row with a recipe of other cameras": Recipe(_cameras, is_quarantined=False),
    "a whole row with a recipe of more objects": Recipe(
        lambda plain: plain.update(objects=plain["objects"][:1] * 9), is_quarantined=False
    ),
    "a whole row with a recipe of other rates": Recipe(
        lambda plain: plain.update(record_hz=24, imu_hz=24, video_hz=0), is_quarantined=False
    ),
    "a whole row with a recipe of other images": Recipe(
        lambda plain: plain.update(resolution=[640, 480]), is_quarantined=False
    ),
}  # fmt: skip
