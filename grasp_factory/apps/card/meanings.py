"""The label's conditions and the outcomes' meanings in words, with a dataset's own thresholds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome

MEANINGS: Mapping[Outcome, str] = {
    Outcome.SUCCESS: "all that the label asks for",
    Outcome.NEVER_SETTLED: "the object did not come to rest before the attempt",
    Outcome.LEFT_WORKSPACE: "the object came to rest out of reach, or fell off the table",
    Outcome.NO_PLAN: "the policy saw no grasp",
    Outcome.UNREACHABLE: "the arm has no path to any grasp that was planned",
    Outcome.COLLISION: "something was touched before the gripper closed",
    Outcome.NO_CONTACT: "the gripper closed without both pads touching the object",
    Outcome.LOST_IN_LIFT: "it was touched by both pads and lost before the lift ended",
    Outcome.LOST_IN_HOLD: "it was up, and lost by the end of the hold",
    Outcome.LOST_IN_SHAKE: "it was held, and lost in the shake",
    Outcome.UNSTABLE: "it stayed in the hand, gripped too weakly or moved too far for the label",
}


def label_conditions(config: FactoryConfig) -> Iterator[str]:
    """Yield each condition of a config's label."""
    label, motion = config.label, config.motion
    yield (
        f"after a lift of {motion.lift_height:g} m and a hold of {motion.hold_s:g} s both pads"
        f" touch the object, and its centre of mass is at least {label.min_lift:g} m above where"
        " it lay"
    )
    levels = ", ".join(f"{level:g} g" for level in config.shake.levels)
    if label.min_shake:
        yield (
            f"it stays in the hand through a shake of {label.min_shake:g} g (the hand was shaken at"
            f" {levels}, along three axes and about one)"
        )
    elif levels:
        yield f"the shake that follows, at {levels}, need not be survived"
    said_above = ("min_lift", "min_shake")
    yield from (text for name, text in label.conditions().items() if name not in said_above)


def thresholds_text(thresholds: Mapping[str, Any]) -> str:
    """Return an added label's thresholds in one line, without those that are None."""
    return ", ".join(f"{key} {value:g}" for key, value in thresholds.items() if value is not None)
