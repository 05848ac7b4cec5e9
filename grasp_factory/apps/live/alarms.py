"""Checks of a run: pure functions of its state. Each returns a finding or None."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from grasp_factory.apps.live.facts import Brightness, EpisodeFacts
from grasp_factory.apps.live.state import MINUTE_S, LiveState
from grasp_factory.apps.live.windows import median
from grasp_factory.core.alarm_book import Finding
from grasp_factory.labels.quality import CRITERIA, Criterion

BLACK, WHITE = 0.03, 0.97
"""Mean grey values, 0 to 1, beyond which an image shows nothing."""
CLIPPED = 0.95
"""Share of black or white pixels from which an image also shows nothing."""
NOT_TRIED = frozenset(("never_settled", "left_workspace", "no_plan", "unreachable"))
"""Outcomes of attempts in which the arm may not have moved, so that streams may be empty."""
FEWEST_POOR = 10
"""Minimum number of episodes for an alarm that more than half have poor quality."""
FEWEST_QUARANTINED = 5
QUARANTINED_SHARE = 0.1
PER_WINDOW = 30
"""Episodes that a window should have at least, so that random variation does not halve the rate."""
WINDOWS = 4
"""Minimum number of whole windows, after warm-up, that the last window is compared with."""
WARM_UP = 1
"""Windows at the start that are ignored."""
FALL = 0.5
"""Share of the median rate below which the rate counts as fallen."""
STALL_S = 60.0
START_S = 180.0
"""Seconds in which the first episode should be made; first simulators load and scenes settle."""
STALL_TIMES = 20.0
"""A stall also lasts longer than this many times the mean duration of an episode in the run."""
RESERVE = 200_000_000
"""Bytes that should still be free when all episodes are made."""
MOST_ROWS = 12
"""Maximum number of rows that an alarm lists."""


def empty_streams(state: LiveState, now: float) -> Finding | None:
    """Find attempts in which the arm moved but a series has no records."""
    found = [fact for fact in state.facts if fact.outcome not in NOT_TRIED and _empty(fact)]
    columns = sorted({column for fact in found for column in _empty(fact)})
    return _of_recent("stream", state, found, f"no records in {', '.join(columns)}")


def blank_images(state: LiveState, now: float) -> Finding | None:
    """Find episodes with an image that is completely black or white."""
    found = [(fact, words) for fact in state.facts if (words := _blank(fact))]
    seen = {text for fact, words in found for text in words if fact.images}
    what = "; ".join(sorted(seen or {text for _, words in found for text in words}))
    return _of_recent("image", state, [fact for fact, _ in found], what)


def poor_quality(state: LiveState, now: float) -> Finding | None:
    """Find a quality criterion that more than half of the latest episodes do not meet."""
    facts = list(state.facts)
    if len(facts) < FEWEST_POOR:
        return None
    for criterion in CRITERIA:
        poor = [fact for fact in facts if not _is_met(criterion, fact, state)]
        if 2 * len(poor) > len(facts):
            text = criterion.text(poor[-1].measured[criterion.column], state.asked.quality)
            return _of_recent("quality", state, poor, f"poor {criterion.group}: {text}")
    return None


def falling_rate(state: LiveState, now: float) -> Finding | None:
    """Find that the rate of the last window is less than half of the run's median rate."""
    if now <= 0.0 or state.left <= state.asked.workers * state.asked.block_size:
        return None  # near the end some workers have nothing to do
    whole = state.rates(now)["run"]
    if whole <= 0.0:
        return None
    rates = state.pace.rates(max(MINUTE_S, PER_WINDOW / whole), now)[WARM_UP:]
    if len(rates) <= WINDOWS:
        return None
    usual, last = median(rates[:-1]), rates[-1]
    if last >= FALL * usual:
        return None
    text = f"{last:.2g} episodes per second, {usual:.2g} is usual in this run"
    return Finding(kind="rate", text=text)


def success_drift(state: LiveState, now: float) -> Finding | None:
    """Find a change of the success rate; see ``drift.SuccessDrift``."""
    if state.shift is None:
        return None
    before, last = state.shift.before, state.shift.last
    return Finding(
        kind="drift",
        text=f"{last:.0%} of the last 100 attempts succeeded, {before:.0%} of those before",
    )


def many_quarantined(state: LiveState, now: float) -> Finding | None:
    """Find that a large share of the latest episodes is quarantined."""
    count, total = sum(state.recent), len(state.recent)
    if count < FEWEST_QUARANTINED or count <= QUARANTINED_SHARE * total:
        return None
    return Finding(kind="quarantine", text=f"{count} of the last {total} episodes are quarantined")


def stall(state: LiveState, now: float) -> Finding | None:
    """Find that no episode has been made for a long time."""
    if not state.left:
        return None
    if state.latest_at is None:
        longest, since = START_S, 0.0
    else:
        each = state.latest_at / state.made * state.asked.workers
        longest, since = max(STALL_S, STALL_TIMES * each), state.latest_at
    if now - since <= longest:
        return None
    return Finding(kind="stall", text=f"no episode has been made for {now - since:.0f} s")


def full_disk(state: LiveState, now: float) -> Finding | None:
    """Find that the disk is full, or will be before the run is done."""
    if state.disk is None or not state.left:
        return None
    need = state.left * state.disk.per_episode
    if state.disk.free >= need + RESERVE:
        return None
    text = f"{_size(state.disk.free)} are free"
    if need:
        text += f", the {state.left:,} episodes to come take about {_size(need)}"
    return Finding(kind="disk", text=text)


ALARM_CHECKS: Sequence[Callable[[LiveState, float], Finding | None]] = (
    stall,
    full_disk,
    empty_streams,
    blank_images,
    poor_quality,
    many_quarantined,
    success_drift,
    falling_rate,
)
"""All checks, the most urgent first."""


def findings(state: LiveState, now: float) -> list[Finding]:
    """Return all findings ``now`` seconds after the start, the most urgent first."""
    return [found for look in ALARM_CHECKS if (found := look(state, now))]


def _of_recent(
    kind: str, state: LiveState, found: Sequence[EpisodeFacts], what: str
) -> Finding | None:
    if not found:
        return None
    rows = tuple(sorted(fact.row for fact in found[-MOST_ROWS:]))
    text = f"{what}: {len(found)} of the latest {len(state.facts)} episodes"
    return Finding(kind=kind, text=text, rows=rows)


def _empty(fact: EpisodeFacts) -> list[str]:
    return [column for column, length in fact.lengths.items() if not length]


def _blank(fact: EpisodeFacts) -> list[str]:
    """Return a text for each image of an episode that shows nothing."""
    if fact.images:
        return [
            f"{name} is {word}" for name, light in fact.images.items() if (word := _word(light))
        ]
    if not {"exposure", "clipped"} <= set(fact.measured):
        return []
    worst = Brightness(mean=fact.measured["exposure"], clipped=fact.measured["clipped"])
    word = _word(worst)
    return [f"an image before is {word}"] if word else []


def _word(light: Brightness) -> str:
    if light.mean <= BLACK or light.mean >= WHITE or light.clipped >= CLIPPED:
        return "black" if light.mean < 0.5 else "white"
    return ""


def _is_met(criterion: Criterion, fact: EpisodeFacts, state: LiveState) -> bool:
    value = fact.measured.get(criterion.column, np.nan)
    return bool(criterion.is_met(value, state.asked.quality))


def _size(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e8 else f"{number / 1e6:.1f} MB"
