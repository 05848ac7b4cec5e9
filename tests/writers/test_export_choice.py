"""What is exported: rows and stores that are named as they must be, and all that stores embed."""

from __future__ import annotations

import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.exporter_contract import CAMERAS_OF_STORES, QUARANTINED, N, cameras, make_store
from support.exporters import LINES
from support.fake_episodes import JOINTS, make_rows, small_config
from support.helpers import tree

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UnknownNameError, UsageError
from grasp_factory.writers.exporters import EXPORTERS
from grasp_factory.writers.exporters.exporting import run_export
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_store(tmp_path_factory.mktemp("source") / "store.zarr")


MASK = np.arange(N) % 3 == 0
ROWS: dict[str, tuple[Any, list[int]]] = {
    "integers of NumPy": (np.array([5, 0]), [5, 0]),
    "small integers": (np.array([5, 0], np.uint8), [5, 0]),
    "a generator": ((row for row in (3, 1)), [3, 1]),
    "a mask": (MASK, [0, 3]),
    "a mask of Python": (MASK.tolist(), [0, 3]),
}


@pytest.mark.parametrize("what", ROWS)
def test_rows_are_integers_or_a_mask(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    given, expected = ROWS[what]
    monkeypatch.setitem(EXPORTERS, "lines", LINES)  # type: ignore[misc]
    dataset.export("lines", tmp_path / "out", given)
    text = (tmp_path / "out/lines.jsonl").read_text()
    assert [int(line.split()[1].rstrip(",")) for line in text.splitlines()] == expected


NO_ROWS: dict[str, tuple[Any, str]] = {
    "a mask of two": ([False, True], "got 2 truth values, valid: integers, or a mask of 6"),
    "numbers": ([1.7], "got 1.7 among them"),
    "NaN": ([float("nan")], "got nan among them"),
    "a text": ("12", "got '12', valid: integers"),
    "bytes": (b"12", "got b'12', valid: integers"),
    "one row": (3, "got 3, valid: integers"),
    "a slice": (slice(0, 2), "got slice(0, 2, None), valid: integers"),
    "a table": (np.array([[1, 2]]), "got array([1, 2]) among them"),
    "truth among integers": ([1, True], "got True among them"),
    "an array of one": (np.array(3), "got array(3), valid: integers"),
    "a huge number": ([2**80], "valid: 0 to 5"),
    "a mask of a quarantined row": (np.arange(N) == QUARANTINED, "it is quarantined"),
}  # fmt: skip


@pytest.mark.parametrize("what", NO_ROWS)
def test_other_rows_are_refused_in_one_line(dataset: Dataset, tmp_path: Path, what: str) -> None:
    given, message = NO_ROWS[what]
    with pytest.raises(UsageError) as caught:
        dataset.export("article", tmp_path / "out", given)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("workers", [0, -1, "2", 1.0, True, None])
def test_a_number_of_workers_below_one_is_refused(
    dataset: Dataset, tmp_path: Path, workers: Any
) -> None:
    with pytest.raises(UsageError, match=r"workers: got .*, valid: an integer from 1"):
        dataset.export("article", tmp_path / "out", [0], workers=workers)
    assert list(tmp_path.iterdir()) == []


def test_a_store_that_is_named_twice_is_refused(
    dataset: Dataset, tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    (tmp_path / "link.zarr").symlink_to(dataset.path)
    for other in (dataset.path, tmp_path / "link.zarr", f"{dataset.path.parent}/./store.zarr"):
        code, _, err = run("export", dataset.path, other, tmp_path / "out", "--to", "article")
        assert code == 2
        assert "the store is named twice; name each store once" in err
        assert not (tmp_path / "out").exists()


def embedding(path: Path, sets: dict[str, bytes], **changes: Any) -> Dataset:
    """Write a store with object sets of these contents."""
    digits = {name: f"{content[0]:x}"[-1] * 64 for name, content in sets.items()}
    weights = dict.fromkeys(sets, 1.0)
    config = small_config(
        video_hz=5, clutter={"count": 2}, cameras=CAMERAS_OF_STORES,
        **({"object_sets": weights, "object_folders": digits} if sets else {}), **changes,
    )  # fmt: skip
    carried = {f"objects/{name}": content for name, content in sets.items()}
    prepare_store(path, config, JOINTS, 4, {}, carried=carried)
    ZarrWriter(path).write_block(0, make_rows(config, 0, 4))
    return Dataset(path)


def test_what_any_of_the_stores_embeds_is_exported(tmp_path: Path) -> None:
    contents: list[dict[str, bytes]] = [{}, {"mine": b"1"}, {"mine": b"1", "yours": b"2"}]
    stores = [embedding(tmp_path / f"{k}.zarr", sets, seed=k) for k, sets in enumerate(contents, 1)]
    run_export(LINES, [(store, [0]) for store in stores], tmp_path / "out", {})
    found = tree(tmp_path / "out/grasp_factory_embedded")
    assert found == {"objects/mine": b"1", "objects/yours": b"2"}


def test_stores_that_embed_other_data_under_one_name_are_refused(tmp_path: Path) -> None:
    stores = [embedding(tmp_path / f"{k}.zarr", {"mine": b"%d" % k}, seed=k) for k in (1, 2)]
    with pytest.raises(UsageError) as caught:
        run_export(LINES, [(store, [0]) for store in stores], tmp_path / "out", {})
    assert str(caught.value) == (
        f"{stores[1].path}: objects/mine has another content than in {stores[0].path}: export the"
        " stores one by one"
    )
    assert not (tmp_path / "out").exists()


def test_a_shard_holds_names_of_any_length(tmp_path: Path) -> None:
    (front,) = cameras("front").values()
    store = make_store(tmp_path / "s.zarr", cameras={"n" * 64: front, "é" * 32: front})
    store.export("webdataset", tmp_path / "out", [0])
    with tarfile.open(tmp_path / "out/episodes-000000.tar") as tar:
        names = tar.getnames()
    for camera in ("n" * 64, "é" * 32):
        assert f"00000000.camera_{camera}_segmentation_before.png" in names


def test_shards_with_short_names_have_the_headers_of_ustar(
    tmp_path: Path, dataset: Dataset
) -> None:
    dataset.export("webdataset", tmp_path / "out", [0])
    with tarfile.open(tmp_path / "out/episodes-000000.tar") as tar:
        assert all(member.pax_headers == {} for member in tar.getmembers())
        offsets = [member.offset for member in tar.getmembers()]
        ends = [m.offset_data + -(-m.size // 512) * 512 for m in tar.getmembers()]
    assert offsets == [0, *ends[:-1]]


def test_a_format_that_is_not_offered_is_named_with_the_reason(
    dataset: Dataset, tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    code, _, err = run("export", dataset.path, tmp_path / "out", "--to", "rlbench")
    assert code == 2
    assert "format rlbench is not offered: its loader unpickles" in err
    assert "take robomimic or lerobot instead" in err
    with pytest.raises(UnknownNameError, match="rlbench is not offered"):
        dataset.export("rlbench", tmp_path / "out")
    assert "\n\nrlbench is not offered: its loader" in run("export", "--list")[1]
