"""The file with the result of a hand-eye calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from grasp_factory.capture.calibration.document import read_document, record_of, write_document
from grasp_factory.capture.calibration.hand_eye import HandEyeFit, HandEyeSetup
from grasp_factory.capture.calibration.kalibr import Matrix4
from grasp_factory.core.serialization import normalise, to_plain


@dataclass(frozen=True, slots=True, kw_only=True)
class HandEyeResult:
    """Where a camera sits: on the gripper, or in the base's frame."""

    setup: HandEyeSetup
    transform: Matrix4
    """``T_gripper_camera`` for ``in_hand``, ``T_base_camera`` for ``to_hand``; metres."""
    pairs: int
    position_rms: float
    """m: what the pairs disagree by on the board's position."""
    rotation_rms: float
    """rad."""

    def __post_init__(self) -> None:
        """Check the types.

        Raises:
            ConfigError: naming the field.
        """
        normalise(self)


def read_hand_eye(path: Path) -> HandEyeResult:
    """Return the result in a file.

    Raises:
        UsageError: if the file cannot be opened.
        CaptureError: if it is no such file.
    """
    return record_of(HandEyeResult, read_document(path), path)


def write_hand_eye(path: Path, fit: HandEyeFit) -> None:
    """Write a new file.

    Raises:
        UsageError: if the name is taken, or its folder does not exist.
        StoreError: if it cannot be written.
    """
    result = HandEyeResult(
        setup=fit.setup,
        transform=tuple(map(tuple, fit.transform.tolist())),  # type: ignore[arg-type]
        pairs=fit.pairs,
        position_rms=fit.position_rms,
        rotation_rms=fit.rotation_rms,
    )
    write_document(path, to_plain(result))
