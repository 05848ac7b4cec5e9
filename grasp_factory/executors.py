"""Where blocks run: in this process, or in worker processes that each own whole blocks.

The process pool is our own because ``concurrent.futures.ProcessPoolExecutor`` hangs on Python 3.11
when it recycles workers (https://github.com/python/cpython/issues/115634). Here every worker has
one pipe and at most one block; no shared queue, no helper thread, so no lock can be left behind by
a worker that dies, and its end of the pipe tells at once.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

from grasp_factory.errors import WorkerError

R = TypeVar("R")
Report = Callable[[Any], None]
Task = Callable[[int, Report], R]
"""``task(block, report)`` makes a block; it may call ``report(message)`` while it does."""

BLOCKS_PER_PROCESS = 32
"""A worker is replaced after so many blocks: PyBullet's memory grows slowly over resets."""

ONE_THREAD = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLOSC_NTHREADS",
        "OPENCV_FOR_THREADS_NUM",
    )
}
"""Set in workers: they share the cores among themselves already."""

_SPAWN = multiprocessing.get_context("spawn")


class Executor(ABC):
    """Runs a task on blocks. To add one, implement ``run``."""

    @abstractmethod
    def run(self, task: Task[R], blocks: Sequence[int], report: Report) -> list[R]:
        """Run ``task`` once on each block and return the results in the order of ``blocks``.

        Each message of a task reaches ``report`` in this process, in the task's order. When the
        call ends, by whatever way, nothing of it runs any more.

        Raises:
            WorkerError: if a worker process died. An exception of the task is raised as it is.
        """


class InlineExecutor(Executor):
    """One block after the other, in this process."""

    def run(self, task: Task[R], blocks: Sequence[int], report: Report) -> list[R]:
        """See ``Executor.run``."""
        return [task(block, report) for block in blocks]


@dataclass(frozen=True, slots=True)
class ProcessExecutor(Executor):
    """Spawned processes; the task, its messages and its results must be picklable."""

    workers: int
    blocks_per_process: int = BLOCKS_PER_PROCESS

    def run(self, task: Task[R], blocks: Sequence[int], report: Report) -> list[R]:
        """See ``Executor.run``."""
        todo, results = list(reversed(blocks)), dict[int, R]()
        team: dict[Any, _Worker] = {}
        try:
            for _ in range(min(self.workers, len(todo))):
                _hire(team, task, todo.pop())
            while team:
                for pipe in connection.wait(list(team)):
                    worker = team[pipe]
                    kind, value = worker.receive()
                    if kind == "message":
                        report(value)
                        continue
                    if kind == "error":
                        raise value
                    results[worker.block] = value
                    worker.done += 1
                    if todo and worker.done < self.blocks_per_process:
                        worker.give(todo.pop())
                        continue
                    del team[pipe]
                    worker.stop()
                    if todo:
                        _hire(team, task, todo.pop())
        finally:
            for worker in team.values():
                worker.process.terminate()
            for worker in team.values():
                worker.stop()
        return [results[block] for block in blocks]


def make_executor(workers: int) -> Executor:
    """Return the executor for a number of workers; one worker needs no pool."""
    return InlineExecutor() if workers == 1 else ProcessExecutor(workers)


@dataclass(slots=True)
class _Worker:
    process: SpawnProcess
    pipe: connection.Connection[Any, Any]
    block: int
    done: int = 0
    """Blocks that it has finished."""
    heard: bool = False
    """It has sent something, so it had started well."""

    def give(self, block: int) -> None:
        self.block = block
        with contextlib.suppress(OSError):  # it died: the next receive says so
            self.pipe.send(block)

    def receive(self) -> tuple[str, Any]:
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(timeout=5.0)  # it may still be on its way out
            self.stop()
            raise WorkerError(
                f"a worker died in block {self.block} ({self._cause()}){self._hint()}; the blocks"
                " that are committed stay: run the same command again to go on"
            ) from None
        self.heard = True
        return kind, value

    def stop(self) -> None:
        """End the process: between blocks there is nothing to lose, within one it is redone."""
        self.process.terminate()
        self.process.join(timeout=3.0)  # time to tidy its temporary files
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def _hint(self) -> str:
        if self.heard or self.process.exitcode != 1:
            return ""
        return (
            " before it began: a script that calls generate() with several workers does so under"
            ' `if __name__ == "__main__":`'
        )

    def _cause(self) -> str:
        code = self.process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def _hire(team: dict[Any, _Worker], task: Task[Any], block: int) -> None:
    """Start a worker on its first block and add it to the team."""
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=_serve, args=(task, theirs), daemon=True)
    resource_tracker.ensure_running()  # its own start would undo the signal mask
    with _environment(ONE_THREAD), _no_interrupt():
        process.start()
        team[ours] = _Worker(process, ours, block)
    theirs.close()
    team[ours].give(block)


def _serve(task: Task[Any], pipe: connection.Connection[Any, Any]) -> None:
    """Make blocks until the pipe closes. Runs in the worker."""
    signal.signal(signal.SIGTERM, _leave)
    os.dup2(2, 1)  # PyBullet prints warnings on stdout, which belongs to the command's result
    threading.Thread(target=_die_with_parent, daemon=True).start()

    def report(message: Any) -> None:
        pipe.send(("message", message))

    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            block = pipe.recv()
            try:
                pipe.send(("result", task(block, report)))
            except Exception as error:
                pipe.send(("error", _portable(error)))
                return


def _leave(*_: Any) -> None:
    # A second one would cut the tidying short. Not SIG_IGN: Python complains of one on its way.
    signal.signal(signal.SIGTERM, lambda *_: None)
    code = 128 + signal.SIGTERM
    # Where this interrupts a finaliser, the exit would only be printed, and the worker go on.
    sys.unraisablehook = lambda _: os._exit(code)
    sys.exit(code)


def _die_with_parent() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})  # it is for the main thread
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _portable(error: Exception) -> Exception:
    """Return the error, with its traceback as a note, in a form that survives pickling."""
    text = "".join(traceback.format_exception(error))
    error.add_note(f"\nIn a worker process:\n{text}")
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"a worker failed\n{text}")
    return error


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables for a while; a child started meanwhile inherits them."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _no_interrupt() -> Iterator[None]:
    """Hold SIGINT back for a while; a child started meanwhile never sees Ctrl-C."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
