"""Limits: what is refused, how it is said, and how a limit is raised."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from support.places import TINY

from grasp_factory.core.limits import CHUNK, DOCUMENT, LIMITS, ROWS, VARIABLE, parse
from grasp_factory.errors import LimitError, UsageError


def test_a_limit_itself_is_allowed_and_one_more_is_not() -> None:
    DOCUMENT.check(DOCUMENT.usual, "zarr.json")
    with pytest.raises(LimitError) as caught:
        DOCUMENT.check(DOCUMENT.usual + 1, "zarr.json")
    assert str(caught.value).startswith("zarr.json: a JSON document of 4.")
    assert "valid: up to 4." in str(caught.value)
    assert "grasp-factory --limit document=SIZE ..." in str(caught.value)


def test_a_count_is_no_number_of_bytes() -> None:
    with pytest.raises(LimitError, match=r"rows of 1,000,001, valid: up to 1,000,000; .* rows=N"):
        ROWS.check(ROWS.usual + 1, "store")


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("chunk=17", 17),
        ("chunk=3KiB", 3072),
        ("log=1,chunk=2 GiB", 2**31),
        ("chunk=1TiB", 2**40),
    ],
)
def test_a_limit_is_raised_by_the_environment(
    text: str, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, text)
    assert CHUNK.most == size
    assert ROWS.most == ROWS.usual


@pytest.mark.parametrize("text", ["chunk", "chunk=", "chunk=-1", "chunk=1e9", "chunk=4GB", "x=1"])
def test_what_is_no_limit_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        parse(text)


def test_the_documentation_lists_all_limits() -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "security.md"
    rows = [
        line.split("|")[1].strip(" `") for line in page.read_text().splitlines() if "| `" in line
    ]
    assert [name for name in rows if name in LIMITS] == list(LIMITS)


def test_the_command_line_raises_limits_beside_those_of_the_environment(
    run: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "log=1GiB,chunk=1")
    code, _, _ = run("--limit", "chunk=2GiB", "--limit", "rows=7", "info", str(TINY))
    assert code == 0
    assert parse(os.environ[VARIABLE]) == {"log": 2**30, "chunk": 2**31, "rows": 7}


def test_an_unknown_limit_ends_the_command_in_one_line(
    run: Callable[..., tuple[int, str, str]],
) -> None:
    code, _, err = run("--limit", "chunks=many", "info", str(TINY))
    assert (code, err.count("\n")) == (2, 1)
    assert "limit chunks: size 'many', valid: such as 512MiB" in err
