"""Every store that was made of others says of which, and of which snapshots of them."""

from __future__ import annotations

import itertools
import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from support.fake_episodes import JOINTS, make_rows, small_config
from support.places import TINY

from grasp_factory.cli.main import cli
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.curation.merge import merge, split
from grasp_factory.curation.pack import pack_store
from grasp_factory.curation.relabel import relabel
from grasp_factory.curation.versions import provenance_tree, take_snapshot
from grasp_factory.curation.versions.origin import StoreState, read_origin, state_of, write_origin
from grasp_factory.curation.versions.provenance_tree import provenance_of
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryWarning, StoreError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=[16, 16])


def make_store(path: Path, seed: int = 0, n: int = 4) -> Path:
    config = replace(CONFIG, seed=seed)
    prepare_store(path, config, JOINTS, n, {})
    for block in range(-(-n // 4)):
        ZarrWriter(path).write_block(block, make_rows(config, block, n))
    return path


def printed(path: Path) -> str:
    done = CliRunner().invoke(cli, ["provenance", str(path)])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two stores, one of them with a snapshot, and what was made of them."""
    folder = tmp_path_factory.mktemp("made")
    a, b = (make_store(folder / f"{name}.zarr", seed) for name, seed in (("a", 0), ("b", 5)))
    take_snapshot(a, "before the merge")
    merge([a, b], folder / "merged.zarr")
    split(folder / "merged.zarr", folder / "few.zarr", [0, 5])
    pack_store(folder / "merged.zarr", folder / "packed.zarr", 8)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "made"))


def test_a_merged_store_names_its_sources_and_their_snapshot(folder: Path) -> None:
    origin = read_origin(folder / "merged.zarr")
    assert origin is not None
    assert origin.what == "merge"
    assert [source.store for source in origin.sources] == ["a.zarr", "b.zarr"]
    names = [path.stem for path in (folder / "a.zarr.snapshots").glob("*.json")]
    assert [source.snapshot for source in origin.sources] == [*names, ""]


def test_the_tree_goes_down_to_what_was_generated(folder: Path) -> None:
    for name in ("few", "packed"):
        text = printed(folder / f"{name}.zarr")
        words = [line.strip().split(":")[0] for line in text.splitlines()]
        how = {"few": "split", "packed": "pack"}[name]
        assert words[0] == f"{name}.zarr"
        assert words[1].startswith(f"{how} by grasp-factory")
        assert words[2] == "merged.zarr"
        assert words[4:] == ["a.zarr", "generated", "b.zarr", "generated"]


def test_packing_keeps_the_rows_that_are_named(folder: Path) -> None:
    states = [state_of(folder / f"{name}.zarr") for name in ("merged", "packed")]
    assert states[0].rows_sha256 == states[1].rows_sha256


def test_sources_that_are_gone_are_still_named(folder: Path) -> None:
    rows = state_of(folder / "merged.zarr").rows_sha256
    for name in ("a", "b", "merged"):
        shutil.rmtree(folder / f"{name}.zarr")
    text = printed(folder / "few.zarr")
    assert f"merged.zarr: rows {rows[:12]}" in text
    assert "generated" not in text


def test_another_store_of_that_name_is_not_taken_for_the_source(folder: Path) -> None:
    shutil.rmtree(folder / "a.zarr")
    make_store(folder / "a.zarr", 77)
    assert printed(folder / "merged.zarr").count("generated") == 1


def test_a_store_that_has_grown_since_says_so(tmp_path: Path) -> None:
    merge([make_store(tmp_path / "part.zarr")], tmp_path / "whole.zarr")
    make_store(tmp_path / "whole.zarr", n=8)
    assert "added or changed since" in printed(tmp_path / "whole.zarr")


def test_labels_and_exports_are_part_of_it(tmp_path: Path) -> None:
    tiny = Path(shutil.copytree(TINY, tmp_path / "tiny.zarr"))
    relabel(tiny, "strict", LabelConfig(min_lift=0.08))
    assert "labels/strict, by relabel" in printed(tiny)
    Dataset(tiny).export("sequences", tmp_path / "out")
    text = printed(tmp_path / "out")
    assert "export as 'sequences'" in text
    assert "'tiny.zarr': config" in text


def test_a_training_names_its_rows(tmp_path: Path) -> None:
    named = {"path": "a.zarr", "config_sha256": "1" * 64, "rows_sha256": "2" * 64, "snapshot": ""}
    report = {"grasp_factory": "0.9.0", "store": named, "test": named}
    (tmp_path / "report.json").write_text(json.dumps(report))
    (tmp_path / "vision.safetensors").touch()
    for path in (tmp_path, tmp_path / "vision.safetensors"):
        assert f"store 'a.zarr': config {'1' * 12}, rows {'2' * 12}" in printed(path)


def test_a_forged_origin_is_refused_in_a_line(folder: Path) -> None:
    file = folder / "merged.zarr.origin.json"
    plain = json.loads(file.read_text())
    for change in (
        {"what": "magic"},
        *(
            {"sources": [plain["sources"][0] | {"store": n}]}
            for n in ("../../etc", ".", "..", "\0")
        ),
        {"rows_sha256": "x"},
        {"more": 1},
    ):
        file.write_text(json.dumps(plain | change))
        with pytest.raises(StoreError, match="does not say what a store was made of"):
            provenance_of(folder / "merged.zarr")


@pytest.mark.parametrize(
    ("name", "key"), [("grasp_factory.json", "stores"), ("report.json", "store")]
)
def test_a_file_that_names_too_many_stores_is_refused(tmp_path: Path, name: str, key: str) -> None:
    (tmp_path / name).write_text(json.dumps({key: [{}] * 10_001}))
    with pytest.raises(UsageError, match=r"got 10001, valid: up to 10000"):
        provenance_of(tmp_path)


def test_stores_that_name_each_other_end(tmp_path: Path) -> None:
    a, b = (make_store(tmp_path / f"{name}.zarr") for name in "ab")
    write_origin(a, "merge", [state_of(b), state_of(b)])
    write_origin(b, "merge", [state_of(a), state_of(a)])
    assert len(list(provenance_of(a).lines())) == 7


def test_a_store_that_is_named_often_is_read_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, read = folder / "merged.zarr.origin.json", []
    plain = json.loads(file.read_text())
    plain["sources"] = [plain["sources"][0] | {"rows_sha256": "0" * 64}] * 1000
    file.write_text(json.dumps(plain))

    def counted(path: Path) -> StoreState:
        read.append(path.name)
        return state_of(path)

    monkeypatch.setattr(provenance_tree, "state_of", counted)
    assert len(list(provenance_of(folder / "merged.zarr").lines())) == 1002
    assert read == ["merged.zarr", "a.zarr"]


def test_a_long_chain_of_stores_is_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provenance_tree, "DEEPEST", 2)
    chain = [make_store(tmp_path / f"{name}.zarr") for name in "abcd"]
    for store, source in itertools.pairwise(chain):
        write_origin(store, "merge", [state_of(source)])
    lines = list(provenance_of(chain[0]).lines())
    assert [line.count("  ") for line in lines] == [0, 1, 2, 3, 4]


def test_another_file_of_that_name_is_left_alone(tmp_path: Path) -> None:
    part = make_store(tmp_path / "part.zarr")
    (tmp_path / "whole.zarr.origin.json").write_text("my notes")
    with pytest.warns(GraspFactoryWarning, match="has no .origin.json beside it"):
        merge([part], tmp_path / "whole.zarr")
    assert (tmp_path / "whole.zarr.origin.json").read_text() == "my notes"


def test_a_link_of_that_name_is_not_followed(tmp_path: Path) -> None:
    part = make_store(tmp_path / "part.zarr")
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "whole.zarr.origin.json").symlink_to(tmp_path / "mine")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GraspFactoryWarning)
        merge([part], tmp_path / "whole.zarr")
    assert (tmp_path / "mine").read_text() == "mine"


def test_what_says_nothing_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not say what it was made of"):
        provenance_of(tmp_path)
    with pytest.raises(UsageError, match="there is nothing at"):
        provenance_of(tmp_path / "nothing")
