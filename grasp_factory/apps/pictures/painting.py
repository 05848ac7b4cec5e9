"""Pictures of an episode's arrays, and the few shapes and letters in a sheet.

Images are BGR uint8, as OpenCV expects them.
"""

from __future__ import annotations

import re

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import palette
from grasp_factory.core.camera import project
from grasp_factory.core.enums import UNKNOWN, Label, Outcome, names
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, apply, inverse, quat_xyzw_to_matrix, transform

BgrImage = NDArray[np.uint8]
BgrColor = tuple[int, int, int]


def bgr(color: str) -> BgrColor:
    """Return a colour of ``palette`` as OpenCV expects it."""
    red, green, blue = palette.rgb(color)
    return blue, green, red


INK, PALE, PAPER = (bgr(color) for color in (palette.INK, palette.PALE, palette.PAPER))
WHITE: BgrColor = (255, 255, 255)
GRASP_COLOR, TARGET_COLOR, OUTLINE = (
    bgr(color) for color in (palette.GRASP, palette.TARGET, palette.OUTLINE)
)
NOTHING = bgr(palette.NOTHING)
"""Colour of pixels where a depth image sees nothing, and of pixels that were not labelled."""
LABEL_COLORS = {word: bgr(color) for word, color in palette.LABELS.items()}
"""Colours by the names of ``Label``."""
OTHER_COLORS = tuple(map(bgr, palette.OTHERS))
"""Colours of the objects other than the target, in turn."""

NEAR = 0.01
"""Minimum distance in metres from the camera at which a grasp is drawn."""

OUTLINED = 120
"""Width of an image, pixels, for each pixel of an outline's thickness."""
MOST_LETTERS = 1000
"""Letters of a text that are drawn."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def outcome_color(outcome: Outcome) -> BgrColor:
    """Return the colour of an outcome."""
    return bgr(palette.OUTCOMES[str(outcome)].light)


def drawable(text: str) -> str:
    """Return the start of a text; ``?`` replaces each character that OpenCV's font lacks."""
    return re.sub("[^ -~]", "?", text[:MOST_LETTERS])


def put_text(
    image: BgrImage, text: str, at: tuple[int, int], color: BgrColor = INK, height: int = 13
) -> int:
    """Write text with its left end and vertical middle at ``at``; return its width."""
    shown, scale = drawable(text), height / 22.0  # the font's capitals are 22 px high at scale 1
    (width, _), _ = cv2.getTextSize(shown, _FONT, scale, 1)
    origin = (at[0], at[1] + round(height * 0.5))
    cv2.putText(image, shown, origin, _FONT, scale, color, 1, cv2.LINE_AA)
    return int(width)


def put_badge(
    image: BgrImage, text: str, at: tuple[int, int], color: BgrColor, height: int = 22
) -> int:
    """Draw white text in a rounded box whose left middle is at ``at``; return its width."""
    (text_width, _), _ = cv2.getTextSize(drawable(text), _FONT, 13 / 22.0, 1)
    width, radius = int(text_width) + height, height // 2
    x, y = at
    ends = [(x + radius, y), (x + width - radius, y)]
    for end in ends:
        cv2.circle(image, end, radius, color, cv2.FILLED, cv2.LINE_AA)
    cv2.rectangle(
        image, (ends[0][0], y - radius), (ends[1][0], y + radius), color, cv2.FILLED, cv2.LINE_AA
    )
    put_text(image, text, (x + radius, y), WHITE)
    return width


def depth_picture(depth: NDArray[np.float32], near: float, far: float, nothing: float) -> BgrImage:
    """Return a depth image (H, W) in metres as colours: ``near`` dark, ``far`` bright.

    Pixels at ``nothing`` metres or beyond, where the camera sees nothing, are dark.
    """
    share = np.clip((np.nan_to_num(depth) - near) / max(far - near, 1e-6), 0.0, 1.0)
    colors = palette.depth_colors()[(share * 255.0).astype(np.uint8), ::-1]
    colors[~(depth < nothing)] = NOTHING  # NaN as well
    return np.asarray(colors, np.uint8)


