"""Stores that are made of exports again: every array that the format holds is equal."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.exporter_contract import QUARANTINED, N, make_store
from support.stored import old_store, varied

from grasp_factory.cli.main import cli
from grasp_factory.core.limits import VARIABLE
from grasp_factory.curation.restore import restore
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError, LimitError, StoreError, UsageError
from grasp_factory.writers.exporters import EXPORTERS
from grasp_factory.writers.exporters.exporting import run_export

READ_BACK: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name, exporter in EXPORTERS.items() if exporter.read_back),
    ("lerobot", {"video": "image"}),
    ("rosbag2", {"storage": "sqlite3"}),
]
"""Formats that can be imported, with settings."""
MM = 0.0005 + 1e-6
"""Half of a millimetre, and the rounding to float32."""
TOLERANCE = {("sequences", "depth"): MM}
"""Largest differences by format and array, m; other arrays are equal."""


@pytest.fixture(
    scope="module", params=READ_BACK, ids=lambda what: "-".join([what[0], *what[1].values()])
)
def restored(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Dataset, Dataset, tuple[str, ...]]:
    folder, dataset = tmp_path_factory.mktemp("restored"), Dataset(varied())
    name, settings = request.param
    dataset.export(name, folder / "export", **settings)
    found = restore(folder / "export", folder / "store.zarr")
    assert found.same == (len(dataset.committed) if name.startswith("rosbag") else 0)
    return name, dataset, Dataset(folder / "store.zarr", checked=True), found.not_held


def test_every_array_that_is_held_is_equal(
    restored: tuple[str, Dataset, Dataset, tuple[str, ...]],
) -> None:
    name, before, after, not_held = restored
    assert len(after) == len(before.committed)
    compared = 0
    for old, new in zip(before, after, strict=True):
        contents = new.contents()
        for path, values in old.contents().items():
            if path in not_held or path in LENGTHS:
                continue
            tolerance = TOLERANCE.get((name, path.rpartition("/")[2]), 0.0)
            if tolerance:
                assert np.abs(contents[path] - values).max() <= tolerance
            else:
                np.testing.assert_array_equal(contents[path], values, path, strict=True)
            compared += 1
    assert compared > 60


LENGTHS = {"episodes/n_steps", "episodes/n_imu", "episodes/n_video"}


def test_what_is_not_held_is_empty_and_listed(
    restored: tuple[str, Dataset, Dataset, tuple[str, ...]],
) -> None:
    _, _, after, not_held = restored
    assert after.attributes["imported"]["not_held"] == list(not_held)
    for episode in after:
        contents = episode.contents()
        for path in not_held:
            values, fill = contents[path], after.features[path].fill
            np.testing.assert_array_equal(values, np.full(values.shape, fill, values.dtype))


def test_the_store_is_whole(restored: tuple[str, Dataset, Dataset, tuple[str, ...]]) -> None:
    _, _, after, _ = restored
    assert [str(problem) for problem in verify(after.path).problems] == []


def test_verify_says_what_it_could_not_check(
    restored: tuple[str, Dataset, Dataset, tuple[str, ...]],
) -> None:
    name, _, after, not_held = restored
    notes = [note for note in verify(after.path).notes if "imported" in note]
    assert len(notes) == bool(not_held)
    for note in notes:
        assert note.startswith(
            f"the store was imported from '{name}', without {len(not_held)} of its"
        )


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("source")
    dataset = make_store(folder / "store.zarr")
    return dataset.export("sequences", folder / "export").path


def changed_record(**changes: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        file = folder / "grasp_factory.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | changes))

    return change


def changed_line(change: Callable[[dict], object]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        file = folder / "grasp_factory_episodes.jsonl"
        first, *others = file.read_text().splitlines()
        line = json.loads(first)
        change(line)
        file.write_text("\n".join([json.dumps(line), *others]))

    return apply


def replaced(name: str, content: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(content) and None


def link_to_a_secret(folder: Path) -> None:
    secret, file = folder.parent / "secret", folder / "sequences/000000_front/rgb/000000.png"
    secret.write_text("precious")
    file.unlink()
    file.symlink_to(secret)


def huge_png(folder: Path) -> None:
    file = folder / "sequences/000000_front/rgb/000000.png"
    data = file.read_bytes()
    file.write_bytes(data[:16] + (60_000).to_bytes(4, "big") * 2 + data[24:])


FRAMES = "sequences/000000_front/metadata.json"
CSV = "sequences/000000_front/robot/data.csv"
DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no record": (lambda folder: (folder / "grasp_factory.json").unlink(), "is no export"),
    "a record that is no JSON": (replaced("grasp_factory.json", b"{"), "is damaged"),
    "a record that is a list": (replaced("grasp_factory.json", b"[]"), "is no object"),
    "a record without all of it": (replaced("grasp_factory.json", b"{}"), "is damaged"),
    "a deep record": (replaced("grasp_factory.json", b"[" * 100_000), "damaged"),
    "a newer version": (changed_record(version=99), "install a newer one"),
    "an unknown format": (changed_record(format="sequence"), "did you mean 'sequences'"),
    "a format that cannot be read back": (
        changed_record(format="webdataset"),
        "cannot be imported",
    ),
    "another number of episodes": (changed_record(episodes=7), "lines for 7 episodes"),
    "more lines than episodes": (changed_record(episodes=1), "more lines than 1"),
    "no stores": (changed_record(stores=[]), "is damaged"),
    "stores of nonsense": (changed_record(stores=[{"attributes": 3}]), "is damaged"),
    "no lines": (replaced("grasp_factory_episodes.jsonl", b""), "has 0 lines"),
    "a line of nonsense": (replaced("grasp_factory_episodes.jsonl", b"\xff\n"), "is damaged"),
    "lines of the same episode": (
        changed_line(lambda line: line.update(episode=1)),
        "number the episodes from 0",
    ),
    "a number that is huge": (
        changed_line(lambda line: line.update(episode=10**30)),
        "number the episodes from 0",
    ),
    "no columns": (changed_line(lambda line: line.pop("columns")), "episode 0 is damaged"),
    "no recipe": (changed_line(lambda line: line["columns"].pop("spec")), "episode 0 is damaged"),
    "a recipe of nonsense": (
        changed_line(lambda line: line["columns"].update(spec={"seed": 1})),
        "episode 0 is damaged",
    ),
    "columns that are a list": (
        changed_line(lambda line: line.update(columns=[1])),
        "episode 0 is damaged",
    ),
    "a value that no number has room for": (
        changed_line(lambda line: line["columns"].update(lift_height=10**400)),
        "episode 0 is damaged",
    ),
    "half of a character": (
        changed_line(lambda line: line["columns"].update(policy="\ud800")),
        "episode 0 is damaged",
    ),
    "a fingerprint of half a character": (
        changed_line(lambda line: line.update(fingerprint="\ud800")),
        "episode 0 is damaged",
    ),
    "a fingerprint of 100,000 letters": (
        changed_line(lambda line: line.update(fingerprint="x" * 100_000)),
        "a text of 100,000 characters, valid: up to 65.5 kB",
    ),
    "a policy of 100,000 letters": (
        changed_line(lambda line: line["columns"].update(policy="x" * 100_000)),
        "a text of 100,000 characters",
    ),
    "a recipe of 100,000 letters": (
        changed_line(
            lambda line: line["columns"]["spec"].update(policy_parameters={"x": "x" * 100_000})
        ),
        "a text of 102,482 characters",
    ),
    "an unknown outcome": (
        changed_line(lambda line: line["columns"].update(outcome="victory")),
        "episode 0 is damaged",
    ),
    "a column of another shape": (
        changed_line(lambda line: line["columns"].update(grasp_position=[1, 2])),
        "grasp_position: got (2,), valid: (3,)",
    ),
    "an image that is a link": (link_to_a_secret, "is a link"),
    "an image that says it is huge": (huge_png, "no PNG file of 32 x 24 pixels"),
    "an image of nothing": (
        replaced("sequences/000000_front/rgb/000000.png", b""),
        "no PNG file of 32 x 24 pixels",
    ),
    "frames of nonsense": (replaced(FRAMES, b"[1]"), "episode 0 is damaged"),
    "no frames": (replaced(FRAMES, b"[]"), "episode 0 is damaged"),
    "a table of other columns": (replaced(CSV, b"a,b\n1,2\n"), "got the columns 'a,b'"),
    "a table of words": (
        lambda folder: (folder / CSV).write_text((folder / CSV).read_text() + "x,y\n"),
        "episode 0 is damaged",
    ),
    "a folder that is gone": (
        lambda folder: shutil.rmtree(folder / "sequences/000000_front"),
        "episode 0 is damaged",
    ),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_a_damaged_export_is_named_in_one_line_and_nothing_is_written(
    export: Path, tmp_path: Path, what: str
) -> None:
    damage, message = DAMAGES[what]
    folder = Path(shutil.copytree(export, tmp_path / "export"))
    damage(folder)
    with pytest.raises(GraspFactoryError) as caught:
        restore(folder, tmp_path / "store.zarr")
    text = str(caught.value)
    assert message in text
    assert str(folder) in text or "did you mean" in text
    assert "\n" not in text
    assert "precious" not in text
    assert not (tmp_path / "store.zarr").exists()


def test_all_rows_of_several_seeds_are_restored_with_their_origin(tmp_path: Path) -> None:
    stores = [make_store(tmp_path / f"{seed}.zarr", seed=seed) for seed in (3, 8)]
    chosen = [(stores[0], [5, 0]), (stores[1], [2])]
    run_export(EXPORTERS["sequences"], chosen, tmp_path / "export", {})
    found = restore(tmp_path / "export", tmp_path / "store.zarr")
    assert found.episodes == 3
    after = Dataset(tmp_path / "store.zarr")
    assert after.column("seed").tolist() == [3, 3, 8]
    assert after.column("index").tolist() == [5, 0, 2]
    assert [source["seed"] for source in after.attributes["sources"]] == [3, 8]


def test_a_store_of_an_old_version_is_restored(tmp_path: Path) -> None:
    dataset = Dataset(old_store(tmp_path))
    dataset.export("sequences", tmp_path / "export")
    restore(tmp_path / "export", tmp_path / "store.zarr")
    after = Dataset(tmp_path / "store.zarr")
    assert set(after.features) == set(dataset.features)
    assert verify(after.path).problems == ()


def test_what_is_there_is_not_overwritten(export: Path, tmp_path: Path) -> None:
    (tmp_path / "store.zarr").write_text("mine")
    with pytest.raises(UsageError, match="exists, only new stores are made"):
        restore(export, tmp_path / "store.zarr")
    assert (tmp_path / "store.zarr").read_text() == "mine"


def test_quarantined_rows_are_not_in_an_export(export: Path, tmp_path: Path) -> None:
    found = restore(export, tmp_path / "store.zarr")
    assert found.episodes == N - 1
    after = Dataset(tmp_path / "store.zarr")
    assert QUARANTINED not in after.column("index")


def test_the_command_makes_a_store_of_an_export(
    export: Path, tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    code, out, err = run("import", export, tmp_path / "store.zarr")
    assert (code, err) == (0, "")
    head, lacks = out.splitlines()
    assert head.startswith(f"{tmp_path / 'store.zarr'}: {N - 1} episodes from sequences, 0 of them")
    assert lacks.startswith("not in the export, so empty: streams/tactile_position, ")
    code, _, err = run("import", export, tmp_path / "store.zarr")
    assert code == 2
    assert "exists, only new stores are made" in err


@pytest.mark.usefixtures("isolated")
def test_an_import_runs_in_a_process_with_limits(
    export: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "import-memory=1MiB")
    with pytest.raises(LimitError, match=r"the import needs more than 1\.0 MB of memory"):
        restore(export, tmp_path / "store.zarr")
    monkeypatch.delenv(VARIABLE)
    assert restore(export, tmp_path / "store.zarr").episodes == N - 1


def cut_short(file: str) -> Callable[[Path], object]:
    return lambda folder: (folder / file).write_bytes((folder / file).read_bytes()[:-100])


HURT: dict[str, tuple[str, Callable[[Path], object]]] = {
    "a Parquet file that is cut": ("lerobot", cut_short("data/chunk-000/file-000.parquet")),
    "no extras": ("lerobot", lambda f: (f / "extras/chunk-000/file-000.parquet").unlink()),
    "another Parquet file": (
        "lerobot",
        lambda f: shutil.copy(
            f / "meta/tasks.parquet", f / "data/chunk-000/file-000.parquet"
        ),
    ),
    "a bag that is cut": ("rosbag1", cut_short("000000.bag")),
    "no image": ("article", lambda f: (f / "rgb/before_0.png").unlink()),
    "an array of objects": (
        "article",
        lambda f: np.save(f / "seg/seg_before_0.npy", np.array([{}], object), allow_pickle=True),
    ),
    "an array of another shape": (
        "article", lambda f: np.save(f / "seg/seg_before_0.npy", np.zeros((3, 3), np.uint8))
    ),
    "an array that is cut": ("article", cut_short("depth/depth_after_0.npy")),
}  # fmt: skip


@pytest.mark.parametrize("what", HURT)
def test_damaged_data_of_a_format_is_named_in_one_line(tmp_path: Path, what: str) -> None:
    name, hurt = HURT[what]
    Dataset(varied()).export(name, tmp_path / "export")
    hurt(tmp_path / "export")
    with pytest.raises(StoreError) as caught:
        restore(tmp_path / "export", tmp_path / "store.zarr")
    assert str(caught.value).startswith(f"{tmp_path / 'export'}: episode 0 is damaged: ")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "store.zarr").exists()


def test_values_of_another_episode_are_counted_and_named(tmp_path: Path) -> None:
    export, out = tmp_path / "export", tmp_path / "store.zarr"
    Dataset(varied()).export("rosbag1", export)
    shutil.copy(export / "000001.bag", export / "000000.bag")
    said = CliRunner().invoke(cli, ["import", str(export), str(tmp_path / "first.zarr")]).output
    assert "\nepisodes that are not the same: 0\n" in said
    found = restore(export, out)
    assert (found.episodes, found.same, found.others) == (2, 1, (0,))
