"""The picture of the Allan deviation of both triads, with the fitted noise."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from grasp_factory.capture.calibration.allan import AllanCurve, NoiseFigures
from grasp_factory.capture.calibration.imu_calibrating import ImuCalibration
from grasp_factory.core import palette

_COLOURS = [curve.light for curve in palette.CURVES[:3]]
_PIXELS, _DPI = (1200, 560), 100


def draw_allan(found: ImuCalibration) -> bytes:
    """Return the picture as PNG."""
    figure = Figure(figsize=(_PIXELS[0] / _DPI, _PIXELS[1] / _DPI), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _draw(left, "accelerometer", ("m/s²", "m/s³"), found.curves[0], found.accelerometer)
    _draw(right, "gyroscope", ("rad/s", "rad/s²"), found.curves[1], found.gyroscope)
    figure.suptitle(
        f"Allan deviation of {found.duration_s / 60.0:.4g} min at {found.rate_hz:.4g} Hz:"
        " measured (lines) and fitted noise (dashed)",
        fontsize=12,
    )
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def _draw(
    ax: Axes,
    title: str,
    units: tuple[str, str],
    curve: AllanCurve,
    figures: tuple[NoiseFigures, ...],
) -> None:
    for k, colour in enumerate(_COLOURS):
        axis = figures[k]
        label = f"{'xyz'[k]}: N = {axis.density:.3g}, K = {axis.random_walk:.3g}"
        ax.loglog(curve.tau, curve.deviation[:, k], color=colour, linewidth=1.4, label=label)
        ax.loglog(curve.tau, curve.model[:, k], color=colour, linewidth=0.9, linestyle="--")
    ax.set_title(title, fontsize=11)
    ax.set_xlabel("averaging time, s")
    ax.set_ylabel(f"Allan deviation, {units[0]}")
    ax.grid(which="both", color=palette.GRID, linewidth=0.5)
    heading = f"N in {units[0]}/√Hz, K in {units[1]}/√Hz"
    ax.legend(fontsize=9, title=heading, title_fontsize=9, loc="lower left")
