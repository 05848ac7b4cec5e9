"""What is wrong with a run: pure functions over its state, and a book of when each began and ended.

Each says what was found, or nothing; nobody is told twice of one thing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grasp_factory.apps.live.facts import Brightness, EpisodeFacts
from grasp_factory.apps.live.state import MINUTE_S, LiveState
from grasp_factory.apps.live.windows import median
from grasp_factory.labels.quality import CRITERIA, Criterion

BLACK, WHITE = 0.03, 0.97
"""Mean grey values, 0 to 1, beyond which an image shows nothing."""
CLIPPED = 0.95
"""Share of black or white pixels from which it shows nothing, either."""
NOT_TRIED = frozenset(("never_settled", "left_workspace", "no_plan", "unreachable"))
"""Outcomes of attempts in which the arm need not have moved, so that streams may be empty."""
FEWEST_POOR = 10
"""Episodes after which more than half of poor quality are an alarm."""
FEWEST_QUARANTINED = 5
QUARANTINED_SHARE = 0.1
PER_WINDOW = 30
"""Episodes that a window of the rate has at least, so that chance does not halve it."""
WINDOWS = 4
"""Whole windows before the last that the rate is compared with, at least, after warm-up."""
WARM_UP = 1
"""Windows at the start that do not count."""
FALL = 0.5
"""Share of the median rate below which it has fallen."""
STALL_S = 60.0
START_S = 180.0
"""Seconds in which the first episode should be made; simulators load, scenes settle."""
STALL_TIMES = 20.0
"""A stall is also longer than so many times what an episode takes in the run."""
RESERVE = 200_000_000
"""Bytes that should be free in any case."""
MOST_ROWS = 12
"""Rows that an alarm names."""
AGAIN_S = 600.0
"""Seconds in which an alarm that ends and begins anew is not told again."""
MOST_PAST = 20
"""Ended alarms that are remembered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Something wrong, at this moment."""

    kind: str
    text: str
    rows: tuple[int, ...] = ()
    """Episodes that show it, ascending, the latest few."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """A finding that lasts, or has lasted; times are seconds after the run's start."""

    kind: str
    since: float
    text: str
    rows: tuple[int, ...] = ()
    until: float | None = None
    """When its cause ended; None while it lasts."""


def empty_streams(state: LiveState, now: float) -> Finding | None:
    """Find attempts of which a series has no records, though the arm moved."""
    found = [fact for fact in state.facts if fact.outcome not in NOT_TRIED and _empty(fact)]
    columns = sorted({column for fact in found for column in _empty(fact)})
    return _of_recent("stream", state, found, f"no records in {', '.join(columns)}")


def blank_images(state: LiveState, now: float) -> Finding | None:
    """Find episodes with an image that is black or white all over."""
    found = [(fact, words) for fact in state.facts if (words := _blank(fact))]
    seen = {text for fact, words in found for text in words if fact.images}
    what = "; ".join(sorted(seen or {text for _, words in found for text in words}))
    return _of_recent("image", state, [fact for fact, _ in found], what)


def poor_quality(state: LiveState, now: float) -> Finding | None:
    """Find a criterion of quality that more than half of the latest episodes do not meet."""
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
    """Find a last window that made less than half of what windows of the run make."""
    if now <= 0.0 or state.left <= state.asked.workers * state.asked.block_size:
        return None  # at the end workers have nothing to do
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
    """Find that much of what was made last is in quarantine."""
    count, total = sum(state.recent), len(state.recent)
    if count < FEWEST_QUARANTINED or count <= QUARANTINED_SHARE * total:
        return None
    return Finding(kind="quarantine", text=f"{count} of the last {total} episodes are quarantined")


def stall(state: LiveState, now: float) -> Finding | None:
    """Find that no episode has been made for long."""
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
"""All that is looked for, the most urgent first."""


def findings(state: LiveState, now: float) -> list[Finding]:
    """Return all that is wrong ``now`` seconds after the start, the most urgent first."""
    return [found for look in ALARM_CHECKS if (found := look(state, now))]


class AlarmBook:
    """Keeps when alarms began and ended, and which of them are to be told."""

    def __init__(self) -> None:
        self.lasting: dict[str, Alarm] = {}
        """By kind, in the order of ``ALARM_CHECKS``."""
        self.past: list[Alarm] = []
        """The last that ended, oldest first."""
        self._told: dict[str, float] = {}

    def update(self, found: Iterable[Finding], now: float) -> list[Alarm]:
        """Take what is wrong now; return the alarms that people are to be told of."""
        before, self.lasting = self.lasting, {}
        for one in found:
            since = before[one.kind].since if one.kind in before else now
            self.lasting[one.kind] = Alarm(kind=one.kind, since=since, text=one.text, rows=one.rows)
        ended = [alarm for kind, alarm in before.items() if kind not in self.lasting]
        self.past = [*self.past, *(replace(a, until=now) for a in ended)][-MOST_PAST:]
        new = [alarm for kind, alarm in self.lasting.items() if kind not in before]
        fresh = [a for a in new if now - self._told.get(a.kind, -AGAIN_S) >= AGAIN_S]
        self._told.update({alarm.kind: now for alarm in fresh})
        return fresh


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
    """Return in words which images of an episode show nothing."""
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
