"""Everything that reads a store works on real episodes, alone and merged with simulated ones.

Every row of ``EXPORTERS`` is tested, so a new exporter is too.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from support.grasp_sessions import SIZE
from support.mixed_stores import REAL_ROW, SIMULATED, MixedStores, make_mixed_stores

from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.image_files import KINDS
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.core.enums import UNKNOWN, label_names, word_of
from grasp_factory.curation.restore import restore
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import fresh
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters import EXPORTERS, Exporter
from grasp_factory.writers.exporters.exporting import Exported, run_export

pytestmark = pytest.mark.slow

Run = Callable[..., tuple[int, str, str]]
SETTINGS: dict[str, Any] = {"camera": "front"}
"""For the exporters that have them."""
PAGES = (
    "/api/episodes",
    "/api/episode/{at}",
    "/api/series/{at}",
    "/thumb/{at}.jpg",
    "/cloud/{at}/0",
    *(f"/image/{{at}}/front/{kind}/1.png" for kind in KINDS),
)


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> MixedStores:
    return make_mixed_stores(tmp_path_factory.mktemp("mixed"))


def export(exporter: Exporter, store: Path, out: Path) -> Exported:
    dataset = Dataset(store, checked=True)
    names = {field.name for field in dataclasses.fields(exporter.parameters)}
    settings = {name: value for name, value in SETTINGS.items() if name in names}
    return run_export(exporter, [(dataset, dataset.committed.tolist())], out, settings)


def lines_of(out: Path) -> list[dict[str, Any]]:
    text = (out / "grasp_factory_episodes.jsonl").read_text()
    return [json.loads(line) for line in text.splitlines()]


@pytest.mark.parametrize("name", EXPORTERS)
class TestEveryExporter:
    def test_it_writes_real_rows_or_says_why_not(
        self, name: str, stores: MixedStores, tmp_path: Path
    ) -> None:
        found = export(EXPORTERS[name], stores.both, tmp_path / "out")
        assert found.episodes + sum(found.excluded.values()) == 4
        record = json.loads((tmp_path / "out" / "grasp_factory.json").read_text())
        lost = [row for rows in record["excluded"].values() for _, row in rows]
        written = {line["row"]: line for line in lines_of(tmp_path / "out")}
        assert sorted([*lost, *written]) == [0, 1, 2, 3]
        if REAL_ROW in written:
            columns = written[REAL_ROW]["columns"]
            assert (columns["source"], columns["operator"]) == ("real", "op1")
            assert columns["collision_body"] is None
            assert columns["label_operator"] == "success"
            assert columns["grasp_position"] == [None] * 3

    def test_without_simulated_rows_it_writes_or_is_refused_in_one_line(
        self, name: str, stores: MixedStores, tmp_path: Path
    ) -> None:
        try:
            found = export(EXPORTERS[name], stores.alone, tmp_path / "out")
        except UsageError as error:
            assert str(error).startswith(f"{name} can hold none of 2 episodes (2: ")
            assert "\n" not in str(error)
            assert not (tmp_path / "out").exists()
        else:
            assert found.episodes == 2

    def test_every_array_of_real_episodes_is_written_or_left_out_for_a_reason(
        self, name: str, stores: MixedStores
    ) -> None:
        fields = Dataset(stores.both).features.values()
        assert EXPORTERS[name].contents.not_mentioned(fields) == []


@pytest.mark.parametrize("name", [name for name, row in EXPORTERS.items() if row.read_back])
def test_what_is_read_back_is_what_was_written(
    name: str, stores: MixedStores, tmp_path: Path
) -> None:
    export(EXPORTERS[name], stores.both, tmp_path / "out")
    found = restore(tmp_path / "out", tmp_path / "back.zarr")
    assert found.episodes == 4
    if not found.not_held:
        assert found.same == 4
    before, after = Dataset(stores.both)[REAL_ROW], Dataset(found.path)[REAL_ROW]
    wanted, got = before.contents(), after.contents()
    lost = {path.partition("/")[0] for path in found.not_held}
    for path in wanted.keys() - set(found.not_held):
        is_count = path.startswith("episodes/n_") and wanted[path] != got[path]
        if is_count:
            assert got[path] == 0
            assert lost
            continue
        if path.endswith("/depth"):  # as text or in whole millimetres
            np.testing.assert_allclose(got[path], np.nan_to_num(wanted[path]), atol=6e-4)
        else:
            np.testing.assert_array_equal(got[path], wanted[path], err_msg=path)


def test_a_word_is_none_where_nothing_was_measured() -> None:
    words = label_names(2)
    assert [word_of(code, words) for code in range(len(words))] == words
    assert word_of(UNKNOWN, words) is None
    with pytest.raises(IndexError):
        word_of(len(words), words)


def test_stores_with_and_without_room_for_real_episodes_are_not_exported_together(
    stores: MixedStores, tmp_path: Path
) -> None:
    chosen = [(Dataset(path), [0]) for path in (stores.simulated, stores.real)]
    with pytest.raises(UsageError, match=r"room for real episodes: got .*valid: 'none'"):
        run_export(EXPORTERS["webdataset"], chosen, tmp_path / "out", {})


@pytest.mark.parametrize("kind", ["both", "alone"])
@pytest.mark.parametrize("command", ["sheet", "plot", "card", "rerun", "info", "verify", "query"])
def test_every_picture_and_report_shows_real_rows(
    stores: MixedStores, run: Run, tmp_path: Path, kind: str, command: str
) -> None:
    if command == "rerun":
        pytest.importorskip("rerun")
    store = getattr(stores, kind)
    row = REAL_ROW if kind == "both" else 1
    more: dict[str, list[object]] = {
        "sheet": [tmp_path / "a.png"],
        "plot": [row, tmp_path / "a.png"],
        "card": ["--out", tmp_path / "card"],
        "rerun": [row, "--out", tmp_path / "a.rrd"],
        "query": ["--where", "source=real", "--json"],
    }
    code, _, err = run(command, store, *more.get(command, []))
    assert code == 0, err
    assert "Warning" not in err
    if command == "card":
        assert "recorded" in (tmp_path / "card" / "README.md").read_text()


def test_the_page_shows_real_rows(stores: MixedStores, tmp_path: Path) -> None:
    with fresh([stores.both, stores.alone], tmp_path / "index.sqlite") as index:
        app = create_app(index, "", {"localhost"}, thumbnails=Thumbnails(tmp_path))
        client = app.test_client()
        for page in PAGES:
            for store, row in ((0, 0), (0, REAL_ROW), (1, 1)):
                answer = client.get(page.format(at=f"{store}/{row}"))
                assert answer.status_code == 200, (page, answer.data)
        told = json.loads(client.get(f"/api/episode/0/{REAL_ROW}").data)
        series = json.loads(client.get(f"/api/series/0/{REAL_ROW}").data)
        points = client.get(f"/cloud/0/{REAL_ROW}/0").data
    assert told["columns"]["operator"] == "op1"
    assert told["cameras"]["front"]["intrinsics"][0] == [None] * 3
    assert {group["key"] for group in series["groups"]} >= {"gripper_width", "wrist_force"}
    assert not {group["key"] for group in series["groups"]} & {"pad_force", "object_height"}
    assert (series["phases"], series["tactile"]) == ([], None)
    assert "The arm is not drawn" in series["links"]["note"]
    assert np.frombuffer(points[:4], "<u4") == 0


def test_a_part_of_a_mixed_store_is_a_store(stores: MixedStores, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "part.zarr"
    code, _, err = run("split", stores.both, out, "--where", "source=real")
    assert code == 0, err
    assert verify(out).problems == ()
    assert len(Dataset(out)) == 2


def test_points_without_a_calibration_are_refused_in_one_line(stores: MixedStores) -> None:
    dataset = Dataset(stores.both)
    assert len(dataset.point_cloud(0))
    with pytest.raises(UsageError, match=rf"episode {REAL_ROW} is real, and its camera front has"):
        dataset.point_cloud(REAL_ROW)
    assert np.isnan(dataset.calibration(REAL_ROW, "front", 0)[0]).all()
    assert dataset.image(REAL_ROW, "front", "rgb", 0).shape == (*SIZE, 3)


FOUND: dict[str, tuple[int, ...]] = {
    "recording~ses": (2, REAL_ROW),
    "started>1700000000.5": (REAL_ROW,),
    "duration=3.9": (REAL_ROW,),
    "recorded_duration>1": (REAL_ROW,),
    "recorded_scenario=kitchen": (2, REAL_ROW),
    "task=pick": (2, REAL_ROW),
    "success=true": (REAL_ROW,),
    "weather=rain": (2, REAL_ROW),
    "operator=op1": (2, REAL_ROW),
    "recorded_sensor_setup~tripod": (2, REAL_ROW),
    "data_quality=3": (REAL_ROW,),
    "created_at<2000": (),
    "file_size_mb<0": (),
    "label_operator=no_contact": (2,),
    "source=simulated": tuple(range(SIMULATED)),
}


@pytest.mark.parametrize("condition", FOUND)
def test_each_column_of_an_index_of_bags_can_be_queried(
    stores: MixedStores, run: Run, condition: str
) -> None:
    code, out, err = run("query", stores.both, "--where", condition, "--json")
    assert code == 0, err
    assert {row["row"] for row in json.loads(out)["rows"]} == set(FOUND[condition])


def test_tags_of_real_rows_can_be_queried(stores: MixedStores, run: Run, tmp_path: Path) -> None:
    copy = tmp_path / "both.zarr"
    shutil.copytree(stores.both, copy)
    assert run("tag", copy, "--episodes", REAL_ROW, "--add", "wet")[0] == 0
    _, out, _ = run("query", copy, "--where", "tags=wet", "--json")
    assert [row["row"] for row in json.loads(out)["rows"]] == [REAL_ROW]


def test_more_rows_are_not_generated_into_real_ones(
    stores: MixedStores, run: Run, tmp_path: Path
) -> None:
    code, _, err = run("generate", "--n", 8, "--out", stores.both)
    assert (code, err.count("Error: "), err.splitlines()[-1][:7]) == (2, 1, "Error: ")
    assert "was put together from other stores" in err
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump(Dataset(stores.alone).config.to_plain()))
    code, _, err = run("generate", "--config", config, "--n", 8, "--out", stores.alone)
    assert (code, err.count("Error: "), err.splitlines()[-1][:7]) == (2, 1, "Error: ")
    assert "holds real episodes: generate into another store" in err
