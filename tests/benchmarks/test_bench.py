"""``bin/bench`` in small: what it says is there, and its bounds are bounds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.bench.contest import CONTESTANTS
from benchmarks.bench.figures import Bounds, Figure, contest_figures, table_text
from benchmarks.bench.parts import ENGINE
from benchmarks.bench.score import Score
from support.places import TESTS


def score(episodes: int = 10, seconds: float = 1.0, stored_bytes: int = 1) -> Score:
    return Score(
        episodes=episodes,
        seconds=seconds,
        cpu_seconds=seconds,
        peak_bytes=0,
        stored_bytes=stored_bytes,
    )


def values(figures: list[Figure]) -> dict[str, float]:
    return {figure.name: figure.value for figure in figures}


class TestFigures:
    def test_a_ratio_is_the_median_of_those_within_a_round(self) -> None:
        article = [score(seconds=1.0), score(seconds=2.0), score(seconds=9.0)]
        factory = [score(seconds=0.5), score(seconds=1.0), score(seconds=9.0)]
        found = values(contest_figures({"article": article, "factory": factory}))
        assert found["factory / article: episodes/s"] == 2.0

    def test_a_ratio_needs_both_sides(self) -> None:
        found = values(contest_figures({"factory": [score()]}))
        assert [name for name in found if " / " in name] == []

    def test_the_floor_is_compared_by_seconds_and_the_files_by_bytes(self) -> None:
        scores = {
            "article": [score(stored_bytes=600)],
            "factory": [score(seconds=1.2, stored_bytes=60)],
            "floor": [score(seconds=1.0)],
        }
        found = values(contest_figures(scores))
        assert found["factory / floor: seconds"] == pytest.approx(1.2)
        assert found["factory / article: bytes an episode"] == pytest.approx(0.1)

    @pytest.mark.parametrize(
        ("value", "bounds", "verdict"),
        [
            (1.0, {"at_least": 1.0}, "met"),
            (0.9, {"at_least": 1.0}, "MISSED"),
            (1.1, {"at_most": 1.0}, "MISSED"),
            (1.1, {}, ""),
        ],
    )
    def test_the_table_says_whether_a_bound_is_met(
        self, value: float, bounds: Bounds, verdict: str
    ) -> None:
        text = table_text([Figure(name="x", value=value, **bounds)])
        assert [word for word in ("met", "MISSED") if word in text] == [verdict][: bool(verdict)]


@pytest.mark.soak
def test_everyone_takes_part_and_the_tape_gives_the_episodes_pictures(tmp_path: Path) -> None:
    names = ["parts", "reader", "memory"]
    names += [name for name in CONTESTANTS if name != "kuka"]  # it needs what not everyone has
    out = tmp_path / "benchmarks.bench.json"
    command = [sys.executable, "-m", "benchmarks.bench", "--episodes", "3", "--rounds", "1",
               "--resolution", "64x48", "--json", str(out),
               "--only", *names]  # fmt: skip
    environment = os.environ | {"PYTHONPATH": str(TESTS)}
    done = subprocess.run(
        command, cwd=TESTS.parent, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    record = json.loads(out.read_text(encoding="utf-8"))
    assert [name for name in names if name not in record["scores"]] == []
    for figure in record["figures"]:
        assert figure["name"] in done.stdout
    parts = record["scores"]["parts"][0]
    engine = sum(parts["details"].pop(name) for name in ENGINE)
    whole = sum(parts["details"].values())
    assert 0.0 < engine < whole
    assert whole == pytest.approx(parts["seconds"], rel=0.05)
