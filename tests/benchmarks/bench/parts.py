"""Where an episode's time goes: a run of its own, with a clock around each part.

The clocks cost a few microseconds each, so this run's total is not the one that is compared.
"""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.bench.engine import Call, watched_engine
from benchmarks.bench.factory import WARM_UP_SEED, config_of
from benchmarks.bench.score import WARM_UP_EPISODES, Score, Settings, Stopwatch, peak_bytes

from grasp_factory.factory import block_maker, generate
from grasp_factory.simulation import grasp_execution, rollout
from grasp_factory.writers.zarr import block_attempt, writer

PARTS: Mapping[str, tuple[tuple[Any, str], ...]] = {
    "sample": ((block_maker, "sample_spec"),),
    "reset, build": ((rollout, "build_scene"),),
    "settle": ((rollout, "settle"),),
    "plan": ((rollout, "_plan"), (rollout, "choose")),
    "simulate": ((grasp_execution.Attempt, "run"),),
    "render": ((rollout, "take_shots"),),
    "inspect": ((rollout, "inspect_episode"),),
    "label, streams": ((block_maker, "run_episode"),),
    "encode": ((writer.ZarrWriter, "write_block"),),
    "write (fsync)": ((block_attempt, "fsync_places"),),
    "open, close, count": ((generate, "generate"),),
}
"""By name: the functions whose own time it is, without that of the parts they call."""

ENGINE = ("stepSimulation", "getCameraImage")
"""Timed inside the parts as well."""


class Clocks:
    """Seconds by part, each without the parts inside it; the engine's by the part they are in."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._threads = threading.local()

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Let the time of a block count for a part."""
        inside = self._threads.__dict__.setdefault("inside", [])
        inside.append(0.0)
        start = time.perf_counter()
        try:
            yield
        finally:
            whole = time.perf_counter() - start
            self.seconds[name] += whole - inside.pop()
            if inside:
                inside[-1] += whole

    def around(self, owner: Any, function: str, name: str) -> None:
        """Let the time of a function count for a part from now on."""
        inner = getattr(owner, function)

        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.part(name):
                return inner(*args, **kwargs)

        setattr(owner, function, timed)

    def engine_call(self, name: str, call: Call) -> Call:
        """Return a call whose time also counts for itself."""
        if name not in ENGINE:
            return call

        def timed(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            result = call(*args, **kwargs)
            self.seconds[name] += time.perf_counter() - start
            return result

        return timed


def measure(settings: Settings) -> Score:
    """Run the factory with one worker; ``details`` are seconds by part."""
    clocks = Clocks()
    with tempfile.TemporaryDirectory() as place, watched_engine(clocks.engine_call):
        for name, functions in PARTS.items():
            for owner, function in functions:
                clocks.around(owner, function, name)
        warm = config_of(settings, seed=WARM_UP_SEED)
        generate.generate(warm, WARM_UP_EPISODES, Path(place, "warm.zarr"), workers=1)
        clocks.seconds.clear()
        with Stopwatch() as watch:
            generate.generate(
                config_of(settings), settings.episodes, Path(place, "ds.zarr"), workers=1
            )
    return Score(
        episodes=settings.episodes,
        seconds=watch.seconds,
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(),
        details=dict(clocks.seconds),
    )
