"""Whether a worker's memory stays flat: many episodes in one process, which is never replaced."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from benchmarks.bench.factory import config_of
from benchmarks.bench.score import Score, Settings, Stopwatch, peak_bytes

from grasp_factory import generate
from grasp_factory.factory.block_job import Made

EVERY = 100


def measure(settings: Settings) -> Score:
    """Make and write all episodes here; ``details`` are resident bytes by episodes made."""
    resident: dict[str, float] = {}

    def look(made: Made) -> None:
        count = made.index + 1
        if count % EVERY == 0 or count == settings.episodes:
            resident[str(count)] = resident_bytes()

    with tempfile.TemporaryDirectory() as place, Stopwatch() as watch:
        out = Path(place, "ds.zarr")
        generate(config_of(settings), settings.episodes, out, workers=1, on_episode=look)
    return Score(
        episodes=settings.episodes,
        seconds=watch.seconds,
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(),
        details=resident,
    )


def resident_bytes() -> int:
    """Return the memory that this process holds now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
