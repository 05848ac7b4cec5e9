"""Where things lie in the checkout."""

from __future__ import annotations

from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
TESTS = REPOSITORY / "tests"
DOCS = REPOSITORY / "docs"
TINY = REPOSITORY / "data_samples" / "tiny.zarr"
"""A small store that is part of the repository."""
