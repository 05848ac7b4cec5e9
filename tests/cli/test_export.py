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

from grasp_factory.dataset.dataset import Dataset
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
    lines = (Path(path) / "lines.jsonl").read_text().splitlines()
    return [json.loads(line)["row"] for line in lines]


def test_it_lists_the_formats_with_what_each_leaves_out_and_why(run: Run) -> None:
    code, out, _ = run("export", "--list")
    assert code == 0
    assert f"lines: {LINES.description}\n  options: digits=3\n" in out
    assert "  leaves out: *, because a line holds the row and the lift\n" in out
    assert "  leaves out: other streams/*, because no file of the layout is for the sensor" in out
    assert "  no attempt: the episode is left out" in out
    _, out, _ = run("export", "--list", "--json")
    found = json.loads(out)["lines"]
    assert found["description"] == LINES.description
    assert found["left_out"] == LINES.contents.left_out


def test_it_writes_every_episode_and_says_what_is_left_out(run: Run, store: Path) -> None:
    before = tree(store)
    code, out, err = run("export", store, "out", "--to", "lines")
    assert (code, err) == (0, "")
    head, *more = out.splitlines()
    assert head.startswith("out: 5 episodes as lines, ")
    assert more == [
        "1 quarantined row left out: there is no data",
        "has: nothing but the record of the episodes",
        "leaves out: *, because a line holds the row and the lift",
        "no attempt: the episode is left out",
    ]
    assert rows_of("out") == COMMITTED
    assert tree(store) == before


def test_of_several_stores_each_gives_its_rows(run: Run, store: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.zarr"
    make_store(other)
    Path("ids").write_text(f"{other}:3\n{store}:5\n{store}:0\n")
    code, out, err = run("export", store, other, "out", "--to=lines", "--ids=ids", "--workers=2")
    assert (code, err) == (0, "")
    assert out.startswith("out: 3 episodes as lines, ")
    assert rows_of("out") == [5, 0, 3]


def test_episodes_are_chosen_by_their_split(run: Run, store: Path) -> None:
    code, _, _ = run("export", store, "out", "--to=lines", "--split", "train")
    assert code == 0
    assert rows_of("out") == Dataset(store).split("train").indices.tolist()


def test_rows_and_settings_are_those_that_are_asked_for(run: Run, store: Path) -> None:
    common = (store, "--to", "lines", "--option", "digits=1", "--json")
    code, out, _ = run("export", *common, "out", "--episodes", "3,0")
    assert code == 0
    found = json.loads(out)
    assert (found["path"], found["format"], found["episodes"]) == ("out", "lines", 2)
    assert found["bytes"] == sum(len(data) for data in tree(Path("out")).values())
    assert rows_of("out") == [3, 0]
    for line in Path("out/lines.jsonl").read_text().splitlines():
        assert re.search(r'"lift": (NaN|-?\d+\.\d)}$', line)


def test_episodes_are_chosen_by_a_column(run: Run, store: Path) -> None:
    code, _, _ = run("export", store, "a", "--to=lines", "--where", "index=[1,5]")
    assert code == 0
    assert rows_of("a") == [1, 5]


BAD = {
    "no OUT": (("{store}", "--to", "lines"), "export needs STORE, OUT and --to"),
    "no format": (("{store}", "out"), "export needs STORE, OUT and --to"),
    "an unknown format": (
        ("{store}", "out", "--to", "line"),
        "unknown format 'line'; did you mean 'lines'?",
    ),
    "no store": (("nowhere.zarr", "out", "--to", "lines"), "nowhere.zarr"),
    "no STORE": (("out", "--to", "lines"), "export needs STORE, OUT and --to"),
    "rows of several stores": (
        ("{store}", "{store}", "out", "--to", "lines", "--episodes", "0"),
        "--episodes: valid for one store only",
    ),
    "no workers": (("{store}", "out", "--to", "lines", "--workers", "0"), "--workers"),
    "inside the store": (("{store}", "{store}/out", "--to", "lines"), "inside a store"),
    "no such folder": (("{store}", "a/out", "--to", "lines"), "does not exist"),
    "a row that is not there": (
        ("{store}", "out", "--to", "lines", "--episodes", "0,99"),
        "got row 99, valid: 0 to 5",
    ),
    "a quarantined row": (
        ("{store}", "out", "--to", "lines", "--episodes", str(QUARANTINED)),
        "has no episode: it is quarantined",
    ),
    "no episodes": (
        ("{store}", "out", "--to", "lines", "--where", "index=99"),
        "there are no episodes to export",
    ),
    "an unknown setting": (
        ("{store}", "out", "--to", "lines", "--option", "digit=1"),
        "unknown key 'lines.digit'; did you mean 'digits'? (valid: digits)",
    ),
    "a setting out of range": (
        ("{store}", "out", "--to", "lines", "--option", "digits=99"),
        "lines.digits: got 99, valid: 0 to 15",
    ),
    "a setting without a value": (
        ("{store}", "out", "--to", "lines", "--option", "digits"),
        "--option: got 'digits', valid: KEY=VALUE, each key once",
    ),
    "a setting twice": (
        ("{store}", "out", "--to", "lines", *("--option", "digits=1") * 2),
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
    Path("out").write_text("mine")
    code, _, err = run("export", store, "out", "--to", "lines")
    assert code == 2
    assert "out exists, and an export overwrites nothing" in err
    assert Path("out").read_text() == "mine"


def test_a_damaged_store_is_a_failure_that_names_it(run: Run, tmp_path: Path) -> None:
    make_store(tmp_path / "damaged.zarr")
    for file in (tmp_path / "damaged.zarr/episodes/lift_height").rglob("[01]"):
        file.write_bytes(b"nonsense")
    code, _, err = run("export", "damaged.zarr", "out", "--to", "lines")
    assert code == 1
    assert "damaged.zarr" in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.zarr"]
