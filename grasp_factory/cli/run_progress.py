"""What a person sees on stderr while a dataset is made."""

from __future__ import annotations

import contextlib
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import click
from tqdm import tqdm  # type: ignore[import-untyped]

from grasp_factory.cli.progress import Counter
from grasp_factory.cli.run_report import plan_text
from grasp_factory.core.text_format import percent
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError
from grasp_factory.factory import dry_run
from grasp_factory.factory.block_job import Made
from grasp_factory.factory.executors import ProcessExecutor
from grasp_factory.factory.generate import RunPlan, Summary, generate
from grasp_factory.factory.run_request import Request

if TYPE_CHECKING:
    from grasp_factory.apps.live import LiveView

_BAR = "{percentage:3.0f} % |{bar}| {n}/{total} [{elapsed}, {remaining} left, {rate_fmt}{postfix}]"
READ_S = 10.0
"""Seconds that a stopped run takes at most to count what is there."""


def stopped_text(path: Path) -> str:
    """Return one line on a run that was stopped, and how to go on.

    The store is read in a thread that is given up after a while: the signal may have come as Zarr
    started its own thread, and whoever reads would then wait for ever.
    """
    made = ["what was committed is there"]

    def read() -> None:
        try:
            made[0] = f"{len(Dataset.open(path).committed)} episodes are in {path}"
        except (GraspFactoryError, OSError):
            made[0] = "nothing is made yet"

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    reader.join(READ_S)
    return f"Stopped: {made[0]}; run the same command again to go on."


class RunProgress:
    """Says what will be done, then shows a bar; the bar only where stderr is a terminal."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._bar: tqdm | None = None
        self._made = self._successes = 0

    def start(self, plan: RunPlan) -> None:
        """Say what the run is about to do."""
        if self._quiet:
            return
        click.echo(plan_text(plan), err=True)
        if plan.blocks and sys.stderr.isatty():
            self._bar = tqdm(total=plan.to_make, bar_format=_BAR, unit="ep", dynamic_ncols=True)

    def episode(self, made: Made) -> None:
        """Count an episode."""
        if made.outcome == "quarantined" and not self._quiet:
            tqdm.write(f"episode {made.index} is quarantined: {made.reason}", file=sys.stderr)
        self._made += made.outcome != "quarantined"
        self._successes += made.outcome == "success"
        if self._bar is not None:
            rate = self._successes / self._made if self._made else None
            self._bar.set_postfix_str(f"success {percent(rate)}", refresh=False)
            self._bar.update()

    def loss(self, text: str) -> None:
        """Tell that a worker was lost."""
        if not self._quiet:
            tqdm.write(text, file=sys.stderr)

    def __enter__(self) -> RunProgress:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()


def make(request: Request, *, quiet: bool, view: LiveView | None = None) -> Summary:
    """Run a request with its progress shown, in a live view as well if there is one.

    See ``factory.generate``.
    """
    with RunProgress(quiet=quiet) as progress, view or contextlib.nullcontext():
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
            shard=request.shard,
            episode_timeout=request.episode_timeout,
            max_failures=request.max_failures,
            retry_quarantined=request.retry_quarantined,
            accept_other_platform=request.accept_other_platform,
            on_start=start,
            on_episode=episode,
            on_loss=loss,
        )


def live_view(port: int | None, *, quiet: bool) -> LiveView:
    """Return a live view that tells of itself between the lines of the bar; see ``live.LiveView``.

    Args:
        port: where to listen; None for the default, or the next one that is free.
        quiet: tell of nothing but where it is.
    """
    from grasp_factory.apps.live import LiveView  # noqa: PLC0415 - of the [browse] extra

    return LiveView(port, tell=(lambda text: None) if quiet else _write, announce=_write)


def _write(text: str) -> None:
    tqdm.write(text, file=sys.stderr)


def forecast(request: Request) -> dry_run.Forecast:
    """Tell what a request would take, with the pilots counted; see ``dryrun.forecast``."""
    with Counter(request.n, "pilot") as counter:
        executor = ProcessExecutor(request.workers)
        return dry_run.forecast(request, lambda made: counter.count(), executor)
