"""JSON files in which NaN and infinite numbers are null, as JSON has no such numbers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any


def write_json(path: Path, data: Any) -> None:
    """Write plain data to a file.

    Raises:
        OSError: if it cannot be written.
    """
    path.write_text(json.dumps(finite(data), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def finite(data: Any) -> Any:
    """Return plain data with None in place of each number that is NaN or infinite."""
    if isinstance(data, dict):
        return {key: finite(item) for key, item in data.items()}
    if isinstance(data, list | tuple):
        return [finite(item) for item in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
