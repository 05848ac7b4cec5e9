"""What is blurred in a session, and how."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from grasp_factory.capture.privacy.face_model import THRESHOLD
from grasp_factory.core.serialization import check_range


@dataclass(frozen=True, slots=True, kw_only=True)
class BlurSettings:
    """Settings of a blur; the defaults find more rather than less."""

    face_threshold: float = THRESHOLD
    """The least score of a face."""
    scale: float = 1.0
    """Factor of the images' size before faces are searched; 0.5 takes a quarter of the time."""
    plates: Path | None = None
    """The user's model of licence plates; without one, plates are not searched."""
    plate_threshold: float = 0.25
    """The least score of a plate."""
    margin: float = 0.25
    """Share of a box's size that is added on each of its sides."""
    carry_frames: int = 2
    """What is found in an image is blurred in this many images before and after it, too."""

    def __post_init__(self) -> None:
        check_range(self, "face_threshold", 0.01, 1.0)
        check_range(self, "scale", 0.1, 4.0)
        check_range(self, "plate_threshold", 0.01, 1.0)
        check_range(self, "margin", 0.0, 2.0)
        check_range(self, "carry_frames", 0, 1000, "images")
