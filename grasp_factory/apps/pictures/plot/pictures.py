"""Images before and after an attempt: colour with the grasp, depth, segmentation."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from grasp_factory.apps.pictures import painting
from grasp_factory.apps.pictures.plot import style
from grasp_factory.apps.pictures.plot.style import NORMAL, SMALL, PageLayout
from grasp_factory.core import palette
from grasp_factory.core.enums import UNKNOWN, label_names
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array

GAP, TITLE, BAR, LEGEND = 8, 20, 34, 40
"""Room between images, above them, and below depth and segmentation."""
MOST_LABELS = 12
"""Maximum labels in the legend, in two rows."""
WHEN = ("before", "after")


def draw_pictures(
    page: PageLayout, box: tuple[float, float, float], episode: Episode, camera: str
) -> float:
    """Draw the images of a camera in two columns into a box: left, top, width.

    Returns:
        Where they end, from the top of the page.
    """
    left, top, width = box
    frames = episode.cameras[camera]
    pixels = painting.grasp_pixels(episode, frames)
    far = episode.spec.cameras[camera].far
    rows, columns = frames.depth.shape[1:]
    wide = (width - GAP) / 2
    high = min(wide * rows / columns, 0.8 * wide)
    axes = []
    for name, room in (("rgb", 0), ("depth", BAR), ("segmentation", LEGEND)):
        for k, when in enumerate(WHEN):
            ax = page.axes(left + k * (wide + GAP), top + TITLE, wide, high)
            style.bare(ax)
            title = when if name == "rgb" else f"{name} {when}"
            ax.set_title(title, loc="left", fontsize=NORMAL, pad=3)
            axes.append(ax)
        top += TITLE + high + room
        if name == "depth":
            _draw_depth(page, axes[2:4], frames, far, (left, top - BAR + 6, width))
        if name == "segmentation":
            _draw_labels(axes[4:6], frames, len(episode.spec.objects))
    for ax, image in zip(axes[:2], frames.rgb, strict=True):
        ax.imshow(image, interpolation="antialiased", aspect="equal")
    if pixels is not None:
        axes[0].set_title("before, with the planned grasp", loc="left", fontsize=NORMAL, pad=3)
        _draw_grasp(axes[0], pixels)
    return top


def _draw_depth(
    page: PageLayout,
    axes: list[Axes],
    frames: CameraFrames,
    far: float,
    bar: tuple[float, float, float],
) -> None:
    if np.isnan(frames.depth).all():
        for ax in axes:
            _draw_nothing(ax, frames)
        return
    near_and_far = painting.depth_span(frames.depth, frames.segmentation, far)
    span = Normalize(*near_and_far)
    colors = style.color_map(palette.depth_colors(), "depth").with_extremes(bad=style.NOTHING)
    for ax, depth in zip(axes, frames.depth, strict=True):
        seen = np.ma.masked_where(~(depth < far), depth)
        ax.imshow(seen, cmap=colors, norm=span, interpolation="nearest", aspect="equal")
    left, top, width = bar
    legend = page.axes(left, top, width, 7)
    page.figure.colorbar(ScalarMappable(span, colors), cax=legend, orientation="horizontal")
    legend.tick_params(labelsize=SMALL, length=2, pad=1)
    ticks = np.linspace(*near_and_far, 5)
    legend.set_xticks(ticks, [f"{tick:.2f} m" for tick in ticks])
    first, *_, last = legend.get_xticklabels()
    first.set_horizontalalignment("left")
    last.set_horizontalalignment("right")


def _draw_labels(axes: list[Axes], frames: CameraFrames, objects: int) -> None:
    if (frames.segmentation == UNKNOWN).all():
        for ax in axes:
            _draw_nothing(ax, frames)
        return
    palette = painting.label_palette()[:, ::-1]
    for ax, labels in zip(axes, frames.segmentation, strict=True):
        ax.imshow(palette[labels], interpolation="nearest", aspect="equal")
    words = dict(enumerate(label_names(objects)))
    there = [int(label) for label in np.unique(frames.segmentation) if int(label) in words]
    patches = [Patch(color=palette[label] / 255.0, label=words[label]) for label in there]
    if len(patches) > MOST_LABELS:
        more = f"{len(patches) - MOST_LABELS + 1} more"
        patches = [*patches[: MOST_LABELS - 1], Patch(color="none", label=more)]
    axes[0].legend(
        handles=patches, loc="upper left", bbox_to_anchor=(0.0, 0.0), ncols=6, frameon=False,
        fontsize=SMALL, borderaxespad=0.4, borderpad=0.0, handlelength=0.9, handleheight=0.9,
        handletextpad=0.4, columnspacing=1.0,
    )  # fmt: skip


def _draw_nothing(ax: Axes, frames: CameraFrames) -> None:
    """Say that an image was not measured."""
    height, width = frames.depth.shape[1:]
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    ax.set_facecolor(style.GRID)
    ax.text(
        0.5, 0.5, "not measured", transform=ax.transAxes, ha="center", va="center",
        fontsize=NORMAL, color=style.PALE,
    )  # fmt: skip


def _draw_grasp(ax: Axes, pixels: Array) -> None:
    left, right, tcp, back = pixels
    outline = [withStroke(linewidth=3.5, foreground="white")]
    limits = ax.get_xlim(), ax.get_ylim()
    for ends, marker in (((left, right), "o"), ((tcp, back), "")):
        x, y = zip(*ends, strict=True)
        ax.plot(
            x, y, color=style.GRASP, linewidth=1.8, marker=marker, markersize=3.5,
            path_effects=outline, clip_on=True,
        )  # fmt: skip
    ax.set(xlim=limits[0], ylim=limits[1])
