"""How much a test does: a small form in every run, the whole in ``bin/test --soak``."""

from __future__ import annotations

import os
from typing import Any

import pytest

IS_SOAK = os.environ.get("GRASP_FACTORY_SOAK") == "1"


def scaled(usual: int, soak: int) -> int:
    """Return how often a test does something: ``usual``, or ``soak`` in a soak."""
    return soak if IS_SOAK else usual


def soak_only(*values: Any) -> list[Any]:
    """Return values of a parametrisation that only a soak runs."""
    return [pytest.param(value, marks=pytest.mark.soak) for value in values]
