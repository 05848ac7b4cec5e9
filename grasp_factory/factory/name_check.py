"""Check of every name in a config against its table, before anything is made."""

from __future__ import annotations

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.motion import MAX_CLOSING_STROKE, SLOWEST_FINGERS
from grasp_factory.core.serialization import check
from grasp_factory.errors import lookup
from grasp_factory.objects import OBJECT_SETS, check_splits, find_set
from grasp_factory.policies import POLICIES
from grasp_factory.policies.model_registry import find_model
from grasp_factory.robots import ROBOTS, RobotModel


def check_names(config: FactoryConfig) -> RobotModel:
    """Check every name in a config against its table, with its settings; return the robot.

    Raises:
        UnknownNameError: naming the kind, the nearest and all valid names.
        ConfigError: naming a policy's setting, or what the robot cannot do.
        UsageError: if a trained model cannot be loaded.
    """
    for name in {**config.policies, **config.policy_parameters}:
        lookup(POLICIES, "policy", name).settings(config.policy_parameters.get(name, {}))
    for sha256 in config.models.values():
        find_model(sha256)
    for object_set, weight in config.object_sets.items():
        found = find_set(object_set, config.object_folders.get(object_set, ""))
        if weight:
            check_splits(found, config.object_splits)
    for folder in config.object_folders:
        ok = folder not in OBJECT_SETS and folder in config.object_sets
        valid = "a name of object_sets that is not a shipped set"
        check(ok, "object_folders", folder, valid)
    robot = lookup(ROBOTS, "robot", config.robot)
    (low, high), force = robot.gripper.force_range, config.motion.grip_force
    valid = f"{low:g} to {high:g} N, which is what the gripper of {robot.name} can do"
    check(low <= force <= high, "motion.grip_force", force, valid)
    _check_fingers(robot)
    return robot


def _check_fingers(robot: RobotModel) -> None:
    """Check that the fingers close within the time that the length of streams allows."""
    stroke, speed = robot.gripper.max_width / 2.0, robot.gripper.max_finger_speed
    valid = (
        f"a robot whose fingers travel up to {MAX_CLOSING_STROKE:g} m each and reach"
        f" {SLOWEST_FINGERS:g} m/s; those of this one travel {stroke:g} m and reach {speed:g} m/s"
    )
    fits = stroke <= MAX_CLOSING_STROKE and speed >= SLOWEST_FINGERS
    check(fits, "robot", robot.name, valid)
