"""The tutorial notebook runs whole, and shows what it gives."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from support.tutorial import NOTEBOOK, executed, shown

pytestmark = pytest.mark.slow


@pytest.mark.soak
def test_it_runs_whole_and_gives_what_it_shows(tmp_path: Path) -> None:
    """If it gives something else on purpose: ``PYTHONPATH=tests python -m support.tutorial``."""
    assert shown(executed(tmp_path)) == shown(nbformat.read(NOTEBOOK, as_version=4))


def test_it_shows_pictures() -> None:
    cells = nbformat.read(NOTEBOOK, as_version=4).cells
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 3
    assert not any(
        output.output_type in ("error", "stream") and "rror" in str(output) for output in outputs
    )
