"""What a task reports, as a stream: a reader of a file in a process with limits, or a camera."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any

from grasp_factory.core.executors import import_process
from grasp_factory.core.executors.base import SendMessage, Task
from grasp_factory.errors import CaptureError, GraspFactoryError

_POLL_S = 0.05
_MOST_WAITING = 8
"""Items that wait to be taken; then the task waits."""
_END = object()


class _LeftError(Exception):
    """Nobody takes what the task reports any more."""


class TaskStream:
    """Runs a task in a thread and yields what it reports.

    Args:
        run: runs the task; it gets the function that the task shall report to.
    """

    def __init__(self, run: Callable[[SendMessage], object]) -> None:
        self._run = run
        self._items: queue.Queue[Any] = queue.Queue(_MOST_WAITING)
        self._left = Event()
        self._thread = Thread(target=self._work, daemon=True)
        self._thread.start()

    def first(self, timeout_s: float) -> Any:
        """Return the first item; None if the task ends, or takes longer, without one.

        Raises:
            CaptureError: if the task fails.
        """
        try:
            item = self._items.get(timeout=timeout_s)
        except queue.Empty:
            return None
        return None if item is _END else _checked(item)

    def items(self, stopped: Event) -> Iterator[Any]:
        """Yield what the task reports, until it ends or ``stopped`` is set.

        Raises:
            CaptureError: if the task fails.
        """
        while not stopped.is_set():
            try:
                item = self._items.get(timeout=_POLL_S)
            except queue.Empty:
                continue
            if item is _END:
                return
            yield _checked(item)

    def close(self, timeout_s: float | None = None) -> None:
        """Let the task end at its next report, and wait for it."""
        self._left.set()
        self._thread.join(timeout_s)

    def _work(self) -> None:
        try:
            self._run(self._put)
            self._put(_END)
        except _LeftError:
            pass
        except GraspFactoryError as error:
            self._put_last(error if isinstance(error, CaptureError) else CaptureError(str(error)))
        except Exception as error:
            self._put_last(CaptureError(f"reading failed: {type(error).__name__}: {error}"))

    def _put_last(self, item: object) -> None:
        try:
            self._put(item)
        except _LeftError:
            pass

    def _put(self, item: object) -> None:
        while not self._left.is_set():
            try:
                self._items.put(item, timeout=_POLL_S)
            except queue.Full:
                continue
            return
        raise _LeftError


def _checked(item: Any) -> Any:
    """Return an item; raise it if it is the error that ended the task."""
    if isinstance(item, CaptureError):
        raise item
    return item


def limited_stream(task: Task[Any, Any], job: Any, source: Path) -> TaskStream:
    """Return what a task reports that reads a file of anybody, in a process with limits."""
    return TaskStream(lambda report: import_process.in_import_process(task, job, source, report))
