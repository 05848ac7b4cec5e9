"""flywheel.json: the settings and the provenance of each round, next to its stores and models."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from grasp_factory.apps.active_learning.files import make_folder, read, write_if_new
from grasp_factory.apps.active_learning.settings import FlywheelSettings
from grasp_factory.core.atomic_file import partial_path
from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.errors import ConfigError, UsageError

FILE = "flywheel.json"
FORMAT = 1


class Journal:
    """The file in a flywheel's folder that records its settings and results."""

    def __init__(self, folder: Path, settings: FlywheelSettings) -> None:
        """Open the folder, or make it if it does not exist, and begin the file.

        Raises:
            UsageError: if the folder cannot be made, or has other settings or other content.
            StoreError: if the disk or its permissions prevent writing.
        """
        self._file = folder / FILE
        self._settings = settings
        self._turns_there = 0
        make_folder(folder)
        there = read(self._file)
        if there is not None:
            self._check(there)
            return
        if {path.name for path in folder.iterdir()} - {partial_path(self._file).name}:
            raise UsageError(
                f"{folder} holds other things and no {FILE}; choose a folder that is new or empty"
            )
        self.finish({})

    def note(self, found: Mapping[str, Any], turns: int) -> None:
        """Write the results so far, unless the file already has as many rounds.

        Args:
            found: Records by topic.
            turns: Number of rounds in them, over all arms.
        """
        if turns > self._turns_there:
            self.finish(found)

    def finish(self, found: Mapping[str, Any]) -> None:
        """Write all results."""
        plain = {"format": FORMAT, "settings": self._settings, **found}
        text = json.dumps(_without_nan(to_plain(plain)), indent=2, allow_nan=False)
        write_if_new(self._file, f"{text}\n".encode())

    def _check(self, data: bytes) -> None:
        """Check that the file has these settings, and count its rounds."""
        try:
            there = json.loads(data)
            is_ours = there["format"] == FORMAT
            settings = from_plain(FlywheelSettings, there["settings"], "settings")
            self._turns_there = sum(len(arm) for arm in there.get("arms", {}).values())
        except ConfigError as error:
            raise UsageError(f"{self._file}: {error}; choose another folder") from None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            is_ours = False
        if not is_ours:
            raise UsageError(
                f"{self._file} is not a file that this version can read; choose another folder"
            )
        different = first_difference(to_plain(settings), to_plain(self._settings))
        if different:
            raise UsageError(
                f"{self._file} was written with other settings than this run's (file against run:"
                f" {different}): use the same settings to continue, or choose another folder"
            )


def _without_nan(value: Any) -> Any:
    """Return plain data with None in place of NaN, which JSON lacks.

    An interval without data has NaN as its ends.
    """
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
