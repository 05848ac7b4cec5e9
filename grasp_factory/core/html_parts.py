"""Parts of HTML for notebooks: escaped text, tables, pictures and curves; no scripts, no links."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.palette import CURVES
from grasp_factory.core.text_format import escaped
from grasp_factory.core.thumbnail_size import thumbnail_height

LONGEST = 200
"""Characters of a text."""
THUMB_WIDTH = 200
"""Pixels of a picture."""
_QUALITY = 80
"""Of a JPEG."""
MOST_POINTS = 240
"""Points of a curve."""
CURVE_WIDTH, CURVE_HEIGHT = 200, 60
"""Pixels."""
FLAT = 0.01
"""A curve whose span is this share of its largest value, or less, is drawn as a level line."""
_CELL = "text-align:left;padding:2px 10px 2px 0;vertical-align:top"


def html_text(value: object) -> str:
    """Return a value as text that is neither markup nor longer than ``LONGEST``."""
    text = str(value)
    cut = text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
    return html.escape(escaped(cut))


def html_table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Return texts as a table; ``head`` may be empty. Values are escaped."""
    lines = [html_row("th", map(html_text, head))] if head else []
    lines += [html_row("td", map(html_text, row)) for row in rows]
    return f'<table style="border-collapse:collapse">{"".join(lines)}</table>'


def html_row(tag: str, cells: Iterable[str]) -> str:
    """Return a line of a table from the HTML of its cells; ``tag`` is th or td."""
    texts = (f'<{tag} style="{_CELL}">{cell}</{tag}>' for cell in cells)
    return f"<tr>{''.join(texts)}</tr>"


def picture(rgb: NDArray[np.uint8], alt: str, width: int = THUMB_WIDTH) -> str:
    """Return an image (H, W, 3) as an element that contains it, ``width`` pixels wide."""
    import cv2  # noqa: PLC0415 (only notebooks need it)

    height = thumbnail_height(width, rgb.shape)
    how = cv2.INTER_AREA if rgb.shape[1] >= width else cv2.INTER_NEAREST
    small = cv2.resize(np.ascontiguousarray(rgb[..., ::-1]), (width, height), interpolation=how)
    _, data = cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
    source = f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}"
    return f'<img width="{width}" height="{height}" alt="{html_text(alt)}" src="{source}">'


def figure(content: str, caption: object) -> str:
    """Return an element of HTML with a caption below it; the caption is escaped."""
    style = "display:inline-block;margin:0 8px 8px 0"
    text = f"<figcaption>{html_text(caption)}</figcaption>"
    return f'<figure style="{style}">{content}{text}</figure>'


def curves(times: NDArray[Any], values: NDArray[Any], title: str) -> str:
    """Return curves over time as SVG.

    Args:
        times: (n,), ascending.
        values: (n, curves); the curves are drawn over the span of all of them. Points without a
            finite value are left out.
        title: What the curves show, for people who cannot see them.
    """
    step = -(-len(times) // MOST_POINTS) or 1
    at, shown = times[::step].astype(float), values[::step].astype(float)
    x = _scaled(at, at, 1.0, CURVE_WIDTH - 1.0)
    lines = []
    for k in range(shown.shape[1]):
        y = _scaled(shown[:, k], shown, CURVE_HEIGHT - 2.0, 2.0)
        known = np.isfinite(x + y)
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[known], y[known], strict=True))
        how = f'fill="none" stroke="{CURVES[k % len(CURVES)].light}" stroke-width="1.5"'
        lines.append(f'<polyline {how} points="{points}"/>')
    size = f'width="{CURVE_WIDTH}" height="{CURVE_HEIGHT}"'
    style = "border-left:1px solid gray;border-bottom:1px solid gray"
    label = html_text(title)
    return f'<svg {size} style="{style}" role="img" aria-label="{label}">{"".join(lines)}</svg>'


def _scaled(
    values: NDArray[Any], span: NDArray[Any], first: float, last: float
) -> NDArray[np.float64]:
    """Return values between ``first`` and ``last`` as they lie in a span; NaN if not finite."""
    known = span[np.isfinite(span)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    is_flat = high - low <= FLAT * max(abs(low), abs(high))
    share = np.full(values.shape, 0.5) if is_flat else (values - low) / (high - low)
    return np.where(np.isfinite(values), first + share * (last - first), np.nan)
