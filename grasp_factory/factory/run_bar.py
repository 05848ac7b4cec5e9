"""The progress of a run: its episodes, and the share that succeeds."""

from __future__ import annotations

from grasp_factory.core.progress import Progress
from grasp_factory.core.text_format import percent
from grasp_factory.factory.block_job import Made

_BAR = "{percentage:3.0f} % |{bar}| {n}/{total} [{elapsed}, {remaining} left, {rate_fmt}{postfix}]"


class RunBar(Progress):
    """Shows the episodes of a run as they are made."""

    def __init__(self, to_make: int) -> None:
        """Begin a run that makes so many episodes."""
        super().__init__(to_make, "episode", bar_format=_BAR, leave=True)
        self._made = self._successes = 0

    def episode(self, made: Made) -> None:
        """Count an episode."""
        self._made += made.outcome != "quarantined"
        self._successes += made.outcome == "success"
        self.count(f"success {percent(self._successes / self._made if self._made else None)}")
