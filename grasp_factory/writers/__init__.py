"""Write episodes: the Zarr store, memory, and exporters to other formats.

A new writer is one file and one row in ``WRITERS``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from grasp_factory.writers.base import Writer
from grasp_factory.writers.memory import MemoryWriter
from grasp_factory.writers.zarr.writer import ZarrWriter

WRITERS: dict[str, Callable[[Path], Writer]] = {
    "zarr": ZarrWriter,
    "memory": MemoryWriter,
}
"""Functions that open a writer on a path, by the writer's name."""
