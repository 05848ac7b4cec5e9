"""Run the checks of its kind on one policy, robot, object set or sensor."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from grasp_factory.apps.conformance.policy_checks import POLICY_CHECKS, PolicyCase
from grasp_factory.core.plugins.file_loading import attribute_of, file_reference
from grasp_factory.core.plugins.plugin_sources import allow_file
from grasp_factory.core.sensors import SensorModel
from grasp_factory.errors import UnknownNameError, did_you_mean, shown
from grasp_factory.factory.plugin_rows import TABLES, PluginRow, kind_of
from grasp_factory.factory.plugins import find_plugin
from grasp_factory.objects import ObjectSet
from grasp_factory.policies import Policy
from grasp_factory.robots import ROBOTS, RobotModel

SHORTEST, LONGEST = 10, 100
"""Characters of a description."""
LONGEST_REASON = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """The result of one check."""

    check: str
    """What was checked, as a sentence."""
    fault: str
    """What is wrong; empty if it passed."""


def row_named(name: str) -> tuple[str, PluginRow]:
    """Return kind and row that a text names: ``FILE.py:NAME``, a table's row, an entry point.

    Raises:
        PluginError: if it cannot be loaded.
        UnknownNameError: naming all valid names.
    """
    reference = file_reference(name)
    kinds = list(TABLES)
    if reference is not None:
        value = attribute_of(allow_file(reference.path), reference.attribute)
        kinds = [kind_of(value, name)]
    for kind in kinds:
        if name in TABLES[kind]:
            return kind, TABLES[kind][name]
        if found := find_plugin(kind, name):
            return kind, found[0]
    valid = [key for table in TABLES.values() for key in table]
    raise UnknownNameError(
        f"unknown name {shown(name)}{did_you_mean(name, valid)} (valid: FILE.py:NAME,"
        f" {', '.join(valid)})"
    )


def checks_of(row: PluginRow) -> Mapping[str, Callable[[], str]]:
    """Return the checks of a row's kind by what they check; each returns what is wrong."""
    return {"it has a line of description": partial(has_a_line, row), **_of_kind(row)}


def results(checks: Mapping[str, Callable[[], str]]) -> Iterator[CheckResult]:
    """Run checks and yield the result of each. A check that raises has failed."""
    for sentence, check in checks.items():
        try:
            with contextlib.redirect_stdout(sys.stderr):
                fault = check()
        except (Exception, SystemExit) as error:
            text = " ".join(str(error).split())[:LONGEST_REASON]
            fault = f"it raises {type(error).__name__}: {text}"
        yield CheckResult(check=sentence, fault=fault)


def has_a_line(row: PluginRow) -> str:
    """Check that a row says in one line what it is."""
    text = row.description
    ok = SHORTEST < len(text) <= LONGEST and "\n" not in text
    valid = f"one line of {SHORTEST + 1} to {LONGEST} characters"
    return "" if ok else f"description {shown(text)}, valid: {valid}"


def _of_kind(row: PluginRow) -> Mapping[str, Callable[[], str]]:
    if isinstance(row, Policy):
        return {name: partial(_with_grippers, row, check) for name, check in POLICY_CHECKS.items()}
    # These simulate; the checks of policies run without PyBullet.
    if isinstance(row, RobotModel):
        from grasp_factory.apps.conformance.robot_checks import ROBOT_CHECKS  # noqa: PLC0415

        return {name: partial(check, row) for name, check in ROBOT_CHECKS.items()}
    if isinstance(row, SensorModel):
        from grasp_factory.apps.conformance.sensor_checks import SENSOR_CHECKS  # noqa: PLC0415

        return {name: partial(check, row) for name, check in SENSOR_CHECKS.items()}
    from grasp_factory.apps.conformance.object_set_checks import (  # noqa: PLC0415
        OBJECT_SET_CHECKS,
    )

    assert isinstance(row, ObjectSet)
    return {name: partial(check, row) for name, check in OBJECT_SET_CHECKS.items()}


def _with_grippers(policy: Policy, check: Callable[[PolicyCase], str]) -> str:
    """Return the first fault of a policy with the gripper of any robot."""
    for name, robot in ROBOTS.items():
        if fault := check(PolicyCase(policy=policy, gripper=robot.gripper)):
            return f"with the gripper of {name}: {fault}"
    return ""
