"""The folder of a session while it is recorded: settings, calibration files, the MCAP file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from grasp_factory import __version__
from grasp_factory.capture.session.camera_info import read_calibration
from grasp_factory.capture.session.session_config import (
    SessionConfig,
    calibration_files,
    plain_config,
)
from grasp_factory.capture.session.session_file import SessionFile
from grasp_factory.capture.session.session_record import (
    CALIBRATION,
    DATA,
    METADATA,
    SETTINGS,
    VERSION,
    RecordedSession,
    write_record,
)
from grasp_factory.core.locked_file import open_locked
from grasp_factory.core.output_folder import check_free
from grasp_factory.core.place import Place, place_of
from grasp_factory.errors import StoreError


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFile:
    """A calibration file, read."""

    path: Path
    content: bytes


def read_calibrations(config: SessionConfig, beside: Path) -> dict[str, CalibrationFile]:
    """Return the calibration file of each device that has one.

    Raises:
        ConfigError: if a file is not there.
        CaptureError: if it cannot be read.
    """
    found = calibration_files(config, beside)
    return {n: CalibrationFile(path=p, content=read_calibration(p)) for n, p in found.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFolder:
    """The folder while it is recorded."""

    place: Place
    config: SessionConfig
    calibrations: Mapping[str, CalibrationFile]

    @classmethod
    def create(
        cls, out: Path, config: SessionConfig, calibrations: Mapping[str, CalibrationFile]
    ) -> SessionFolder:
        """Make the folder, with the settings and the calibration files.

        Raises:
            UsageError: if its name is taken, or it cannot lie there.
            StoreError: if the disk fails.
        """
        check_free(out, "a recording")
        try:
            out.mkdir()
            folder = cls(place=place_of(out), config=config, calibrations=calibrations)
            text = yaml.safe_dump(plain_config(config), sort_keys=False, allow_unicode=True)
            (folder.place / SETTINGS).write(text.encode(), durable=True)
            if calibrations:
                (folder.place / CALIBRATION).mkdir()
            for name, file in calibrations.items():
                (folder.place / CALIBRATION / _stored_name(name, file)).write(
                    file.content, durable=True
                )
        except OSError as error:
            raise StoreError(f"{out} cannot be written: {error.strerror}") from None
        return folder

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.place.path

    def open_data(self) -> int:
        """Return the descriptor of the new MCAP file; it is locked as long as it is open.

        Raises:
            OSError: if the disk fails.
        """
        return open_locked(self.path / DATA)

    def write_head(self, file: SessionFile, started_ns: int, offset_ns: int) -> None:
        """Write what the file tells about the session: settings and calibration.

        Args:
            file: the started file.
            started_ns: host time of the start.
            offset_ns: the epoch's time minus host time.
        """
        file.add_metadata(
            METADATA,
            {
                "version": str(VERSION),
                "made_with": __version__,
                "start_ns": str(started_ns + offset_ns),
                "offset_ns": str(offset_ns),
                "settings": json.dumps(plain_config(self.config), allow_nan=False),
            },
        )
        for name, calibration in self.calibrations.items():
            stored = f"{CALIBRATION}/{_stored_name(name, calibration)}"
            file.add_attachment(stored, "text/yaml", calibration.content, started_ns + offset_ns)

    def write_record(self, record: RecordedSession) -> None:
        """Write ``session.json``.

        Raises:
            StoreError: if the disk fails.
        """
        try:
            write_record(self.place, record)
        except OSError as error:
            raise StoreError(f"{self.path} cannot be written: {error.strerror}") from None


def _stored_name(device: str, file: CalibrationFile) -> str:
    """Return a file's name in the session: the device's, with the suffix of the file."""
    return device + (file.path.suffix if file.path.suffix.isascii() else "")
