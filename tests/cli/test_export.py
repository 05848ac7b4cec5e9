"""`grasp-factory export` as a user meets it, with an exporter of the tests."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from support.exporter_contract import QUARANTINED, N, make_store
from support.exporters import LINES
from support.helpers import tree

from grasp_factory.writers.exporters import EXPORTERS

Run = Callable[..., tuple[int, str, str]]
COMMITTED = [row for row in range(N) if row != QUARANTINED]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("source") / "store.zarr"
    make_store(path)
    return path


@pytest.fixture(autouse=True)
def in_an_empty_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(EXPORTERS, "lines", LINES)  # type: ignore[misc]
    monkeypatch.chdir(tmp_path)


def rows_of(path: str) -> list[int]:
    return [json.loads(line)["row"] for line in Path(path).read_text().splitlines()]


def test_without_arguments_it_lists_the_formats(run: Run) -> None:
    code, out, _ = run("export")
    assert code == 0
    assert re.search(f"^lines +{LINES.description}$", out, re.MULTILINE)
    _, out, _ = run("export", "--json")
    assert json.loads(out)["lines"] == LINES.description


def test_it_writes_every_episode_and_says_what_is_left_out(run: Run, store: Path) -> None:
    before = tree(store)
    code, out, err = run("export", store, "out.jsonl", "--format", "lines")
    assert (code, err) == (0, "")
    head, *more = out.splitlines()
    assert head.startswith("out.jsonl: 5 episodes as lines, ")
    assert more == [
        "written: episodes/outcome",
        "written: episodes/lift_height",
        "left out: *, because a line holds the outcome and the lift",
    ]
    assert rows_of("out.jsonl") == COMMITTED
    assert tree(store) == before


def test_rows_and_settings_are_those_that_are_asked_for(run: Run, store: Path) -> None:
    common = (store, "--format", "lines", "--option", "digits=1", "--json")
    code, out, _ = run("export", *common, "out.jsonl", "--episodes", "3,0")
    assert code == 0
    found = json.loads(out)
    assert (found["path"], found["format"], found["episodes"]) == ("out.jsonl", "lines", 2)
    assert found["bytes"] == Path("out.jsonl").stat().st_size
    assert rows_of("out.jsonl") == [3, 0]
    for line in Path("out.jsonl").read_text().splitlines():
        assert re.search(r'"lift": (NaN|-?\d+\.\d)}$', line)


def test_episodes_are_chosen_by_a_column(run: Run, store: Path) -> None:
    code, _, _ = run("export", store, "a.jsonl", "--format=lines", "--where", "index=[1,5]")
    assert code == 0
    assert rows_of("a.jsonl") == [1, 5]


BAD = {
    "no OUT": (("{store}", "--format", "lines"), "export needs PATH, OUT and --format"),
    "no format": (("{store}", "out.jsonl"), "export needs PATH, OUT and --format"),
    "an unknown format": (
        ("{store}", "out.jsonl", "--format", "line"),
        "unknown format 'line'; did you mean 'lines'?",
    ),
    "no store": (("nowhere.zarr", "out.jsonl", "--format", "lines"), "nowhere.zarr"),
    "another ending": (("{store}", "out.csv", "--format", "lines"), "valid: '.jsonl'"),
    "inside the store": (("{store}", "{store}/out.jsonl", "--format", "lines"), "inside a store"),
    "no such folder": (("{store}", "a/out.jsonl", "--format", "lines"), "does not exist"),
    "a row that is not there": (
        ("{store}", "out.jsonl", "--format", "lines", "--episodes", "0,99"),
        "got row 99, valid: 0 to 5",
    ),
    "a quarantined row": (
        ("{store}", "out.jsonl", "--format", "lines", "--episodes", str(QUARANTINED)),
        "has no episode: it is quarantined",
    ),
    "no episodes": (
        ("{store}", "out.jsonl", "--format", "lines", "--where", "index=99"),
        "there are no episodes to export",
    ),
    "an unknown setting": (
        ("{store}", "out.jsonl", "--format", "lines", "--option", "digit=1"),
        "unknown key 'lines.digit'; did you mean 'digits'? (valid: digits)",
    ),
    "a setting out of range": (
        ("{store}", "out.jsonl", "--format", "lines", "--option", "digits=99"),
        "lines.digits: got 99, valid: 0 to 15",
    ),
    "a setting without a value": (
        ("{store}", "out.jsonl", "--format", "lines", "--option", "digits"),
        "--option: got 'digits', valid: KEY=VALUE, each key once",
    ),
    "a setting twice": (
        ("{store}", "out.jsonl", "--format", "lines", *("--option", "digits=1") * 2),
        "each key once",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_cannot_be_exported_is_one_line_and_nothing_is_written(
    run: Run, store: Path, tmp_path: Path, what: str
) -> None:
    words, message = BAD[what]
    code, out, err = run("export", *(word.format(store=store) for word in words))
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_overwritten(run: Run, store: Path) -> None:
    Path("out.jsonl").write_text("mine")
    code, _, err = run("export", store, "out.jsonl", "--format", "lines")
    assert code == 2
    assert "out.jsonl exists, and an export overwrites nothing" in err
    assert Path("out.jsonl").read_text() == "mine"


def test_a_damaged_store_is_a_failure_that_names_it(run: Run, tmp_path: Path) -> None:
    make_store(tmp_path / "damaged.zarr")
    for file in (tmp_path / "damaged.zarr/episodes/lift_height").rglob("[01]"):
        file.write_bytes(b"nonsense")
    code, _, err = run("export", "damaged.zarr", "out.jsonl", "--format", "lines")
    assert code == 1
    assert "damaged.zarr" in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.zarr"]
