"""The thresholds of the success label."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any

from grasp_factory.core.config.within import Within, check_within


def _condition(text: str, default: float | None) -> Any:
    """Return a threshold's field; ``text`` is its condition, with {} in place of its value."""
    return dataclasses.field(default=default, metadata={"condition": text})


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelConfig:
    """The thresholds of the success label; a minimum of 0, or None, sets no condition."""

    min_lift: Annotated[float, Within(0.01, 0.5, "m")] = _condition(
        "at the end of the hold the target's centre of mass is at least {} m above its rest",
        0.10,
    )
    min_shake: Annotated[float, Within(0.0, 100.0, "g")] = _condition(
        "the target stays in the hand through a shake of {} g", 1.0
    )
    min_grip_force: Annotated[float, Within(0.0, 1000.0, "N")] = _condition(
        "neither pad presses with less than {} N during the hold", 0.0
    )
    max_slip_distance: Annotated[float | None, Within(0.0, 100.0, "m")] = _condition(
        "the target's centre of mass moves at most {} m in the hand", None
    )
    max_slip_angle: Annotated[float | None, Within(0.0, 100.0, "rad")] = _condition(
        "the target turns at most {} rad in the hand", None
    )

    def __post_init__(self) -> None:
        check_within(self)

    def conditions(self) -> dict[str, str]:
        """Return the conditions of success in words, by threshold, without those that are off."""
        values = {name: getattr(self, name) for name in self.condition_texts()}
        return {
            name: text.format(f"{values[name]:g}")
            for name, text in self.condition_texts().items()
            if values[name] is not None and not (name.startswith("min_") and values[name] == 0.0)
        }

    @classmethod
    def condition_texts(cls) -> dict[str, str]:
        """Return the condition of each threshold in words, with {} in place of its value."""
        return {field.name: field.metadata["condition"] for field in dataclasses.fields(cls)}
