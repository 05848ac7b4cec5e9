"""What a blur found and did, as records that become ``privacy.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from grasp_factory.capture.consent import Consent


@dataclass(frozen=True, slots=True, kw_only=True)
class UsedModel:
    """A model that searched the images."""

    what: str
    """What it finds: ``face`` or ``plate``."""
    file: str
    sha256: str
    threshold: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundInFrame:
    """An image in which something was found."""

    image: int
    """Its number on its topic, from 0."""
    log_time_ns: int
    found: Mapping[str, int]
    """Number of boxes by what was found."""
    boxes: tuple[tuple[int, int, int, int], ...]
    """What was covered for it: left, top, right, bottom in pixels."""
    scores: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BlurredCamera:
    """The images of one topic."""

    topic: str
    device: str
    images: int
    found: Mapping[str, int]
    """Number of boxes in all images by what was found."""
    changed: int
    """Images that were changed, with those before and after an image with a box."""
    left: Mapping[str, int]
    """Boxes that were still found in changed images at the end."""
    smallest: Mapping[str, float]
    """The least height of what was found, pixels."""
    frames: tuple[FoundInFrame, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BlurReport:
    """What a blur found and did."""

    session: str
    """Name of the session's folder."""
    sha256: str
    """Of the session's file before the blur."""
    consent: Consent
    models: tuple[UsedModel, ...]
    margin: float
    carry_frames: int
    scale: float
    cameras: tuple[BlurredCamera, ...]
    depth_topics: tuple[str, ...]
    """Topics of depth images, in which the boxes of their camera were set to 0."""
    left_out: tuple[str, ...]
    """Files of the session's folder that were not copied, because they may have images."""

    @property
    def changed(self) -> int:
        """The number of colour images that were changed."""
        return sum(camera.changed for camera in self.cameras)

    def total(self, what: str) -> int:
        """Return how many boxes of a kind were found."""
        return sum(camera.found.get(what, 0) for camera in self.cameras)
