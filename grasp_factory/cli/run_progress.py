"""The progress of a run on stderr and on the live page."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from grasp_factory.cli.printing import say
from grasp_factory.cli.run_report import plan_text
from grasp_factory.core.executors import ProcessExecutor
from grasp_factory.core.progress import Progress, write_line
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError
from grasp_factory.factory import dry_run
from grasp_factory.factory.block_job import Made
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_bar import RunBar
from grasp_factory.factory.run_records import RunPlan, Summary
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.zarr.store import missing_rows

if TYPE_CHECKING:
    from grasp_factory.apps.live import LiveView

READ_S = 10.0
"""Longest time that a stopped run takes to count its episodes, seconds."""


def stopped_text(path: Path, made: Collection[int] = ()) -> str:
    """Return one line that says what a stopped run made and how to continue it.

    The store is read in a thread with a time limit. If the signal came while Zarr started its own
    thread, reading would block for ever.

    Args:
        path: the store.
        made: the episodes that the run simulated.
    """
    found = ["committed episodes stay"]

    def read() -> None:
        try:
            store = Dataset(path)
            lost = len(set(made) & set(missing_rows(path).tolist()))
            rest = f", {lost} of unfinished blocks {'is' if lost == 1 else 'are'} discarded"
            found[0] = f"{len(store.committed)} episodes are in {path}{rest if lost else ''}"
        except (GraspFactoryError, OSError):
            found[0] = "no episode is made yet"

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    reader.join(READ_S)
    return f"Stopped: {found[0]}; run the same command again to continue."


class RunProgress:
    """Prints the plan of a run and its events, and shows how many episodes are made."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._bar: RunBar | None = None
        self.made: set[int] = set()
        """Episodes that were simulated; a stop loses those of unfinished blocks."""

    def start(self, plan: RunPlan) -> None:
        """Print the plan."""
        if self._quiet:
            return
        say(plan_text(plan), err=True)
        if plan.blocks:
            self._bar = RunBar(plan.to_make)

    def episode(self, made: Made) -> None:
        """Count an episode; print the reason of a quarantine."""
        self.made.add(made.index)
        if made.outcome == "quarantined" and not self._quiet:
            write_line(f"episode {made.index} is quarantined: {made.reason}")
        if self._bar is not None:
            self._bar.episode(made)

    def loss(self, text: str) -> None:
        """Print that a worker was lost, or what has become of a node."""
        if not self._quiet:
            write_line(text)

    def __enter__(self) -> RunProgress:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def make(request: Request, progress: RunProgress, view: LiveView | None = None) -> Summary:
    """Run a request and show its progress, also on the live page if there is a view.

    See ``factory.generate``.
    """
    with progress, view or contextlib.nullcontext():
        followers: list[RunProgress | LiveView] = [progress] if view is None else [progress, view]

        def start(plan: RunPlan) -> None:
            for follower in followers:
                follower.start(plan)

        def episode(made: Made) -> None:
            for follower in followers:
                follower.episode(made)

        def loss(text: str) -> None:
            for follower in followers:
                follower.loss(text)

        return generate(
            request.config,
            request.n,
            request.out,
            request.workers,
            executor=request.executor,
            shard=request.shard,
            episode_timeout=request.episode_timeout,
            max_failures=request.max_failures,
            retry_quarantined=request.retry_quarantined,
            accept_other_platform=request.accept_other_platform,
            progress=False,
            on_start=start,
            on_episode=episode,
            on_loss=loss,
            on_node=progress.loss,
        )


def live_view(port: int | None, *, quiet: bool) -> LiveView:
    """Return a live view whose messages do not break the bar; see ``apps.live.LiveView``.

    Args:
        port: port of the page; None for the default, or the next free one.
        quiet: print nothing but the address.
    """
    from grasp_factory.apps.live import LiveView  # noqa: PLC0415 - of the [browse] extra

    return LiveView(port, tell=(lambda text: None) if quiet else write_line, announce=write_line)


def forecast(request: Request) -> dry_run.Forecast:
    """Return the forecast of a request and show a bar; see ``factory.dry_run.forecast``."""
    with Progress(request.n, "pilot") as progress:
        executor = ProcessExecutor(request.workers)
        return dry_run.forecast(request, lambda made: progress.count(), executor)
