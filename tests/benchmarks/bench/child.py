"""Runs one contestant in this process and writes its score to stdout."""

from __future__ import annotations

import dataclasses
import json
import sys
from importlib import import_module
from pathlib import Path

from benchmarks.bench.score import NotAvailable, Settings

import grasp_factory.simulation.world.engine  # noqa: F401  imports PyBullet without its greeting


def main(function: str, settings: str, result: str) -> None:
    """Call ``module:function`` with the settings, and leave its score as JSON.

    A file and not stdout, because PyBullet prints there as it likes.
    """
    module, _, name = function.partition(":")
    try:
        score = getattr(import_module(module), name)(Settings(**json.loads(settings)))
        answer = dataclasses.asdict(score)
    except NotAvailable as why:
        answer = {"not_available": str(why)}
    Path(result).write_text(json.dumps(answer), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
