"""Labels and annotations come back from an export, and it is read in a process with limits."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.exporter_contract import QUARANTINED, N, make_store

from grasp_factory.curation.restore import list_export, restore
from grasp_factory.curation.restore.exported import open_export
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError, StoreError, UsageError
from grasp_factory.writers.exporters import EXPORTERS
from grasp_factory.writers.exporters.exporting import run_export
from grasp_factory.writers.zarr.label_columns import NOT_LABELLED, write_label

Run = Callable[..., tuple[int, str, str]]
THRESHOLDS = {"min_lift": 0.1, "min_shake": None}
MARK = {
    "id": "0123456789ab",
    "camera": "front",
    "frame": 0,
    "shape": "box",
    "label": "rim",
    "pixels": [1.0, 2.0, 3.0, 4.0],
}


def labelled(path: Path, labels: dict[str, dict[str, Any]], **changes: Any) -> Dataset:
    """Write a store with added labels, whose outcomes are the numbers of the rows modulo 3."""
    store = make_store(path, **changes)
    outcome = np.arange(N, dtype=np.uint8) % 3
    outcome[QUARANTINED] = NOT_LABELLED
    for name, thresholds in labels.items():
        write_label(path, name, outcome, thresholds)
    return store


def annotate(store: Path) -> None:
    log = AnnotationLog(store)
    log.append("ann", [1, 3], [("tag", "slippery"), ("tag", "é"), ("quality", 2)])
    log.append("bob", [3], [("note", "it\nfell"), ("mark", MARK), ("outcome", "success")])
    log.append("ann", [0], [("tag", "gone"), ("untag", "gone")])


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path = tmp_path_factory.mktemp("source") / "store.zarr"
    dataset = labelled(path, {"strict": THRESHOLDS})
    annotate(path)
    return dataset


@pytest.fixture(scope="module")
def export(store: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return store.export("sequences", tmp_path_factory.mktemp("e") / "export", [3, 0]).path


def test_labels_come_back_with_their_thresholds(export: Path, tmp_path: Path) -> None:
    found = restore(export, tmp_path / "again.zarr")
    assert found.labels == ("strict",)
    after = Dataset(tmp_path / "again.zarr", checked=True)
    assert after.labels == ["strict"]
    assert after.label("strict").tolist() == [0, 0]
    assert after.label_thresholds("strict") == THRESHOLDS
    problems = map(str, verify(after.path).problems)
    assert [text for text in problems if "labels/" in text or "annotation" in text] == []


def test_annotations_come_back_as_they_stood(store: Dataset, export: Path, tmp_path: Path) -> None:
    found = restore(export, tmp_path / "again.zarr")
    assert found.annotations == 1
    (said,) = AnnotationLog(tmp_path / "again.zarr").annotations().values()
    before = store.annotations[3]
    assert said.row == 0
    for name in ("tags", "note", "quality", "outcome", "marks", "changed", "by"):
        assert getattr(said, name) == getattr(before, name)
    assert AnnotationLog(tmp_path / "again.zarr").damaged() == []


def test_an_export_of_what_was_imported_says_the_same(export: Path, tmp_path: Path) -> None:
    restore(export, tmp_path / "again.zarr")
    Dataset(tmp_path / "again.zarr").export("sequences", tmp_path / "again")
    first, second = (
        json.loads((folder / "grasp_factory.json").read_text())
        for folder in (export, tmp_path / "again")
    )
    assert second["labels"] == first["labels"]
    assert {**second["annotations"]["0"], "row": 3} == first["annotations"]["0"]


def test_of_several_stores_a_label_covers_the_rows_of_those_that_have_it(tmp_path: Path) -> None:
    first = labelled(tmp_path / "a.zarr", {"strict": THRESHOLDS, "same": {"min_lift": 0.1}})
    second = labelled(tmp_path / "b.zarr", {"same": {"min_lift": 0.2}}, seed=8)
    run_export(EXPORTERS["article"], [(first, [5, 1]), (second, [1])], tmp_path / "export", {})
    restore(tmp_path / "export", tmp_path / "again.zarr")
    after = Dataset(tmp_path / "again.zarr")
    assert after.label("strict").tolist() == [2, 1, NOT_LABELLED]
    assert after.label("same").tolist() == [2, 1, 1]
    assert after.label_thresholds("strict") == THRESHOLDS
    assert after.label_thresholds("same") == {}


def test_the_command_says_what_came_back(export: Path, tmp_path: Path, run: Run) -> None:
    code, out, err = run("import", export, tmp_path / "again.zarr")
    assert (code, err) == (0, "")
    assert out.splitlines()[1:3] == ["added labels: strict", "annotations of 1 episode"]


def said(**changes: object) -> dict[str, Any]:
    plain = {"row": 3, "tags": ["odd"], "changed": "2026-01-31T08:15:00.250Z", "by": "ann"}
    return {"annotations": {"0": plain | changes}}


DAMAGES: dict[str, dict[str, Any]] = {
    "labels of nonsense": {"labels": 3},
    "a label of another length": {"labels": {"strict": ["success"]}},
    "an unknown outcome": {"labels": {"strict": ["success", "victory"]}},
    "a name of a label that is a path": {"labels": {"../../x": [None, None]}},
    "too many labels": {"labels": {f"l{k}": [None, None] for k in range(101)}},
    "thresholds of nonsense": {"label_thresholds": {"strict": {"min_lift": "x"}}},
    "annotations of nonsense": {"annotations": [1]},
    "an annotation of an episode that is not there": {"annotations": {"7": {}}},
    "an annotation of no episode": {"annotations": {"x": {}}},
    "a tag with a comma": said(tags=["a,b"]),
    "no time": said(changed="yesterday"),
    "nobody": said(by=""),
    "an unknown corrected outcome": said(outcome="victory"),
    "half a character": said(tags=["\ud800"]),
    "a mark beside the image": said(marks=[MARK | {"pixels": [500, 2, 3, 4]}]),
    "a mark of another camera": said(marks=[MARK | {"camera": "rear"}]),
    "an unknown key": said(colour="red"),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_additions_that_are_damaged_are_one_line_and_nothing_is_written(
    export: Path, tmp_path: Path, what: str
) -> None:
    folder, changes = Path(shutil.copytree(export, tmp_path / "export")), DAMAGES[what]
    record = json.loads((folder / "grasp_factory.json").read_text())
    for store in record["stores"]:
        store.update({key: changes[key] for key in changes if key == "label_thresholds"})
    record |= {key: changes[key] for key in changes if key != "label_thresholds"}
    (folder / "grasp_factory.json").write_text(json.dumps(record))
    with pytest.raises(GraspFactoryError) as caught:
        restore(folder, tmp_path / "again.zarr")
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["export"]


@pytest.mark.parametrize("place", ["{export}/again.zarr", "{export}/sequences/again.zarr"])
def test_no_store_is_made_in_the_export(export: Path, run: Run, place: str) -> None:
    code, _, err = run("import", export, place.format(export=export))
    assert code == 2
    assert f"lies in the export {export}: choose another OUT" in err
    assert not (export / "again.zarr").exists()


@pytest.mark.parametrize("place", ["in.zarr", "episodes/in.zarr"])
def test_no_store_is_made_in_another_store(
    export: Path, store: Dataset, run: Run, place: str
) -> None:
    code, _, err = run("import", export, store.path / place)
    assert code == 2
    assert "is inside a store, which holds data only: choose another OUT" in err
    assert not (store.path / place).exists()


def test_lines_without_a_number_count_too(export: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(export, tmp_path / "export"))
    with (folder / "grasp_factory_episodes.jsonl").open("a") as file:
        file.write("{}\n")
    with pytest.raises(StoreError, match="has more lines than 2, its episodes"):
        open_export(folder)


@pytest.mark.usefixtures("isolated")
def test_the_record_and_the_lines_are_read_by_the_process_with_limits(
    export: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def here(*_: object) -> None:
        raise AssertionError(f"read in process {os.getpid()}")

    parent = os.getpid()
    monkeypatch.setattr(
        "grasp_factory.curation.restore.exported.parsed",
        lambda data: here() if os.getpid() == parent else json.loads(data),
    )
    started, counted = list[int](), list[int]()
    restore(
        export,
        tmp_path / "again.zarr",
        on_start=started.append,
        on_episode=lambda: counted.append(0),
    )
    assert (started, len(counted)) == ([2], 2)
    assert list_export(export).episodes == 2


def test_the_list_of_an_export_says_what_it_has(
    export: Path, store: Dataset, tmp_path: Path, run: Run
) -> None:
    code, out, err = run("import", export, tmp_path / "out", "--list")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"{export}: 2 episodes as sequences, can be imported",
        "stores: store.zarr",
        f"arrays of the stores: {', '.join(sorted(store.features))}",
        "added labels: strict",
        "annotations of 1 episode",
    ]
    store.export("webdataset", tmp_path / "shards", [0])
    code, out, _ = run("import", tmp_path / "shards", "--list", "--json")
    found = json.loads(out)
    assert (found["format"], found["can_be_imported"]) == ("webdataset", False)
    assert [path.name for path in tmp_path.iterdir()] == ["shards"]


@pytest.mark.parametrize("content", ["{", "{}", '{"format": 3}', '{"format": "x", "episodes": 1}'])
def test_the_list_of_a_damaged_export_is_one_line(tmp_path: Path, run: Run, content: str) -> None:
    (tmp_path / "grasp_factory.json").write_text(content)
    code, out, err = run("import", tmp_path, "--list")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "is damaged" in err


MESSAGES = {
    "nothing": ("nothere s.zarr", "nothere does not exist; valid: a bag of ROS 1 or ROS 2, or"),
    "a store": ("{store} o", "store.zarr is a store, which is no bag and no export; valid: "),
    "a file": ("README o", "README is no ROS bag and no export: it begins with b'hello'"),
    "an export to a layout": ("{export} o --to sequences", "is an export, and --to and --topics"),
    "topics of an export": ("{export} o --topics /imu", "is an export, and --to and --topics"),
    "an export alone": ("{export}", "is an export: name OUT, the path of the new store; --list"),
}


@pytest.mark.parametrize("what", MESSAGES)
def test_what_cannot_be_imported_is_said_in_one_line(
    export: Path, store: Dataset, complaint: Callable[..., tuple[int, str]], what: str
) -> None:
    Path("README").write_text("hello")
    words, message = MESSAGES[what]
    code, err = complaint("import", *words.format(export=export, store=store.path).split())
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert [path.name for path in Path().iterdir()] == ["README"]


def test_rows_of_the_lines_are_refused_unless_each_has_its_own_number(
    export: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(export, tmp_path / "export"))
    lines = folder / "grasp_factory_episodes.jsonl"
    first, second = map(json.loads, lines.read_text().splitlines())
    lines.write_text("".join(f"{json.dumps(line | {'episode': 1})}\n" for line in (first, second)))
    with pytest.raises(GraspFactoryError, match="it does not number the episodes from 0"):
        restore(folder, tmp_path / "again.zarr")


def test_an_empty_folder_is_a_place_for_a_store(export: Path, tmp_path: Path) -> None:
    (tmp_path / "again.zarr").mkdir()
    assert restore(export, tmp_path / "again.zarr").episodes == 2
    with pytest.raises(UsageError, match="exists, only new stores are made"):
        restore(export, tmp_path / "again.zarr")


@pytest.mark.parametrize("place", ["{store}/episodes/in.zarr", "{export}/in.zarr"])
def test_no_store_is_made_in_a_store_or_the_export_through_a_link(
    export: Path, store: Dataset, run: Run, tmp_path: Path, place: str
) -> None:
    target = Path(place.format(store=store.path, export=export))
    (tmp_path / "link.zarr").symlink_to(target)
    code, _, err = run("import", export, tmp_path / "link.zarr")
    assert (code, err.count("\n")) == (2, 1)
    assert f"{tmp_path}/link.zarr" in err
    assert not target.exists()
