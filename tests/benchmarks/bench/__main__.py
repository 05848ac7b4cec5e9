"""``bin/bench``: side by side in one run, one table, and JSON for who wants to reckon further."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.bench.contest import CONTESTANTS, hold, in_fresh_process
from benchmarks.bench.figures import (
    Figure,
    contest_figures,
    memory_figures,
    part_figures,
    reader_figures,
    table_text,
)
from benchmarks.bench.score import Score, Settings

from grasp_factory.errors import ConfigError
from grasp_factory.factory.run_request import parse_size

ALONE: dict[str, tuple[str, Callable[[Score], list[Figure]]]] = {
    "parts": ("benchmarks.bench.parts:measure", part_figures),
    "reader": ("benchmarks.bench.reader:measure", reader_figures),
    "memory": ("benchmarks.bench.memory:measure", memory_figures),
}
"""What is measured once, with nothing to take turns with."""

USUAL = (*CONTESTANTS, "parts", "reader")


def main() -> None:
    """Measure what is asked for and print it."""
    asked = _arguments()
    names = asked.only or USUAL
    if asked.json and not asked.json.absolute().parent.is_dir():
        sys.exit(f"--json: there is no directory {asked.json.absolute().parent}")
    width, height = asked.resolution
    settings = Settings(episodes=asked.episodes, width=width, height=height)
    contestants = [name for name in names if name in CONTESTANTS]
    scores, absent = hold(contestants, settings, asked.rounds, _say)
    figures = contest_figures(scores)
    for name in [name for name in names if name in ALONE]:
        function, figures_of = ALONE[name]
        _say(name)
        score = Score(**in_fresh_process(function, settings))
        scores[name] = [score]
        figures += figures_of(score)
    print(table_text(figures))
    for name, why in absent.items():
        print(f"{name}: not available ({why})")
    if asked.json:
        record = _record(settings, asked.rounds, figures, scores, absent)
        asked.json.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def _arguments() -> argparse.Namespace:
    valid = (*CONTESTANTS, *ALONE)
    parser = argparse.ArgumentParser(prog="bin/bench", description=__doc__)
    parser.add_argument("--episodes", type=_positive, default=96, help="of every contestant")
    parser.add_argument("--rounds", type=_positive, default=3, help="turns of each")
    parser.add_argument("--resolution", type=_size, default=[640, 480], metavar="WxH")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all figures and all scores")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=valid,
        help=f"of {', '.join(valid)}; all but memory if not given",
    )
    return parser.parse_args()


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"got {number}, valid: 1 or more")
    return number


def _size(text: str) -> list[int]:
    try:
        return parse_size(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _record(
    settings: Settings,
    rounds: int,
    figures: Sequence[Figure],
    scores: dict[str, list[Score]],
    absent: dict[str, str],
) -> dict[str, Any]:
    return {
        **dataclasses.asdict(settings),
        "rounds": rounds,
        "figures": [
            {"name": f.name, "value": f.value, "unit": f.unit, "bound": f.bound,
             "verdict": f.verdict}
            for f in figures
        ],
        "scores": {name: [dataclasses.asdict(s) for s in found] for name, found in scores.items()},
        "not_available": absent,
    }  # fmt: skip


if __name__ == "__main__":
    main()
