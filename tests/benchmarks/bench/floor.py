"""The floor: the bare steps and renders of the factory's own episodes, with nothing around them.

An episode is run once, with every call into the engine kept on a tape. The tape is then played to
the engine again without what only reads; a clock runs in stepSimulation and getCameraImage alone.
The pictures must come out as they were, or the tape is not the episode.
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, field
from typing import Any

from benchmarks.bench.engine import Call, watched_engine
from benchmarks.bench.factory import WARM_UP_SEED, config_of
from benchmarks.bench.score import WARM_UP_EPISODES, Score, Settings, Stopwatch, peak_bytes

from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World
from grasp_factory.simulation.world.engine import p as pybullet

RENDER, STEP = "getCameraImage", "stepSimulation"


@dataclass(slots=True)
class Tape:
    """Calls of one episode, and what the pictures were."""

    calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = field(default_factory=list)
    pictures: list[str] = field(default_factory=list)

    def recording(self, name: str, call: Call) -> Call:
        """Return a call that is also put on the tape, unless it only reads."""
        if name.startswith("get") and name != RENDER:
            return call

        def recorded(*args: Any, **kwargs: Any) -> Any:
            self.calls.append((name, args, kwargs))
            result = call(*args, **kwargs)
            if name == RENDER:
                self.pictures.append(_digest(result))
            return result

        return recorded

    def clear(self) -> None:
        """Forget the episode."""
        self.calls.clear()
        self.pictures.clear()


def measure(settings: Settings) -> Score:
    """Record and play each episode in turn; only the playing counts."""
    seconds, tape = dict.fromkeys((STEP, RENDER), 0.0), Tape()
    with watched_engine(tape.recording), World() as world, Stopwatch() as watch:
        for index in range(WARM_UP_EPISODES):
            run_episode(world, sample_spec(config_of(settings, seed=WARM_UP_SEED), index))
        for index in range(settings.episodes):
            tape.clear()
            run_episode(world, sample_spec(config_of(settings), index))
            pictures = _play(tape, seconds)
            if pictures != tape.pictures:
                raise RuntimeError(f"episode {index}: its tape gives other pictures than it did")
    return Score(
        episodes=settings.episodes,
        seconds=sum(seconds.values()),
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(),
        details=seconds,
    )


def _play(tape: Tape, seconds: dict[str, float]) -> list[str]:
    """Play a tape, add the seconds of its steps and renders and return what the pictures are."""
    pictures = []
    for name, args, kwargs in tape.calls:
        call = getattr(pybullet, name)
        if name not in seconds:
            call(*args, **kwargs)
            continue
        start = time.perf_counter()
        result = call(*args, **kwargs)
        seconds[name] += time.perf_counter() - start
        if name == RENDER:
            pictures.append(_digest(result))
    return pictures


def _digest(picture: tuple[Any, ...]) -> str:
    return hashlib.sha256(b"".join(plane.tobytes() for plane in picture[2:])).hexdigest()
