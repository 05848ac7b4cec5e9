"""The worker's side of the pool: take jobs from a pipe, report results, end cleanly."""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from importlib import import_module
from multiprocessing import connection
from typing import Any

from grasp_factory.core.executors.base import Task
from grasp_factory.core.plugins.plugin_sources import PluginSource, allow
from grasp_factory.core.process_end import end_with_parent, ignore_unstarted_coroutines


def serve(
    pipe: connection.Connection[Any, Any],
    sources: Sequence[PluginSource] = (),
    imports: Sequence[str] = (),
) -> None:
    """Do jobs until the pipe closes. Runs in the worker.

    Args:
        pipe: where first the task and then jobs come from, and results go to.
        sources: files of the user that it may run.
        imports: modules to import before the task comes.
    """
    end_with_parent()
    os.environ.pop("PYTHONSAFEPATH", None)  # it was for the start alone, not for users' programs
    allow(sources)
    signal.signal(signal.SIGTERM, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # blocked while it started
    os.dup2(2, 1)  # PyBullet prints warnings on stdout, which belongs to the command's result
    if isinstance(sys.stdout, io.TextIOWrapper):  # what users' code prints is seen at once
        sys.stdout.reconfigure(line_buffering=True)
    threading.Thread(target=_die_with_parent, daemon=True).start()

    def report(message: Any) -> None:
        pipe.send(("message", message))

    for name in imports:
        import_module(name)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        task: Task[Any, Any] = pipe.recv()
        while True:
            job = pipe.recv()
            try:
                pipe.send(("result", task(job, report)))
            except MemoryError:  # the kernel would kill it a little later
                os.kill(os.getpid(), signal.SIGKILL)
            except Exception as error:
                pipe.send(("error", _portable(error)))
                return


def _leave(*_: Any) -> None:
    ignore_unstarted_coroutines()
    # A second signal would interrupt the cleanup. Not SIG_IGN: Python reports a pending one.
    signal.signal(signal.SIGTERM, lambda *_: None)
    code = 128 + signal.SIGTERM
    # In a finaliser the exit would only be printed, and the worker would continue.
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
