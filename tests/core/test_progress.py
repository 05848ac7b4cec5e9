"""Progress on stderr: a bar in a terminal or a notebook, a line a minute elsewhere."""

from __future__ import annotations

import io
import sys
from itertools import count

import pytest

from grasp_factory.core.progress import LINE_S, Progress

Captured = pytest.CaptureFixture[str]


def lines_of(captured: Captured, seconds: float, steps: int, unit: str, total: int) -> list[str]:
    """Return the lines of a progress whose steps take so many seconds each."""
    clock = count(0.0, seconds)
    with Progress(total, unit, clock=lambda: next(clock)) as progress:
        for _ in range(steps):
            progress.count("success 50.0 %")
    return captured.readouterr().err.splitlines()


def test_without_a_terminal_there_is_a_line_a_minute(capsys: Captured) -> None:
    lines = lines_of(capsys, LINE_S / 10, 40, "episode", 100)
    assert lines == [
        "10 of 100 episodes after 60 s, about 9 min left, success 50.0 %",
        "20 of 100 episodes after 2 min, about 8 min left, success 50.0 %",
        "30 of 100 episodes after 3 min, about 7 min left, success 50.0 %",
        "40 of 100 episodes after 4 min, about 6 min left, success 50.0 %",
    ]


def test_what_takes_less_than_a_minute_says_nothing(capsys: Captured) -> None:
    assert lines_of(capsys, LINE_S / 101, 100, "file", 100) == []


@pytest.mark.parametrize(
    ("unit", "total", "text"),
    [("%", 100, "1 % after 90 s, about 2.5 h left"), ("message", 0, "1 message after 90 s")],
)
def test_shares_and_unknown_totals_have_their_own_words(
    capsys: Captured, unit: str, total: int, text: str
) -> None:
    assert lines_of(capsys, 90.0, 1, unit, total) == [f"{text}, success 50.0 %"]


def test_a_terminal_and_the_cell_of_a_notebook_have_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    class Cell(io.StringIO):
        __module__ = "ipykernel.iostream"

    for stream in (Terminal(), Cell()):
        monkeypatch.setattr(sys, "stderr", stream)
        with Progress(3, "episode") as progress:
            progress.count()
        assert "0/3" in stream.getvalue()
