"""The contract of an exporter, which every row of ``EXPORTERS`` keeps: see ``ExporterContract``.

It runs on two exporters of the tests as well, and so does what every export checks by itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.exporter_contract import QUARANTINED, ExporterContract, N, make_store
from support.exporters import IMAGES, LINES

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters import EXPORTERS, Exporter
from grasp_factory.writers.exporters.exporting import run_export

ALL = {**EXPORTERS, "lines of the tests": LINES, "images of the tests": IMAGES}


@pytest.mark.parametrize("name", ALL)
class TestEveryExporter(ExporterContract):
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
        run_export(LINES, dataset, rows, tmp_path / "out.jsonl", {})
    assert str(caught.value).startswith(f"{dataset.path}: {message}")
    assert list(tmp_path.iterdir()) == []


PLACES = {
    "another ending": ("out.txt", "got a name that ends in '.txt', valid: '.jsonl'"),
    "no ending": ("out", "got a name that ends in '', valid: '.jsonl'"),
    "a folder that is not there": ("nowhere/out.jsonl", "the folder"),
    "inside the store": ("store.zarr/out.jsonl", "is inside a store"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", PLACES)
def test_a_place_that_cannot_be_written_to_is_refused(tmp_path: Path, what: str) -> None:
    name, message = PLACES[what]
    dataset = make_store(tmp_path / "store.zarr")
    with pytest.raises(UsageError) as caught:
        run_export(LINES, dataset, [0], tmp_path / name, {})
    assert message in str(caught.value)
    assert list(tmp_path.iterdir()) == [tmp_path / "store.zarr"]


@pytest.mark.parametrize("name", ["out.jsonl", "OUT.JSONL", "x" * 249 + ".jsonl"])
def test_a_name_without_a_folder_lies_in_the_current_one(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    run_export(LINES, dataset, [0], Path(name), {})
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_missing_library_is_named_with_how_to_install_it(
    dataset: Dataset, tmp_path: Path
) -> None:
    needy = Exporter(
        name="needy",
        description="needs what there is not",
        write=LINES.write,
        libraries=("no_such_library",),
        extra="needy",
    )
    with pytest.raises(UsageError, match=r"no_such_library.*pip install 'grasp-factory\[needy\]'"):
        run_export(needy, dataset, [0], tmp_path / "out", {})


def test_lines_hold_the_rows_in_the_order_that_was_asked_for(
    dataset: Dataset, tmp_path: Path
) -> None:
    run_export(LINES, dataset, [5, 0, 3], tmp_path / "out.jsonl", {})
    lines: list[Any] = (tmp_path / "out.jsonl").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ['{"row": 5', '{"row": 0', '{"row": 3']
