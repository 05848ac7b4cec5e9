"""Figures from scores: each with the bound it has to meet, if it has one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypedDict

from benchmarks.bench.contest import Scores
from benchmarks.bench.parts import ENGINE, PARTS
from benchmarks.bench.score import Score

from grasp_factory.core.text_format import table

MB = 1e6


class Bounds(TypedDict, total=False):
    """Of a figure."""

    at_least: float
    at_most: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One line of the result."""

    name: str
    value: float
    unit: str = ""
    at_least: float = -math.inf
    at_most: float = math.inf

    @property
    def bound(self) -> str:
        """The bound in words, empty without one."""
        if math.isfinite(self.at_least):
            return f">= {self.at_least:g}"
        return f"<= {self.at_most:g}" if math.isfinite(self.at_most) else ""

    @property
    def verdict(self) -> str:
        """Whether the bound is met, empty without one."""
        if not self.bound:
            return ""
        return "met" if self.at_least <= self.value <= self.at_most else "MISSED"


def table_text(figures: Iterable[Figure]) -> str:
    """Return figures as one table."""
    rows = [(f.name, f"{f.value:.3g}", f.unit, f.bound, f.verdict) for f in figures]
    return table([("figure", "value", "unit", "bound", ""), *rows], right=(1,))


def contest_figures(scores: Scores) -> list[Figure]:
    """Return rates and ratios, medians over the rounds; a ratio is taken within each round."""
    figures = [
        Figure(name=f"{name}: episodes/s", value=median(score.rate for score in found))
        for name, found in scores.items()
    ]
    if "article" in scores:
        share = median(score.cpu_seconds / score.seconds for score in scores["article"])
        figures.append(Figure(name="article: share of a core (1 on a calm machine)", value=share))
    for name, over, under, value, bounds in _RATIOS:
        if over in scores and under in scores:
            pairs = zip(scores[over], scores[under], strict=True)
            ratio = median(value(a) / value(b) if value(b) else math.nan for a, b in pairs)
            figures.append(Figure(name=name, value=ratio, **bounds))
    for name in [name for name in ("factory", "two") if name in scores]:
        peak = max(score.peak_bytes for score in scores[name]) / MB
        which = "largest worker" if name == "two" else "its one process"
        figures.append(Figure(name=f"{name}: peak memory, {which}", value=peak, unit="MB",
                              at_most=400))  # fmt: skip
    return figures


def _rate(score: Score) -> float:
    return score.rate


def _running_rate(score: Score) -> float:
    return score.details["running_rate"]


def _seconds(score: Score) -> float:
    return score.seconds / score.episodes


def _size(score: Score) -> float:
    return score.stored_bytes / score.episodes


_RATIOS: Sequence[tuple[str, str, str, Callable[[Score], float], Bounds]] = (
    ("factory / article: episodes/s", "factory", "article", _rate, {"at_least": 1.0}),
    ("fast / article: episodes/s", "fast", "article", _rate, {"at_least": 1.5}),
    ("factory / floor: seconds", "factory", "floor", _seconds, {"at_most": 1.35}),
    ("2 workers / 1, running", "two", "factory", _running_rate, {"at_least": 1.85}),
    ("2 workers / 1, with the start of processes", "two", "factory", _rate, {}),
    ("factory / article: bytes an episode", "factory", "article", _size, {"at_most": 1 / 6}),
)


def part_figures(score: Score) -> list[Figure]:
    """Return milliseconds an episode by part, then the engine's share of them."""
    per_episode = {name: 1000 * score.details[name] / score.episodes for name in (*PARTS, *ENGINE)}
    return [
        Figure(name=f"of which: {name}" if name in ENGINE else f"part: {name}",
               value=value, unit="ms")
        for name, value in per_episode.items()
    ]  # fmt: skip


def reader_figures(score: Score) -> list[Figure]:
    """Return milliseconds an episode, and how the store's compare with the files'."""
    found: Mapping[str, float] = score.details
    own = ("store", "png", "npy")
    return [
        *(Figure(name=f"read: {name}", value=1000 * found[name], unit="ms") for name in own),
        Figure(name="read: store / article's files", value=found["store"] / found["png"],
               at_most=1.0),
        Figure(name="read: store / all as .npy", value=found["store"] / found["npy"]),
        Figure(name="read: episodes/s by iter_blocks", value=found["iter_blocks_rate"]),
        Figure(name="read: episodes/s by dataset[i]", value=found["getitem_rate"]),
    ]  # fmt: skip


def memory_figures(score: Score) -> list[Figure]:
    """Return resident memory as episodes go by, and its growth since the first of them."""
    resident = {int(count): size / MB for count, size in score.details.items()}
    first, last = min(resident), max(resident)
    figures = [
        *(Figure(name=f"resident after {k}", value=resident[k], unit="MB") for k in resident),
        Figure(name="peak", value=score.peak_bytes / MB, unit="MB", at_most=400),
    ]
    if last >= 2 * first:
        growth = resident[last] - resident[first]
        figures.append(Figure(name=f"growth from {first} to {last}", value=growth, unit="MB",
                              at_most=20))  # fmt: skip
    return figures
