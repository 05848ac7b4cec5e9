"""Meshes that are converted in this process, each once: the child's answers without its start."""

from __future__ import annotations

import warnings
from functools import cache

import pytest

from grasp_factory.objects.importing import worker
from grasp_factory.objects.importing.child import Child


def convert_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the importer get the answers of its child process from the child's own function."""
    monkeypatch.setattr(Child, "_exchange", lambda child, message: _answer(message))


@cache
def _answer(message: bytes) -> bytes:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as in the child
        return worker._answer(message)
