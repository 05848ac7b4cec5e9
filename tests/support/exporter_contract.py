"""The contract of an exporter as tests: a class that needs nothing but an exporter to run on.

Use it as a base class with a fixture ``exporter``; see ``tests/conformance/test_exporters.py``.
"""

from __future__ import annotations

import dataclasses
import errno
import json
import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.fake_episodes import JOINTS, make_rows, small_config
from support.faulty_disk import FaultyDisk
from support.helpers import tree
from support.scale import soak_only

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreError, UsageError
from grasp_factory.writers.exporters import Exporter, base
from grasp_factory.writers.exporters.exporting import Exported, run_export
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

N = 6
QUARANTINED = 4
ROWS = (3, 0, 5)
"""Not in order, and not all."""
SETTINGS: dict[str, Any] = {"episodes_per_shard": 2, "episodes_per_file": 2, "camera": "front"}
"""Settings for the exporters that have them: small parts; the store has no overhead camera."""


def cameras(*names: str) -> dict[str, Any]:
    """Return the settings of predefined cameras."""
    return {name: to_plain(CAMERAS[name].config) for name in names}


CAMERAS_OF_STORES = cameras("front", "wrist")


def make_store(path: Path, **changes: Any) -> Dataset:
    """Write a store with two blocks, two cameras, videos, two objects and a quarantined row."""
    config = small_config(
        **{"video_hz": 5, "clutter": {"count": 2}, "cameras": CAMERAS_OF_STORES, **changes}
    )
    prepare_store(path, config, JOINTS, N, {})
    for block in (0, 1):
        ZarrWriter(path).write_block(block, make_rows(config, block, N, (QUARANTINED,)))
    return Dataset(path, checked=True)


def export_until_killed(
    exporter: Exporter, dataset: Dataset, settings: dict[str, Any], out: Path
) -> None:
    run_export(exporter, [(dataset, ROWS)], out, settings, on_episode=kill_this_process)


def kill_this_process() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


OCCUPANTS: dict[str, Callable[[Path], object]] = {
    "a file": lambda path: path.write_text("mine"),
    "a folder": lambda path: path.mkdir(),
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
}


def occupant(path: Path) -> tuple[bool, bool, str]:
    """Return what tells whether something at a path is still what it was."""
    is_link = path.is_symlink()
    return is_link, path.is_dir(), os.readlink(path) if is_link else str(tree(path))


