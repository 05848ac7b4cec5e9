"""What every recorded episode is like; one that somebody made up may be unlike it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.elementary import LARGEST_ANGLE
from grasp_factory.core.enums import UNKNOWN
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.geometry import Array
from grasp_factory.core.real_columns import SOURCE, Source
from grasp_factory.core.serialization import check, is_number

LARGEST_FOCAL = 1e7
"""Largest focal length, in pixels; its inverse is the smallest one."""
FARTHEST = 1e6
"""Largest distance of a camera from the origin of the world, m."""
THINNEST_PAD, LARGEST_PAD = 0.001, 1.0
"""Smallest and largest side of a pad, m."""
LONGEST_S = 86_400.0
"""Longest time that the clock of an attempt may show, s."""


def check_plausible(episode: Episode, config: FactoryConfig) -> None:
    """Check that an episode's recipe is of a store's config, and that coded values have names.

    Raises:
        ConfigError: naming what no recorded episode has.
    """
    check_recipe(episode.spec, config)
    for field in schema.expand(config):
        group, _, name = field.path.partition("/")
        if field.names and group == "episodes" and name in episode.columns:
            code, codes = episode.columns[name], len(field.names)
            may_lack = field.path != SOURCE and (field.is_real or episode.is_real)
            is_known = code < codes or (may_lack and code == UNKNOWN)
            check(is_known, name, int(code), f"below {codes}")
    is_same = episode.columns.get("source", Source.SIMULATED) == int(episode.is_real)
    check(is_same, "source", "another origin than the recipe's", "that of the recipe")


def check_recipe(spec: EpisodeSpec, config: FactoryConfig) -> None:
    """Check that a recipe is of a store's config.

    Raises:
        ConfigError: naming what no recipe of the config has.
    """
    cameras = sorted(config.cameras)
    check(sorted(spec.cameras) == cameras, "spec.cameras", sorted(spec.cameras), str(cameras))
    for name in ("robot", "resolution"):
        got, valid = getattr(spec, name), getattr(config, name)
        check(got == valid, f"spec.{name}", got, str(valid))
    most = config.clutter.count
    check(len(spec.objects) <= most, "spec.objects", len(spec.objects), f"up to {most}")


def check_calibration(intrinsics: Array, poses: Array) -> None:
    """Check intrinsics (..., 3, 3) in pixels and poses (..., 4, 4) of cameras.

    Raises:
        ConfigError: naming what no camera has.
    """
    focal = intrinsics[..., (0, 1), (0, 1)]
    is_focal = _is_within(intrinsics, LARGEST_FOCAL) and bool((focal * LARGEST_FOCAL >= 1.0).all())
    valid = f"focal lengths of {1 / LARGEST_FOCAL:g} to {LARGEST_FOCAL:g} pixels"
    check(is_focal, "intrinsics", "values", valid)
    valid = f"positions within {FARTHEST:g} m"
    check(_is_within(poses, FARTHEST), "T_world_camera", "values", valid)


def check_motion(episode: Episode, joints: int) -> None:
    """Check the clocks of an attempt that is played back, and the positions of its joints.

    Raises:
        ConfigError: naming what no recorded attempt of a robot with so many joints has.
    """
    angles = episode.streams["joint_positions"]
    check_joints(angles, joints)
    is_finite = _is_within(angles, LARGEST_ANGLE)
    check(is_finite, "joint_positions", "values", f"angles up to {LARGEST_ANGLE:g} rad")
    for name, series in {"streams": episode.streams, **episode.own_rate}.items():
        if "timestamp" in series:
            _check_clock(f"{name}/timestamp", series["timestamp"])


def check_joints(joint_positions: Array, joints: int) -> None:
    """Check that joint positions (K, J) are of a robot's number of joints.

    Raises:
        ConfigError: if they are not.
    """
    found = joint_positions.shape[1]
    check(found == joints, "joint_positions", f"{found} joints", str(joints))


def pad_size(attributes: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return width and height of the robot's pads, metres, from the attributes of a store's root.

    They are None if the store does not say, or says what no pad has.
    """
    robot = attributes.get("robot")
    sides = robot.get("pad_size") if isinstance(robot, Mapping) else None
    if not isinstance(sides, list) or len(sides) != 2 or not all(map(_is_side, sides)):
        return None
    return float(sides[0]), float(sides[1])


def _is_side(value: Any) -> bool:
    return is_number(value) and THINNEST_PAD <= value <= LARGEST_PAD


def _check_clock(name: str, timestamp: Array) -> None:
    advances = bool((timestamp[1:] >= timestamp[:-1]).all())
    valid = f"seconds that increase, up to {LONGEST_S:g}"
    check(_is_within(timestamp, LONGEST_S) and advances, name, "values", valid)


def _is_within(values: Array, largest: float) -> bool:
    return bool((np.abs(values) <= largest).all())
