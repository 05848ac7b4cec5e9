"""``bin/faults``: seed faults one at a time, print what the tests caught, keep it as JSON."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from support.places import REPOSITORY

from faults.running import Result, Verdict, Width, failing_anyway, try_fault
from faults.table import FAULTS


def main() -> None:
    """Try the faults that are asked for; exit with 1 unless each of them is caught."""
    asked = _arguments()
    faults = [fault for fault in FAULTS if not asked.only or fault.name in asked.only]
    results = _read(asked.json) if asked.json else {}

    def keep(result: Result) -> None:
        print(line(result), flush=True)
        results[result.name] = dataclasses.asdict(result)
        if asked.json:
            _write(asked.json, results)

    with ThreadPoolExecutor(asked.jobs) as pool:
        tried = []
        for result in pool.map(
            lambda fault: try_fault(fault, REPOSITORY, Width(asked.tests), asked.marker), faults
        ):
            tried.append(result)
            keep(result)
    caught = [result for result in tried if result.verdict is Verdict.CAUGHT]
    anyway = failing_anyway((result.test for result in caught), REPOSITORY)
    for result in caught:
        if result.test in anyway:
            keep(dataclasses.replace(result, verdict=Verdict.UNSOUND))
    found = [results[fault.name]["verdict"] for fault in faults]
    print(summary(found))
    sys.exit(0 if set(found) <= {Verdict.CAUGHT} else 1)


def line(result: Result) -> str:
    """Return a row of the table."""
    return (
        f"{result.name:40} {result.verdict:10} {result.width:6} {result.seconds:7.1f} s"
        f"  {result.test}"
    )


def summary(verdicts: Iterable[str]) -> str:
    """Return how many faults there are of each verdict."""
    counts = Counter(verdicts)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict])


def _read(file: Path) -> dict[str, dict[str, Any]]:
    if not file.exists():
        return {}
    results: list[dict[str, Any]] = json.loads(file.read_bytes())["faults"]
    return {result["name"]: result for result in results}


def _write(file: Path, results: dict[str, dict[str, Any]]) -> None:
    order = [fault.name for fault in FAULTS if fault.name in results]
    found = [results[name] for name in order]
    plain = {"summary": Counter(one["verdict"] for one in found), "faults": found}
    file.write_text(json.dumps(plain, indent=2) + "\n", encoding="utf-8")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="faults", description=__doc__)
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", choices=[fault.name for fault in FAULTS]
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="faults at a time")
    parser.add_argument(
        "--tests",
        choices=list(Width),
        default=Width.NAMED,
        help="how far to go on with a fault that is not caught: the tests that the table names,"
        " those of its room, or all",
    )
    parser.add_argument(
        "--marker", default="not soak", help="expression of pytest's -m: which tests may catch"
    )
    parser.add_argument("--json", type=Path, help="file to keep results in, those of before too")
    return parser.parse_args()


if __name__ == "__main__":
    main()
