"""Reading what a stranger made, a bag or an export, in a worker process with limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NoReturn

from grasp_factory.core.executors.base import Executor, SendMessage, Task
from grasp_factory.core.executors.limited import LimitedExecutor, ProcessLimits
from grasp_factory.core.limits import IMPORT_CPU, IMPORT_FILE, IMPORT_MEMORY
from grasp_factory.errors import StoreError

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

    (result,) = reading_executor(limits).run(task, [job], report, lost)
    return result