def depth_span(
    depth: NDArray[np.float32], labels: NDArray[np.uint8], far: float | Array
) -> tuple[float, float]:
    """Return the range of depths, metres, for colours: that of the table and the objects on it.

    If neither is visible, it is the range of everything that is visible.

    Args:
        depth: of one image or more, (..., H, W), metres.
        labels: their segmentations, (..., H, W).
        far: the depth from which nothing is visible, metres; it must broadcast to ``depth``.
    """
    is_seen = np.isfinite(depth) & (depth < far)
    of_interest = is_seen & ((labels == Label.TABLE) | (labels >= Label.TARGET))
    values = depth[of_interest if of_interest.any() else is_seen]
    if not len(values):
        return 0.0, 1.0
    low, high = (float(v) for v in np.percentile(values, [1.0, 99.0]))
    return low, max(high, low + 1e-3)


def depth_bar(width: int, height: int) -> BgrImage:
    """Return the legend of ``depth_picture``, from near on the left to far on the right."""
    return depth_picture(np.tile(np.linspace(0, 1, width, dtype=np.float32), (height, 1)), 0, 1, 9)


def label_picture(segmentation: NDArray[np.uint8]) -> BgrImage:
    """Return a segmentation image (H, W) with one colour per label."""
    return label_palette()[segmentation]


def label_palette() -> BgrImage:
    """Return the colour of every label value, (256, 3); that of pixels without a label is dark."""
    words = names(Label)
    table = [LABEL_COLORS[word] for word in words]
    more = 256 - len(table)
    table += [OTHER_COLORS[i % len(OTHER_COLORS)] for i in range(more)]
    table[UNKNOWN] = NOTHING
    return np.array(table, np.uint8)


def grasp_pixels(episode: Episode, frames: CameraFrames) -> Array | None:
    """Return the pixels (4, 2) of a grasp; None if none was planned or it cannot be drawn.

    They are left pad, right pad, TCP, and 5 cm back along the approach. The distance between the
    pads is that before closing.
    """
    columns = episode.columns
    quat = columns["grasp_quat_xyzw"]
    if not np.linalg.norm(quat) > 0.0:  # no orientation, or NaN
        return None
    T = transform(quat_xyzw_to_matrix(quat), columns["grasp_position"])
    half = columns["grasp_width"] / 2.0
    local = np.array([[0, half, 0], [0, -half, 0], [0, 0, 0], [0, 0, -0.05]], np.float64)
    camera = apply(inverse(frames.T_world_camera[0]), apply(T, local))
    if not (camera[:, 2] > NEAR).all():  # behind the camera, or NaN
        return None
    pixels = project(camera, frames.intrinsics)
    return pixels if np.isfinite(pixels).all() else None


def put_grasp(image: BgrImage, pixels: Array) -> None:
    """Draw a grasp: a bar between the pads, a stem along the approach, both with a thin outline."""
    left, right, tcp, back = (tuple(int(v) for v in np.rint(p)) for p in pixels)
    for color, thickness in ((WHITE, 4), (GRASP_COLOR, 2)):
        cv2.line(image, left, right, color, thickness, cv2.LINE_AA)
        cv2.line(image, tcp, back, color, thickness, cv2.LINE_AA)
        for pad in (left, right):
            cv2.circle(image, pad, thickness, color, cv2.FILLED, cv2.LINE_AA)


def put_outline(image: BgrImage, mask: NDArray[np.bool_]) -> None:
    """Draw a line in the target's colour around the pixels of a mask (H, W), on a dark ground."""
    thick = max(1, round(image.shape[1] / OUTLINED))
    around = cv2.dilate(mask.astype(np.uint8), np.ones((2 * thick + 1,) * 2, np.uint8))
    found, _ = cv2.findContours(around, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for color, thickness in ((OUTLINE, thick + 1), (TARGET_COLOR, thick)):
        cv2.drawContours(image, found, -1, color, thickness, cv2.LINE_AA)
