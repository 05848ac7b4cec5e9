"""The file with the systematic errors of an inertial sensor: bias, scale, axes, temperature."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from grasp_factory.capture.calibration.document import read_document, record_of, write_document
from grasp_factory.core.serialization import normalise, to_plain
from grasp_factory.signals.imu_calibration import TriadModel


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuModel:
    """Systematic errors of both triads; ``true = matrix @ (raw - bias - slope * dT)``."""

    accelerometer: TriadModel = field(default_factory=TriadModel)
    """m/s2."""
    gyroscope: TriadModel = field(default_factory=TriadModel)
    """rad/s."""

    def __post_init__(self) -> None:
        """Check the types.

        Raises:
            ConfigError: naming the field.
        """
        normalise(self)


def read_imu_model(path: Path) -> ImuModel:
    """Return the model in a file.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is no such file.
    """
    return record_of(ImuModel, read_document(path), path)


def write_imu_model(path: Path, model: ImuModel) -> None:
    """Write a new file.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
        StoreError: if it cannot be written.
    """
    write_document(path, to_plain(model))
