"""How much a test does: a small form in every run, the whole in ``bin/test --soak``."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import pytest

IS_SOAK = os.environ.get("GRASP_FACTORY_SOAK") == "1"


def scaled(usual: int, soak: int) -> int:
    """Return how often a test does something: ``usual``, or ``soak`` in a soak."""
    return soak if IS_SOAK else usual


def soak_only(*values: Any) -> list[Any]:
    """Return values of a parametrisation that only a soak runs."""
    return [pytest.param(value, marks=pytest.mark.soak) for value in values]


def sampled(values: Iterable[Any], usual: int) -> list[Any]:
    """Return values of a parametrisation: ``usual`` of them, evenly spread, and the rest in a soak.

    Values beside each other should be alike: a kind of which one is usual is tested in every run.
    """
    every = list(values)
    chosen = {round(k * (len(every) - 1) / max(usual - 1, 1)) for k in range(usual)}
    marked = [soak_only(value)[0] for value in every]
    return [every[k] if k in chosen else marked[k] for k in range(len(every))]
