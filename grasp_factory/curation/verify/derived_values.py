"""Check that labels and measurements follow from the streams, and the score from the columns."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from grasp_factory.core.enums import Outcome, Phase
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.curation.verify.problems import Fault
from grasp_factory.dataset.row_codec import Row
from grasp_factory.labels.quality import MEASURED, quality_scores
from grasp_factory.labels.rule import disturbance, judge, measure

BEFORE_CLOSING = (
    *(Outcome.NEVER_SETTLED, Outcome.LEFT_WORKSPACE, Outcome.NO_PLAN, Outcome.UNREACHABLE),
    Outcome.COLLISION,
)
"""Outcomes of attempts in which the gripper never closed."""
_ROUNDING = {"rtol": 1e-6, "atol": 1e-9}
"""Tolerances: other machines may sum in another order."""


def label_faults(contents: Row, spec: EpisodeSpec) -> Iterator[Fault]:
    """Yield each label or measurement that does not follow from the stored data, and why.

    Args:
        contents: The episode's arrays by path, unpadded, without any number that is not finite.
        spec: Its recipe.
    """
    streams = {
        p.removeprefix("streams/"): v for p, v in contents.items() if p.startswith("streams")
    }
    columns = {p.removeprefix("episodes/"): v for p, v in contents.items() if p.startswith("epi")}
    object_com, rest_height = columns["object_com"], float(columns["rest_height"])
    measured = measure(streams, object_com[0], rest_height)
    derived: dict[str, Any] = {
        field.name: getattr(measured, field.name) for field in dataclasses.fields(measured)
    }
    names = ("object_displacement", "object_lift")
    rest = columns["object_rest_pose"]
    derived |= dict(zip(names, disturbance(streams, object_com, rest), strict=True))
    for name, value in derived.items():
        is_there = name in columns  # a store of an earlier version has fewer
        if is_there and not np.allclose(columns[name], value, equal_nan=True, **_ROUNDING):
            yield f"episodes/{name}", "does not follow from the streams"
    yield from _outcome_faults(streams, columns, spec)
    if "quality" in columns and all(name in columns for name in MEASURED):
        score = int(quality_scores(columns, spec.quality))
        if int(columns["quality"]) != score:
            yield "episodes/quality", f"{int(columns['quality'])}, its measurements give {score}"


def _outcome_faults(streams: Row, columns: Row, spec: EpisodeSpec) -> Iterator[Fault]:
    outcome, phase = int(columns["outcome"]), streams["phase"]
    if (phase == Phase.CLOSE).any():
        com, height = columns["object_com"][0], float(columns["rest_height"])
        judged = judge(streams, com, height, spec.label)
        if outcome != judged:
            yield "episodes/outcome", f"{_word(outcome)}, the streams give {_word(judged)}"
    elif outcome not in BEFORE_CLOSING:
        yield "episodes/outcome", f"{_word(outcome)}, though the gripper never closed"
    is_success = outcome == Outcome.SUCCESS
    if bool(columns["success"]) != is_success:
        yield "episodes/success", f"{bool(columns['success'])} for outcome {_word(outcome)}"
    reward = np.zeros(len(phase), np.float32)
    reward[-1:] = is_success
    if not np.array_equal(streams["reward"], reward):
        yield "streams/reward", "is not 1 on the last record of a success alone"
    if int(columns["collision_body"]) and outcome != Outcome.COLLISION:
        yield "episodes/collision_body", f"a body for outcome {_word(outcome)}"


def _word(outcome: int) -> str:
    return Outcome(outcome).name.lower() if outcome in set(Outcome) else str(outcome)
