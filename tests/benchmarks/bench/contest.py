"""Contestants take turns, each turn in a fresh process: what slows the machine slows them all."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.bench.score import NotAvailable, Score, Settings

CONTESTANTS: Mapping[str, str] = {
    "article": "benchmarks.bench.article:measure",
    "factory": "benchmarks.bench.factory:measure_one",
    "floor": "benchmarks.bench.floor:measure",
    "fast": "benchmarks.bench.factory:measure_fast",
    "two": "benchmarks.bench.factory:measure_two",
    "kuka": "benchmarks.bench.kuka_env:measure",
}
"""In the order of their turns; those that are compared with each other are neighbours."""

Scores = dict[str, list[Score]]


def hold(
    names: Iterable[str], settings: Settings, rounds: int, say: Callable[[str], None]
) -> tuple[Scores, dict[str, str]]:
    """Let the named contestants take ``rounds`` turns.

    Returns:
        Their scores, one each round, and for those that are not available the reason.
    """
    scores: Scores = {name: [] for name in names}
    absent: dict[str, str] = {}
    for turn in range(rounds):
        for name in [name for name in scores if name not in absent]:
            try:
                score = Score(**in_fresh_process(CONTESTANTS[name], settings))
            except NotAvailable as why:
                absent[name] = str(why)
                continue
            scores[name].append(score)
            say(f"round {turn + 1} of {rounds}: {name} {score.rate:.2f} episodes/s")
    return {name: found for name, found in scores.items() if name not in absent}, absent


def in_fresh_process(function: str, settings: Settings) -> dict[str, Any]:
    """Call ``module:function`` in an interpreter of its own and return what it answers.

    Raises:
        NotAvailable: if it says so.
        subprocess.CalledProcessError: if it fails.
    """
    here = str(Path(__file__).parents[2])
    search = os.pathsep.join(filter(None, [here, os.environ.get("PYTHONPATH", "")]))
    with tempfile.TemporaryDirectory() as place:
        result = Path(place, "score.json")
        wanted = json.dumps(dataclasses.asdict(settings))
        command = [sys.executable, "-m", "benchmarks.bench.child", function, wanted, str(result)]
        environment = os.environ | {"PYTHONPATH": search}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        answer: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
    if "not_available" in answer:
        raise NotAvailable(answer["not_available"])
    return answer
