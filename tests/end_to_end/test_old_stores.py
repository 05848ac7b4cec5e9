"""A store of version 0.4.0, without fingerprints, does all that it did."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from support.helpers import tree
from support.stored import old_store

from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import fresh
from grasp_factory.dataset.row_reader import RowReader

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def old(tmp_path: Path) -> Path:
    return old_store(tmp_path)


def test_it_is_one_without_fingerprints(old: Path) -> None:
    dataset = Dataset(old)
    assert dataset.attributes["versions"]["grasp_factory"] == "0.4.0"
    assert FINGERPRINT not in dataset.attributes
    assert not (old / "episodes" / "fingerprint").exists()


@pytest.mark.parametrize("checked", [False, True])
def test_it_reads_as_it_was_written(old: Path, *, checked: bool) -> None:
    dataset = Dataset(old, checked=checked)
    assert dataset.status.tolist() == [1, 1, 1, 2]
    for i in dataset.committed.tolist():
        assert dataset[i].checksum() == str(dataset.column("checksum")[i])
        assert dataset.verify(i)
    assert [row.fingerprint for row in RowReader(old).read(2, 4)] == ["", ""]


@pytest.mark.parametrize(
    "words",
    [
        ("info",),
        ("info", "--full"),
        ("verify",),
        ("query", "--where", "status=committed"),
        ("tags",),
        ("sheet", "sheet.png"),
        ("split", "few.zarr", "--episodes", "0,2"),
    ],
    ids=" ".join,
)
def test_the_commands_take_it_without_complaint(
    old: Path, words: tuple[str, ...], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(old.parent)
    before = tree(old)
    name, *more = words
    code, _, err = run(name, old.name, *more)
    assert code == 0
    assert "warning" not in err
    assert tree(old) == before


def test_repair_finds_nothing_to_do(old: Path, run: Run) -> None:
    code, out, _ = run("repair", old)
    assert (code, "nothing to repair" in out) == (0, True)


def test_a_dataset_card_names_its_platform(old: Path, run: Run) -> None:
    code, _, _ = run("card", old, "--out", old.parent / "card")
    assert code == 0
    text = (old.parent / "card" / "README.md").read_text(encoding="utf-8")
    assert "`libc`" in text
    assert "`fingerprint`" not in text


def test_it_can_be_browsed(old: Path, tmp_path: Path) -> None:
    with fresh([old], tmp_path / "index.sqlite") as index:
        app = create_app(index, "token", {"localhost"}, thumbnails=Thumbnails(tmp_path))
        with app.test_client() as client:
            for address in ("/api/episodes", "/api/episode/0/0", "/api/episode/0/3"):
                assert client.get(address).status_code == 200, address
            told = json.loads(client.get("/api/episode/0/0").data)
    assert "fingerprint" not in told["columns"]
