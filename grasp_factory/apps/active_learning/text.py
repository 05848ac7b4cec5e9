"""A flywheel's rounds as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from grasp_factory.apps.active_learning.arm_evaluation import ArmEvaluation
from grasp_factory.apps.active_learning.judging import SURE
from grasp_factory.apps.active_learning.rounds import Round, SelectionGain
from grasp_factory.apps.learning.report import estimate_text
from grasp_factory.apps.learning.scores import Estimate
from grasp_factory.core.text_format import count, percent, table


def flywheel_text(found: Mapping[str, Any]) -> str:
    """Return the results of ``run_rounds`` as text for people."""
    arms: Mapping[str, Sequence[Round]] = found["arms"]
    judged = found["evaluation"]
    parts = [
        f"judged on {count(judged['examples'], 'episode')} of"
        f" {count(judged['objects'], 'held-out object')};"
        f" in brackets: {judged['intervals']}",
        _turns(arms),
        _mistakes(arms),
    ]
    if found["gains"]:
        parts.append(_gains(found["gains"]))
    if "tries" in found:
        parts.append(_tries(found["tries"]))
    return "\n\n".join(parts)


def _turns(arms: Mapping[str, Sequence[Round]]) -> str:
    first = next(iter(arms.values()))[0]
    rows = [("-", first), *((arm, turn) for arm, turns in arms.items() for turn in turns[1:])]
    cells = [
        (
            turn.round, arm, turn.episodes, percent(turn.store.successes / turn.store.episodes),
            estimate_text(turn.scores["auc"]), estimate_text(turn.scores["average_precision"]),
            estimate_text(turn.scores["calibration_error"]),
        )
        for arm, turn in sorted(rows, key=lambda row: row[1].round)
    ]  # fmt: skip
    head = ("round", "arm", "episodes", "success", "AUC", "average precision", "calibration error")
    return table([head, *cells], right=(0, 2, 3))


def _mistakes(arms: Mapping[str, Sequence[Round]]) -> str:
    """Return a table of how well each round's model predicted the grasps that it chose."""
    cells = []
    for arm, turns in arms.items():
        for turn in turns[1:]:
            found = turn.choice.mistakes if turn.choice else None
            if found is None:
                continue
            sure = found.wrong_when_sure
            cells.append(
                (
                    turn.round, arm, percent(found.expected), _rate(found.success),
                    _rate(found.wrong), percent(found.sure / found.episodes),
                    _rate(sure) if sure else "-", f"{found.surprise.value:.2f}",
                )
            )  # fmt: skip
    head = (
        "round", "arm", "expected", "success", "wrong", f"sure ({SURE:.0%})", "wrong when sure",
        "surprise",
    )  # fmt: skip
    return table([head, *sorted(cells, key=lambda row: row[0])], right=(0, 2, 5, 7))


def _gains(gains: Sequence[SelectionGain]) -> str:
    cells = [
        (
            gain.round,
            gain.episodes,
            *(estimate_text(gain.scores[name], sign=True) for name in _COMPARED),
        )
        for gain in gains
    ]
    return table([("round", "episodes", *_COMPARED.values()), *cells], right=(0, 1))


_COMPARED = {"auc": "AUC, active - random", "average_precision": "average precision"}


def _tries(tries: ArmEvaluation) -> str:
    rows = [(f"learned, {arm}", _rate(tried.success)) for arm, tried in tries.arms.items()]
    rows += [(name, _rate(rate)) for name, rate in tries.policies.items()]
    if tries.gain is not None:
        rows.append(("active - random", _rate(tries.gain)))
    return table([("policy, held-out objects", "success"), *rows])


def _rate(rate: Estimate) -> str:
    return f"{percent(rate.value)} ({percent(rate.low)} to {percent(rate.high)})"
