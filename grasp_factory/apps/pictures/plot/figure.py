"""The page of an episode: heading, curves on the left, images and touch on the right."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from numpy.typing import NDArray

from grasp_factory.apps.pictures.plot import SIZE, style
from grasp_factory.apps.pictures.plot.curves import draw_curves, is_drawn
from grasp_factory.apps.pictures.plot.pictures import draw_pictures
from grasp_factory.apps.pictures.plot.style import LARGE, SMALL, PageLayout, drawable
from grasp_factory.apps.pictures.plot.touch import draw_touch
from grasp_factory.core import palette
from grasp_factory.core.config.quality import quality_text
from grasp_factory.core.enums import label_names, word_of
from grasp_factory.core.episode import Episode
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.signals.plot_series import curve_groups, touch_moments

MARGIN, HEADING, FOOT = 24, 84, 30
SIDE = 620
"""Width of the images and the touch maps, on the right."""
AXIS = 64
"""Width left of the curves for their axes' numbers."""
NUMBERS = (
    ("lift_height", "lifted"),
    ("slip_distance", "slipped"),
    ("slip_angle", "turned in the hand"),
    ("min_grip_force", "least grip force"),
    ("hold_duration", "held"),
    ("shake_level", "survived a shake of"),
    ("loss_time", "lost at"),
)
"""Columns that are shown if they are more than 0, and their words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The episode that is drawn, and the facts of its store that are shown."""

    store: str
    """Name of the store."""
    row: int
    episode: Episode
    camera: str
    pad_size: tuple[float, float] | None
    """Width and height of a pad, metres; None where the store does not say."""
    maker: str
    """Version that made the store."""


def figure_of(subject: Subject, size: tuple[int, int] = SIZE) -> Figure:
    """Return the figure of an episode, ``size`` pixels wide and high when it is drawn."""
    scale = min(size[0] / SIZE[0], size[1] / SIZE[1])
    dpi = style.DPI * scale
    with mpl.rc_context():
        mpl.rcdefaults()  # the user's own settings must not change the picture
        mpl.rcParams.update({"axes.linewidth": 0.6, "text.color": style.INK})
        figure = Figure(figsize=(size[0] / dpi, size[1] / dpi), dpi=dpi, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        page = PageLayout(figure, size[0] / scale, size[1] / scale)
        _draw_heading(page, subject)
        _draw_attempt(page, subject)
        _draw_foot(page, subject)
        canvas.draw()  # type: ignore[no-untyped-call]
    return figure


def pixels_of(figure: Figure) -> NDArray[np.uint8]:
    """Return the pixels of a drawn figure, (H, W, 3) RGB."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    drawn = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    return np.asarray(drawn, np.uint8)[..., :3]


def facts(episode: Episode) -> list[str]:
    """Return the measurements of an attempt in words, without those that are missing or 0."""
    columns, spec = episode.columns, episode.spec
    words = []
    for column, what in NUMBERS:
        value, shown = float(columns.get(column, math.nan)), SHOWN_UNITS[column]
        if shown.factor * value >= 0.5 * 10.0**-shown.decimals:  # false for NaN
            words.append(f"{what} {shown.text(value)}")
    body = int(columns.get("collision_body", 0))
    touched = word_of(body, label_names(len(spec.objects)))
    if body and touched:
        words.append(f"hit the {touched}")
    if spec.objects[0].mass is not None:
        words.append(f"mass {SHOWN_UNITS['object_mass'].text(spec.objects[0].mass)}")
    if columns.get("quality"):
        words.append(f"quality {quality_text(int(columns['quality']))}")
    return words


def _draw_heading(page: PageLayout, subject: Subject) -> None:
    episode = subject.episode
    target = episode.spec.objects[0]
    word = episode.outcome.name.lower().replace("_", " ")
    color = palette.OUTCOMES[str(episode.outcome)].light
    width = 26 + 9.6 * len(word)
    badge = page.axes(MARGIN, 16, width, 26)
    style.bare(badge)
    badge.set(xlim=(0, width), ylim=(0, 26))
    badge.patch.set_visible(False)
    shape = "round,pad=0,rounding_size=12"
    badge.add_patch(FancyBboxPatch((1, 1), width - 2, 24, boxstyle=shape, color=color, linewidth=0))
    badge.text(
        width / 2, 12, word, color="white", ha="center", va="center_baseline",
        fontsize=11, fontweight="bold", parse_math=False,
    )  # fmt: skip
    proposer = episode.columns.get("grasp_proposer") or episode.spec.policy
    policy = episode.spec.policy
    by = policy if proposer == policy else f"{policy} ({proposer})"
    others = len(episode.spec.objects) - 1
    beside = f" with {others} other{'s' * (others > 1)}" if others else ""
    head = f"episode {subject.row}   {target.object_id}{beside}   {by}"
    left, right = MARGIN + width + 14, page.width - MARGIN
    page.text(left, 29, head, size=LARGE, weight="bold", room=right - left)
    page.text(MARGIN, 62, "   |   ".join(facts(episode)), size=10.5, room=right - MARGIN)


def _draw_attempt(page: PageLayout, subject: Subject) -> None:
    episode = subject.episode
    side = page.width - MARGIN - SIDE
    top, room = HEADING, page.height - HEADING - FOOT
    box = (MARGIN + AXIS, top, side - 2 * MARGIN - AXIS, room)
    draws_touch = "tactile_force" in episode.streams and subject.pad_size is not None
    moments = touch_moments(episode.streams) if draws_touch else ()
    columns: Any = episode.columns
    groups = curve_groups(
        episode.streams, episode.imu, columns["object_com"][0], columns["rest_height"]
    )
    if episode.n_steps and is_drawn(groups):
        draw_curves(page, box, episode, groups, moments)
    else:
        words = episode.outcome.name.lower().replace("_", " ")
        why = (
            "Neither joints, forces nor an IMU were recorded"
            if episode.is_real
            else f"The attempt ended before the arm moved ({words}): there is no record of it"
        )
        page.text(
            box[0] + box[2] / 2, top + room / 3, why, size=12, color=style.PALE, align="center"
        )
    bottom = draw_pictures(page, (side, top, SIDE), episode, subject.camera)
    if subject.pad_size is not None and episode.n_steps:
        height = page.height - FOOT - bottom
        draw_touch(page, (side, bottom, SIDE, height), episode.streams, subject.pad_size, moments)


def _draw_foot(page: PageLayout, subject: Subject) -> None:
    spec, target = subject.episode.spec, subject.episode.spec.objects[0]
    words = [
        subject.store,
        f"seed {spec.seed}, index {spec.index}",
        f"{target.split} split",
        spec.robot,
        f"camera {subject.camera}",
        f"made by grasp_factory {subject.maker}" if subject.maker else "",
    ]
    text = "   ".join(filter(None, map(drawable, words)))
    right, middle = page.width - MARGIN, page.height - 14
    page.text(right, middle, text, size=SMALL, color=style.PALE, align="right", room=right - MARGIN)
