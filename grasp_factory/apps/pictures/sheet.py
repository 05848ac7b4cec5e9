"""The contact sheet: a picture with one row per episode, as a quick overview."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures import painting
from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.core.enums import UNKNOWN, label_names, word_of
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.output_file import FileKind, check_out, written_aside
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError, lookup

COLUMNS = ("before", "after", "depth before", "segmentation before")
PANEL_WIDTH = 320
MARGIN, GAP = 16, 6
HEADER, CAPTION = 58, 34
"""Pixels above the first row, and above each row's panels."""
WORTH_TELLING = 0.005
"""Lift in metres above which a caption reports it."""
DEFAULT, MOST = 12, 60
"""Default and maximum number of episodes on a sheet."""
PNG = FileKind(what="a PNG image", suffix=".png", magic=b"\x89PNG\r\n\x1a\n")


def choose_episodes(success: NDArray[np.bool_], most: int = 12) -> NDArray[np.int64]:
    """Return up to ``most`` positions, spread evenly, with both classes where both exist."""
    good, bad = np.flatnonzero(success), np.flatnonzero(~success)
    n_good = min(len(good), max((most + 1) // 2, most - len(bad)))
    n_bad = min(len(bad), most - n_good)
    return np.sort(np.concatenate([_spread(good, n_good), _spread(bad, n_bad)]))


def chosen(
    dataset: Dataset, indices: Sequence[int] | None, n: int | None, *, default: int, most: int
) -> list[int]:
    """Return the indices of the episodes that a sheet shows.

    Args:
        dataset: The store.
        indices: Those to choose from, in the order in which they are shown; None for all that are
            committed.
        n: Maximum number, of both classes; None for all of ``indices``, or for ``default`` if
            ``indices`` is None.
        default: See ``n``.
        most: Maximum number on a sheet.

    Raises:
        UsageError: for an index that the store does not have, or for more episodes than ``most``.
    """
    room = (default if indices is None else most) if n is None else n
    if not 1 <= room <= most:
        raise UsageError(f"{room} episodes on a sheet: valid: 1 to {most}")
    for index in indices or ():
        if not 0 <= index < len(dataset):
            raise UsageError(
                f"episode {index}: {dataset.path} has episodes 0 to {len(dataset) - 1}"
            )
    if indices is not None and n is None and len(indices) > most:
        what = f"{len(indices)} episodes are more than the {most} of a sheet"
        raise UsageError(f"{what}: --n {most} draws some of them, --tiles has room for more")
    rows = dataset.committed if indices is None else np.array(indices, np.int64)
    if len(rows) > room:
        rows = rows[choose_episodes(dataset.column("success")[rows], room)]
    return [int(row) for row in rows]


def sheet_of(
    dataset: Dataset, indices: Sequence[int] | None, camera: str, n: int | None = None
) -> BgrImage:
    """Return the sheet of a store's episodes; if ``indices`` is None, of a selection.

    Args:
        dataset: The store.
        indices: Indices of the episodes, from the top.
        camera: The camera whose images are shown.
        n: Maximum number of episodes, chosen from these.

    Raises:
        UsageError: for an index that the store does not have, a store without episodes, or more
            episodes than fit on a sheet.
        StoreError: for an episode that is missing or quarantined.
    """
    rows = chosen(dataset, indices, n, default=DEFAULT, most=MOST)
    return draw_sheet([dataset[row] for row in rows], camera)


def draw_sheet(episodes: Sequence[Episode], camera: str) -> BgrImage:
    """Return the sheet, BGR: a caption and four panels for each episode.

    Raises:
        UsageError: if there are no episodes.
        UnknownNameError: for a camera that the episodes do not have.
    """
    if not episodes:
        raise UsageError("there is no episode to draw")
    first = lookup(episodes[0].cameras, "camera", camera)
    panel = _panel_size(first)
    height = HEADER + len(episodes) * (CAPTION + panel[1] + GAP) + MARGIN
    width = 2 * MARGIN + len(COLUMNS) * panel[0] + (len(COLUMNS) - 1) * GAP
    sheet: BgrImage = np.full((height, width, 3), painting.PAPER, np.uint8)
    span = _depth_span(episodes, camera)
    _draw_header(sheet, panel[0], span)
    for i, episode in enumerate(episodes):
        top = HEADER + i * (CAPTION + panel[1] + GAP)
        _draw_caption(sheet, episode, (MARGIN, top + CAPTION // 2 + 2))
        for x, picture in zip(_lefts(panel[0]), _panels(episode, camera, panel, span), strict=True):
            sheet[top + CAPTION : top + CAPTION + panel[1], x : x + panel[0]] = picture
    return sheet


def check_png(path: Path) -> None:
    """Check that a PNG image may be written to ``path``.

    Raises:
        UsageError: if the name does not end in .png, its folder does not exist, or ``path``
            exists and is not a PNG image.
    """
    check_out(path, [PNG])


def write_png(path: Path, image: BgrImage) -> None:
    """Write an image as PNG.

    Raises:
        UsageError: as ``check_png`` does.
        StoreError: if the file cannot be written.
    """
    check_png(path)
    ok, data = cv2.imencode(".png", image)
    assert ok
    with written_aside(path) as partial:
        partial.write_bytes(data.tobytes())


def caption(episode: Episode) -> str:
    """Return the text next to an episode's outcome: index, object, policy and measurements."""
    spec, lift = episode.spec, episode.columns["lift_height"]
    words = [f"#{spec.index}", spec.objects[0].object_id, spec.policy]
    if lift > WORTH_TELLING:  # false for NaN
        words.append(f"lifted {SHOWN_UNITS['lift_height'].text(lift)}")
    body = word_of(int(episode.columns["collision_body"]), label_names(len(spec.objects)))
    if episode.columns["collision_body"] and body:
        words.append(f"hit the {body}")
    return "   ".join(words)


def _spread(positions: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    where = np.linspace(0, len(positions) - 1, count) if count > 1 else np.zeros(count)
    return positions[np.rint(where).astype(np.int64)]


def _panel_size(frames: CameraFrames) -> tuple[int, int]:
    height, width = frames.depth.shape[1:]
    return PANEL_WIDTH, max(1, round(PANEL_WIDTH * height / width))


def _lefts(panel_width: int) -> list[int]:
    return [MARGIN + i * (panel_width + GAP) for i in range(len(COLUMNS))]


def _depth_span(episodes: Sequence[Episode], camera: str) -> tuple[float, float]:
    """Return the ``depth_span`` of the first images of all episodes together."""
    frames = [episode.cameras[camera] for episode in episodes]
    depth = np.stack([found.depth[0] for found in frames])
    labels = np.stack([found.segmentation[0] for found in frames])
    far = np.array([episode.spec.cameras[camera].far for episode in episodes])
    return painting.depth_span(depth, labels, far[:, None, None])


def _draw_header(sheet: BgrImage, panel_width: int, span: tuple[float, float]) -> None:
    lefts = _lefts(panel_width)
    for x, title in zip(lefts, COLUMNS, strict=True):
        painting.put_text(sheet, title, (x, 20), painting.INK, 15)
    painting.put_text(sheet, "with the planned grasp", (lefts[0], 44), painting.PALE, 11)
    x = lefts[2]
    x += painting.put_text(sheet, f"{span[0]:.2f} m", (x, 44), painting.PALE, 11) + 8
    bar = painting.depth_bar(120, 10)
    sheet[39:49, x : x + 120] = bar
    painting.put_text(sheet, f"{span[1]:.2f} m", (x + 128, 44), painting.PALE, 11)
    x = lefts[3]
    for word, color in painting.LABEL_COLORS.items():
        if word != "background":
            cv2.rectangle(sheet, (x, 39), (x + 9, 48), color, cv2.FILLED)
            x += 14 + painting.put_text(sheet, word, (x + 14, 44), painting.PALE, 11) + 10


def _draw_caption(sheet: BgrImage, episode: Episode, at: tuple[int, int]) -> None:
    color = painting.outcome_color(episode.outcome)
    word = episode.outcome.name.lower().replace("_", " ")
    x = at[0] + painting.put_badge(sheet, word, at, color) + 12
    painting.put_text(sheet, caption(episode), (x, at[1]), painting.INK)


def _panels(
    episode: Episode, camera: str, size: tuple[int, int], span: tuple[float, float]
) -> list[BgrImage]:
    frames = episode.cameras[camera]
    far = episode.spec.cameras[camera].far
    before, after = (_fit(image[..., ::-1], size) for image in frames.rgb)
    pixels = painting.grasp_pixels(episode, frames)
    if pixels is not None:
        painting.put_grasp(before, (pixels + 0.5) * size[0] / frames.rgb.shape[2] - 0.5)
    depth = _fit(painting.depth_picture(frames.depth[0], *span, far), size)
    labels = _fit(painting.label_picture(frames.segmentation[0]), size, exact=True)
    if np.isnan(frames.depth[0]).all():
        _say_not_measured(depth)
    if (frames.segmentation[0] == UNKNOWN).all():
        _say_not_measured(labels)
    return [before, after, depth, labels]


def _say_not_measured(picture: BgrImage) -> None:
    painting.put_text(picture, "not measured", (GAP, picture.shape[0] // 2), painting.WHITE)


def _fit(image: BgrImage, size: tuple[int, int], *, exact: bool = False) -> BgrImage:
    """Scale an image; ``exact`` does not mix its colours."""
    shrinks = image.shape[1] >= size[0]
    how = cv2.INTER_NEAREST if exact else cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(np.ascontiguousarray(image), size, interpolation=how), np.uint8)