class ExportFixtures:
    """What the tests of an exporter use."""

    @pytest.fixture(scope="class")
    @staticmethod
    def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
        return make_store(tmp_path_factory.mktemp("source") / "store.zarr")

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        (tmp_path / "exports").mkdir()
        return tmp_path / "exports"

    @pytest.fixture
    def out(self, folder: Path) -> Path:
        return folder / "out"

    @pytest.fixture(autouse=True)
    def small_parts(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(base, "EPISODES_PER_PART", 2)

    @pytest.fixture
    def settings(self, exporter: Exporter) -> dict[str, Any]:
        names = {field.name for field in dataclasses.fields(exporter.parameters)}
        return {name: value for name, value in SETTINGS.items() if name in names}

    @pytest.fixture
    def export(
        self, exporter: Exporter, dataset: Dataset, settings: dict[str, Any], out: Path
    ) -> Callable[..., Exported]:
        def export(rows: Any = ROWS, path: Path = out, **more: Any) -> Exported:
            return run_export(exporter, [(dataset, rows)], path, settings, **more)

        return export


class ExporterContract(ExportFixtures):
    """What every exporter does.

    - It fills ``job.folder`` and creates nothing beside it.
    - It writes every chosen episode that it can hold, and calls ``on_episode`` once for each.
    - It says of every array of the store whether it is written, or why it is left out.
    - The same rows yield the same bytes; another order, other bytes.
    - It leaves the store as it is.
    - It refuses an unknown setting with the valid ones.
    - It leaves nothing behind when anything fails: the disk, the user's Ctrl-C, a damaged store.
    - It overwrites nothing, also nothing that appears at the place while it runs.
    """

    def test_it_creates_what_was_asked_for_and_nothing_beside_it(
        self, export: Callable[..., Exported], out: Path
    ) -> None:
        export()
        assert [path.name for path in out.parent.iterdir()] == [out.name]
        assert {"grasp_factory.json", "grasp_factory_episodes.jsonl"} < set(tree(out))

    def test_it_counts_each_episode_and_reports_what_it_made(
        self, exporter: Exporter, export: Callable[..., Exported], out: Path
    ) -> None:
        totals, counted = list[int](), list[int]()
        found = export(on_start=totals.append, on_episode=lambda: counted.append(0))
        assert (found.path, found.format) == (out, exporter.name)
        assert totals == [found.episodes] == [len(counted)]
        assert found.episodes + sum(found.excluded.values()) == len(ROWS)
        assert found.quarantined == 1
        assert found.bytes == sum(len(data) for data in tree(out).values())

    def test_every_array_is_written_or_left_out_for_a_reason(
        self, exporter: Exporter, dataset: Dataset
    ) -> None:
        assert exporter.contents.not_mentioned(dataset.features.values()) == []
        assert all([*exporter.contents.left_out.values(), *exporter.contents.treatment.values()])

    def test_it_says_which_rows_it_has(
        self, export: Callable[..., Exported], dataset: Dataset, out: Path
    ) -> None:
        found = export()
        record = json.loads((out / "grasp_factory.json").read_text())
        lines = (out / "grasp_factory_episodes.jsonl").read_text().splitlines()
        episodes = [json.loads(line) for line in lines]
        assert record["episodes"] == len(episodes) == found.episodes
        assert {name: len(rows) for name, rows in record["excluded"].items()} == found.excluded
        lost = {row for rows in record["excluded"].values() for _, row in rows}
        assert sorted(line["episode"] for line in episodes) == list(range(found.episodes))
        in_order = sorted(episodes, key=lambda line: int(line["episode"]))
        assert [line["row"] for line in in_order] == [row for row in ROWS if row not in lost]
        for line in episodes:
            assert line["checksum"] == dataset.value(line["row"], "checksum")
            episode = dataset[line["row"]]
            assert line["columns"]["outcome"] == episode.outcome.name.lower()
            assert line["columns"]["spec"] == to_plain(episode.spec)

    def test_the_same_rows_give_the_same_bytes_and_another_order_others(
        self, export: Callable[..., Exported], out: Path
    ) -> None:
        first, again, other = (out.with_stem(name) for name in ("a", "b", "c"))
        export(path=first)
        export(path=again)
        export(ROWS[::-1], path=other)
        assert tree(first) == tree(again)
        assert tree(first) != tree(other)

    def test_the_store_stays_as_it_was(
        self, export: Callable[..., Exported], dataset: Dataset
    ) -> None:
        before = tree(dataset.path)
        export()
        assert tree(dataset.path) == before

    def test_an_unknown_setting_is_refused_with_the_valid_ones(
        self, exporter: Exporter, dataset: Dataset, out: Path
    ) -> None:
        valid = ", ".join(field.name for field in dataclasses.fields(exporter.parameters)) or "none"
        with pytest.raises(ConfigError) as caught:
            run_export(exporter, [(dataset, ROWS)], out, {"nonsense": 1})
        assert str(caught.value).startswith(f"unknown key '{exporter.name}.nonsense'")
        assert str(caught.value).endswith(f"(valid: {valid})")
        assert not out.exists()

    @pytest.mark.parametrize(
        "error", [errno.ENOSPC, *soak_only(errno.EIO)], ids=["full", "failing"]
    )
    def test_a_disk_that_fails_at_any_call_leaves_nothing(
        self, export: Callable[..., Exported], folder: Path, out: Path, error: int
    ) -> None:
        for failures in (0, 1, *(2**k for k in range(1, 20))):
            calls = iter(range(failures))
            first = lambda _done, calls=calls: next(calls, None) is None  # noqa: E731
            with FaultyDisk(folder, first, error, stays=False).installed() as disk:
                if disk_outcome(export) is None:
                    break
            assert disk.has_failed
            assert list(folder.iterdir()) == []
        assert failures > 2
        assert out.exists()

    def test_ctrl_c_leaves_nothing(self, export: Callable[..., Exported], folder: Path) -> None:
        def stop() -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            export(on_episode=stop)
        assert list(folder.iterdir()) == []

    def test_a_damaged_store_is_named_and_nothing_is_left(
        self, exporter: Exporter, settings: dict[str, Any], folder: Path, tmp_path: Path
    ) -> None:
        dataset = make_store(tmp_path / "damaged.zarr")
        for file in (tmp_path / "damaged.zarr").rglob("*"):
            is_data = file.is_file() and file.name != "zarr.json" and "status" not in file.parts
            if is_data:
                file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        with pytest.raises(StoreError, match="damaged"):
            run_export(exporter, [(dataset, ROWS)], folder / "out", settings)
        assert list(folder.iterdir()) == []

    @pytest.mark.parametrize("what", OCCUPANTS)
    def test_what_is_there_is_not_overwritten(
        self, export: Callable[..., Exported], out: Path, what: str
    ) -> None:
        OCCUPANTS[what](out)
        before = occupant(out)
        with pytest.raises(UsageError, match="exists, and an export overwrites nothing"):
            export()
        assert occupant(out) == before
        assert list(out.parent.iterdir()) == [out]

    @pytest.mark.parametrize("what", OCCUPANTS)
    def test_what_appears_while_it_runs_is_not_overwritten(
        self, export: Callable[..., Exported], out: Path, what: str
    ) -> None:
        def appear() -> None:
            if not os.path.lexists(out):
                OCCUPANTS[what](out)

        with pytest.raises(UsageError, match="exists, and an export overwrites nothing"):
            export(on_episode=appear)
        assert list(out.parent.iterdir()) == [out]
        if what == "a file":
            assert out.read_text() == "mine"


class WorkersContract(ExportFixtures):
    """Bytes do not depend on the number of workers."""

    def test_two_workers_give_the_bytes_of_one(
        self, export: Callable[..., Exported], out: Path
    ) -> None:
        alone, shared = out.with_stem("alone"), out.with_stem("shared")
        export(path=alone)
        export(path=shared, workers=2)
        assert tree(alone) == tree(shared)


class SeriesContract(ExportFixtures):
    """What an exporter that names its time series does without the others."""

    def test_it_writes_what_it_writes_with_all_of_them(
        self,
        exporter: Exporter,
        export: Callable[..., Exported],
        dataset: Dataset,
        settings: dict[str, Any],
        out: Path,
    ) -> None:
        export()
        with_all = dataclasses.replace(exporter, series=None)
        run_export(with_all, [(dataset, ROWS)], out.with_stem("all"), settings)
        assert tree(out) == tree(out.with_stem("all"))


class KilledContract(ExportFixtures):
    """What a killed export leaves."""

    def test_of_a_killed_process_only_a_hidden_folder_stays_which_the_next_run_removes(
        self,
        exporter: Exporter,
        export: Callable[..., Exported],
        dataset: Dataset,
        settings: dict[str, Any],
        out: Path,
    ) -> None:
        spawn = multiprocessing.get_context("spawn")
        process = spawn.Process(target=export_until_killed, args=(exporter, dataset, settings, out))
        process.start()
        process.join()
        assert process.exitcode == -signal.SIGKILL
        (left,) = out.parent.iterdir()
        assert left.is_dir()
        assert left.name.startswith(f".{out.name}.exporting-")
        export()
        assert list(out.parent.iterdir()) == [out]


def disk_outcome(export: Callable[..., Exported]) -> str | None:
    """Return what an export on a faulty disk ended with; None if it was done."""
    try:
        export()
    except StoreError as error:
        return str(error)
    return None
