"""The config's section on the label: the thresholds that a success must meet."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.serialization import check_range


def _condition(text: str, default: float | None) -> Any:
    """Return the field of a threshold.

    ``text`` is its condition in words, with {} in place of the value.
    """
    return dataclasses.field(default=default, metadata={"condition": text})


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelConfig:
    """The thresholds of the success label; a minimum of 0, or None, disables a condition."""

    min_lift: float = _condition(
        "its centre of mass is at least {} m above its rest at the end of the hold", 0.10
    )
    min_shake: float = _condition("it survives the shake up to level {}", 1.0)
    min_grip_force: float = _condition(
        "neither pad presses with less than {} N during the hold", 0.0
    )
    max_slip_distance: float | None = _condition(
        "its centre of mass moves at most {} m in the hand", None
    )
    max_slip_angle: float | None = _condition("it turns at most {} rad in the hand", None)

    def __post_init__(self) -> None:
        check_range(self, "min_lift", 0.01, 0.5, "m")
        check_range(self, "min_shake", 0.0, 100.0)
        check_range(self, "min_grip_force", 0.0, 1000.0, "N")
        for key in ("max_slip_distance", "max_slip_angle"):
            if getattr(self, key) is not None:
                check_range(self, key, 0.0, 100.0)

    def conditions(self) -> dict[str, str]:
        """Return the enabled conditions of success in words, by the name of the threshold."""
        values = {name: getattr(self, name) for name in self.condition_texts()}
        return {
            name: text.format(f"{values[name]:g}")
            for name, text in self.condition_texts().items()
            if values[name] is not None and not (name.startswith("min_") and values[name] == 0.0)
        }

    @classmethod
    def condition_texts(cls) -> dict[str, str]:
        """Return each threshold's condition in words, with {} in place of the value."""
        return {field.name: field.metadata["condition"] for field in dataclasses.fields(cls)}
