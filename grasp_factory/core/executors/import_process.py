"""Reading what a stranger made, a bag or an export, in a worker process with limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

from grasp_factory.core.disk_usage import stored_bytes
from grasp_factory.core.executors.base import Executor, SendMessage, Task
from grasp_factory.core.executors.limited import LimitedExecutor, ProcessLimits
from grasp_factory.core.limits import IMPORT_CPU, IMPORT_FILE, IMPORT_MEMORY
from grasp_factory.errors import StoreError

LEAST_S = 5
"""Processor time for the smallest file, s."""
BYTES_PER_S = 100_000
"""Bytes on the disk for another second: a tenth of what the slowest import reads."""
IMPORT = ProcessLimits(what="the import", memory=IMPORT_MEMORY, cpu=IMPORT_CPU, file=IMPORT_FILE)


def reading_executor(limits: ProcessLimits = IMPORT) -> Executor:
    """Return the executor of imports."""
    return LimitedExecutor(1, limits)


def in_import_process(
    task: Task[Any, Any],
    job: Any,
    source: Path,
    report: SendMessage = lambda message: None,
    limits: ProcessLimits = IMPORT,
) -> Any:
    """Return the result of a task that a process with limits does.

    Args:
        task: the function to run.
        job: its job.
        source: what it reads, for messages.
        report: called with each message of the task.
        limits: of the process.

    Raises:
        StoreError: if the process ends, for example because a decoder fails.
        LimitError: if it needs more memory or time. An exception of the task is raised as it is.
    """

    def lost(_: Any, why: str) -> NoReturn:
        raise StoreError(f"{source}: reading it ended its process ({why})")

    executor = reading_executor(_limits_for(source, limits))
    (result,) = executor.run(task, [job], report, lost)
    return result


def _limits_for(source: Path, limits: ProcessLimits) -> ProcessLimits:
    """Return limits whose time follows the size of what is read, up to theirs."""
    most = LEAST_S + stored_bytes(source) // BYTES_PER_S
    cpu = replace(limits.cpu, usual=min(limits.cpu.usual, most))
    return replace(limits, cpu=cpu)
