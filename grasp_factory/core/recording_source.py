"""What a real episode was cut from: with it, importing the recording gives the same bytes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.serialization import check, check_range

_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSource:
    """A part of a recorded session, and how it was imported."""

    session: str
    """Name of the session's folder."""
    path: str
    """Its path when it was imported; only for people."""
    sha256: str
    """SHA-256 (hex) of ``session.mcap``."""
    start_ns: int
    """Start of the episode, ns since the epoch."""
    end_ns: int
    """Its end."""
    label_until_ns: int
    """Events of the operator before this time may label the episode."""
    calibration_sha256: str = ""
    """SHA-256 over the names and contents of session.yaml and the calibration files."""
    label: str = ""
    """Outcome that the operator named in a list of cuts; empty if it named none."""
    settings: Mapping[str, Any]
    """The settings of the import, as plain data."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        check(bool(_SHA256.fullmatch(self.sha256)), "sha256", self.sha256, "64 hexadecimal digits")
        ok = not self.calibration_sha256 or bool(_SHA256.fullmatch(self.calibration_sha256))
        check(ok, "calibration_sha256", self.calibration_sha256, "64 hexadecimal digits, or empty")
        check_range(self, "start_ns", 0, 2**63 - 1, "ns")
        valid = f"after start_ns ({self.start_ns})"
        check(self.start_ns < self.end_ns < 2**63, "end_ns", self.end_ns, valid)
