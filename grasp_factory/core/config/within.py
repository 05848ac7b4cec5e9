"""The valid values of a setting: stated once, in its annotation, for its check and its text."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from grasp_factory.core.serialization import check, is_number


@dataclass(frozen=True, slots=True)
class Within:
    """A number from ``low`` to ``high``, or a range (low, high) of such numbers."""

    low: float
    high: float
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.low} to {self.high} {self.unit}".strip()

    def check(self, key: str, got: Any) -> None:
        """Check a number, or a range of two numbers; None, where a setting may be None, is right.

        Raises:
            ConfigError: naming the key, what it got and what is valid.
        """
        if isinstance(got, tuple):
            ok = self.low <= got[0] <= got[1] <= self.high
            check(ok, key, list(got), f"{self.low} <= low <= high <= {self.high}")
        elif got is not None:
            check(is_number(got) and self.low <= got <= self.high, key, got, str(self))


@dataclass(frozen=True, slots=True)
class Valid:
    """What values a setting may have, in words, where no two numbers bound them."""

    text: str

    def __str__(self) -> str:
        return self.text


def check_within(record: Any) -> None:
    """Check the fields of a record that are annotated with ``Within``, in their order.

    Raises:
        ConfigError: naming the first one that is out of its bounds.
    """
    cls: Any = type(record)
    for key, valid in valid_values(cls).items():
        if isinstance(valid, Within):
            valid.check(key, getattr(record, key))


@cache
def valid_values(cls: type) -> Mapping[str, Within | Valid]:
    """Return what the annotations of a record's fields say of their values, by field name."""
    hints = typing.get_type_hints(cast(Any, cls), include_extras=True).items()
    found = {
        name: next((x for x in hint.__metadata__ if isinstance(x, Within | Valid)), None)
        for name, hint in hints
        if typing.get_origin(hint) is typing.Annotated
    }
    return {name: valid for name, valid in found.items() if valid is not None}
