"""The contract of an exporter, which every row of ``EXPORTERS`` keeps: see ``ExporterContract``.

It runs on two exporters of the tests as well, and so does what every export checks by itself.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.exporter_contract import (
    QUARANTINED,
    ExporterContract,
    KilledContract,
    N,
    SeriesContract,
    WorkersContract,
    cameras,
    make_store,
)
from support.exporters import IMAGES, LINES
from support.scale import soak_only

from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UnknownNameError, UsageError
from grasp_factory.writers.exporters import EXPORTERS, Exporter
from grasp_factory.writers.exporters.export_record import EPISODES, RECORD
from grasp_factory.writers.exporters.exporting import run_export

ALL = {**EXPORTERS, "lines of the tests": LINES, "images of the tests": IMAGES}


@pytest.mark.parametrize("name", ALL)
class TestEveryExporter(ExporterContract):
    @pytest.fixture
    def exporter(self, name: str) -> Exporter:
        return ALL[name]


@pytest.mark.parametrize("name", [name for name in ALL if ALL[name].series is not None])
class TestOnlySomeSeries(SeriesContract):
    @pytest.fixture
    def exporter(self, name: str) -> Exporter:
        return ALL[name]


FOLDERS = ["lines of the tests", "lerobot", "rosbag2"]
"""One file, files in folders, and a library that writes files by itself."""


SOME = [*FOLDERS, *soak_only(*sorted(set(ALL) - set(FOLDERS)))]
"""What starts processes; the other formats are in the soak."""


@pytest.mark.parametrize("name", SOME)
class TestTwoWorkers(WorkersContract):
    @pytest.fixture
    def exporter(self, name: str) -> Exporter:
        return ALL[name]


@pytest.mark.parametrize("name", SOME)
class TestAKilledExport(KilledContract):
    @pytest.fixture
    def exporter(self, name: str) -> Exporter:
        return ALL[name]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_store(tmp_path_factory.mktemp("source") / "store.zarr")


ROWS: dict[str, tuple[list[int], str]] = {
    "none": ([], "there are no episodes to export"),
    "one beyond the end": ([0, N], f"got row {N}, valid: 0 to {N - 1}"),
    "one before the beginning": ([-1], f"got row -1, valid: 0 to {N - 1}"),
    "a quarantined one": ([QUARANTINED], f"row {QUARANTINED} has no episode: it is quarantined"),
    "one twice": ([1, 2, 1], "row 1 is named twice"),
}


@pytest.mark.parametrize("what", ROWS)
def test_rows_that_cannot_be_exported_are_refused(
    dataset: Dataset, tmp_path: Path, what: str
) -> None:
    rows, message = ROWS[what]
    with pytest.raises(UsageError) as caught:
        run_export(LINES, [(dataset, rows)], tmp_path / "out", {})
    assert str(caught.value).startswith(f"{dataset.path}: {message}")
    assert list(tmp_path.iterdir()) == []


PLACES = {
    "a folder that is not there": ("nowhere/out", "the folder"),
    "inside the store": ("store.zarr/out", "is inside a store"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", PLACES)
def test_a_place_that_cannot_be_written_to_is_refused(tmp_path: Path, what: str) -> None:
    name, message = PLACES[what]
    dataset = make_store(tmp_path / "store.zarr")
    with pytest.raises(UsageError) as caught:
        run_export(LINES, [(dataset, [0])], tmp_path / name, {})
    assert message in str(caught.value)
    assert list(tmp_path.iterdir()) == [tmp_path / "store.zarr"]


@pytest.mark.parametrize("name", ["out", "a.b c", "\U0001f600", "x" * 255])
def test_a_name_without_a_folder_lies_in_the_current_one(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    run_export(LINES, [(dataset, [0])], Path(name), {})
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_missing_library_is_named_with_how_to_install_it(
    dataset: Dataset, tmp_path: Path
) -> None:
    needy = Exporter(
        name="needy",
        description="needs what there is not",
        contents=LINES.contents,
        write_part=LINES.write_part,
        finish=LINES.finish,
        libraries=("no_such_library",),
        extra="needy",
    )
    with pytest.raises(UsageError, match=r"no_such_library.*pip install 'grasp-factory\[needy\]'"):
        run_export(needy, [(dataset, [0])], tmp_path / "out", {})


def rows_of(out: Path) -> list[int]:
    lines: list[Any] = (out / "lines.jsonl").read_text().splitlines()
    return [json.loads(line)["row"] for line in lines]


def test_lines_hold_the_rows_in_the_order_that_was_asked_for(
    dataset: Dataset, tmp_path: Path
) -> None:
    run_export(LINES, [(dataset, [5, 0, 3])], tmp_path / "out", {})
    assert rows_of(tmp_path / "out") == [5, 0, 3]


def test_rows_of_several_stores_follow_each_other(tmp_path: Path) -> None:
    first, second = (make_store(tmp_path / name) for name in ("a.zarr", "b.zarr"))
    out = tmp_path / "out"
    found = run_export(LINES, [(first, [5, 0]), (second, [3])], out, {}, workers=2)
    assert found.episodes == 3
    assert rows_of(out) == [5, 0, 3]
    record = json.loads((out / RECORD).read_text())
    assert [store["name"] for store in record["stores"]] == ["a.zarr", "b.zarr"]
    lines = [json.loads(line) for line in (out / EPISODES).read_text().splitlines()]
    assert [(line["store"], line["row"]) for line in lines] == [(0, 5), (0, 0), (1, 3)]


OTHER_STORES: dict[str, tuple[dict[str, Any], str]] = {
    "cameras": ({"cameras": cameras("front")}, "cameras: got ['front'], valid: ['front', 'wrist']"),
    "objects": ({"clutter": {"count": 1}}, "objects in a scene: got 1, valid: 2"),
    "videos": ({"video_hz": 0}, "video_hz: got 0, valid: 5"),
    "images": ({"resolution": (24, 24)}, "resolution: got (24, 24), valid: (32, 24)"),
    "a sensor of a plugin": (
        {
            "sensors": {"tilt": [{"name": "tilt", "shape": [2], "units": "rad"}]},
            "plugins": {
                "sensors": {"tilt": {"sha256": "0" * 64, "attribute": "TILT", "file": "tilt.py"}}
            },
        },
        "sensors of plugins: got 'streams/tilt 2 float32 rad', valid: 'none'",
    ),
}


@pytest.mark.parametrize("what", OTHER_STORES)
def test_stores_with_other_arrays_are_refused(dataset: Dataset, tmp_path: Path, what: str) -> None:
    change, message = OTHER_STORES[what]
    other = make_store(tmp_path / "other.zarr", **change)
    with pytest.raises(UsageError) as caught:
        run_export(LINES, [(dataset, [0]), (other, [0])], tmp_path / "out", {})
    assert message in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_episodes_that_the_format_cannot_hold_are_counted_with_the_reason(
    dataset: Dataset, tmp_path: Path
) -> None:
    idle = replace(LINES, excludes=lambda episodes, _: {"it is odd": episodes.column("seed") < 0})
    none = replace(LINES, excludes=lambda episodes, _: {"it is odd": episodes.column("seed") >= 0})
    some = replace(LINES, excludes=lambda episodes, _: {"it is 3": episodes.row == 3})
    assert run_export(idle, [(dataset, [0, 3])], tmp_path / "a", {}).excluded == {}
    found = run_export(some, [(dataset, [0, 3])], tmp_path / "b", {})
    assert (found.episodes, found.excluded) == (1, {"it is 3": 1})
    assert rows_of(tmp_path / "b") == [0]
    with pytest.raises(UsageError, match=r"can hold none of 2 episodes \(2: it is odd\)"):
        run_export(none, [(dataset, [0, 3])], tmp_path / "c", {})


def test_labels_and_annotations_are_in_the_record(tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "store.zarr")
    AnnotationLog(dataset.path).append("someone", [3], [("tag", "odd")])
    run_export(LINES, [(dataset, [5, 3])], tmp_path / "out", {})
    record = json.loads((tmp_path / "out" / RECORD).read_text())
    assert list(record["annotations"]) == ["1"]
    assert record["annotations"]["1"]["tags"] == ["odd"]


def test_a_dataset_exports_itself(dataset: Dataset, tmp_path: Path) -> None:
    found = dataset.export("article", tmp_path / "all", camera="wrist")
    assert found.episodes == len(dataset.committed)
    assert dataset.export("article", str(tmp_path / "one"), [3]).episodes == 1
    with pytest.raises(UnknownNameError, match="unknown format 'articel'; did you mean 'article'"):
        dataset.export("articel", tmp_path / "none")
