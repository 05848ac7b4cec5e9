"""What `info` tells: counts that are those of the rows, in tables that stay short."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from support.elsewhere import HERE, THERE, set_texts
from support.fake_episodes import JOINTS, make_rows, small_config
from support.stored import old_store

from grasp_factory.apps.card import markdown
from grasp_factory.cli.main import cli
from grasp_factory.cli.store_report import BAR, GROUPS, MOST_ROWS, store_text
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.text_format import bar
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import StoreSummary, Tally, summarise
from grasp_factory.factory import generate
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

CONFIG = small_config()


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen rows, of which 2 is quarantined; three families, two policies."""
    path = tmp_path_factory.mktemp("info") / "ds.zarr"
    prepare_store(path, CONFIG, JOINTS, 14, {})
    for block in range(4):
        rows = make_rows(CONFIG, block, 14, quarantined=(2,))
        changed = []
        for i, row in enumerate(rows):
            if not hasattr(row, "columns"):
                changed.append(row)
                continue
            words = {"object_family": ("box", "mug", "cup")[(block + i) % 3],
                     "policy": ("a", "b")[i % 2]}  # fmt: skip
            changed.append(dataclasses.replace(row, columns=dict(row.columns) | words))
        ZarrWriter(path).write_block(block, changed)
    return path


def test_families_are_counted_policy_by_policy(store: Path) -> None:
    dataset, found = Dataset(store), summarise(Dataset(store))
    rows = dataset.committed
    family, policy, success = (
        dataset.column(name)[rows].tolist() for name in ("object_family", "policy", "success")
    )
    assert {k: t.episodes for k, t in found.families.items()} == Counter(family)
    assert sum(t.successes for t in found.families.values()) == sum(success)
    assert len(found.families) == 3
    for name, by_policy in found.families_by_policy.items():
        for word, tally in by_policy.items():
            mine = [s for f, p, s in zip(family, policy, success, strict=True)
                    if (f, p) == (name, word)]  # fmt: skip
            assert (tally.episodes, tally.successes) == (len(mine), sum(mine))
            assert tally.success_rate == pytest.approx(np.mean(mine), abs=1e-4)
        assert sum(t.episodes for t in by_policy.values()) == found.families[name].episodes


def test_what_people_say_is_counted(store: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    assert summarise(Dataset(copy)).annotated == 0
    log = AnnotationLog(copy)
    log.append("anna", [0, 1, 3], [("tag", "odd")])
    log.append("anna", [1], [("tag", "keep"), ("outcome", "success")])
    log.append("anna", [3], [("untag", "odd")])
    found = summarise(Dataset(copy))
    assert (found.annotated, found.corrected) == (2, 1)
    assert found.tags == {"odd": 2, "keep": 1}
    text = store_text(found, GROUPS)
    assert "2 rows annotated by people, 1 with a corrected label" in text
    assert re.search(r"^odd +2$", text, re.MULTILINE)
    assert "annotated" not in store_text(summarise(Dataset(store)), GROUPS)


def test_a_store_of_before_there_were_families_goes_without(store: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    shutil.rmtree(copy / "episodes/object_family")
    found = summarise(Dataset(copy))
    assert (found.families, found.families_by_policy) == ({}, {})
    assert found.policies == summarise(Dataset(store)).policies
    assert "object family" not in store_text(found, GROUPS)


def test_the_command_prints_the_tables_and_their_numbers(store: Path) -> None:
    text = CliRunner().invoke(cli, ["info", str(store), "--full"]).output
    facts = json.loads(CliRunner().invoke(cli, ["info", str(store), "--json"]).output)
    for family, tally in facts["families"].items():
        line = re.search(rf"^{family} +(\d+) +([\d.]+) %(.*)$", text, re.MULTILINE)
        assert line
        assert int(line[1]) == tally["episodes"]
        assert float(line[2]) == pytest.approx(100 * tally["success_rate"], abs=0.06)
        counts = [int(n) for n in re.findall(r"(\d+) +[\d.]+ %", line[3])]
        by_policy = facts["families_by_policy"][family]
        assert counts == [t["episodes"] for _, t in sorted(by_policy.items())]


def summary(families: dict[str, int], outcomes: dict[str, int]) -> StoreSummary:
    """Return a summary of so many episodes of each family, every third of them a success."""
    tallies = {f: Tally(episodes=n, successes=n // 3, success_rate=(n // 3) / n)
               for f, n in families.items()}  # fmt: skip
    committed = sum(outcomes.values())
    return StoreSummary(
        path="x.zarr", episodes=committed, committed=committed, quarantined=0, missing=0,
        successes=0, success_rate=0.0,
        policies={"a": Tally(episodes=committed, successes=0, success_rate=0.0)},
        outcomes=outcomes, families=tallies, families_by_policy={f: {} for f in families},
        object_sets={}, splits={}, quality={}, annotated=0, corrected=0, tags={}, bytes=0,
        bytes_per_episode=None, platforms={},
    )  # fmt: skip


@given(st.lists(st.integers(1, 999), min_size=1, max_size=60))
def test_the_families_stay_a_short_list_that_leaves_no_episode_out(counts: list[int]) -> None:
    families = {f"family_{i}": n for i, n in enumerate(counts)}
    text = store_text(summary(families, {"success": sum(counts)}), ["object family"])
    lines = text.split("\n\n")[1].splitlines()[1:]
    assert len(lines) == min(len(counts), MOST_ROWS) + (len(counts) > MOST_ROWS)
    listed = [int(line.split()[1]) for line in lines[:MOST_ROWS]]
    assert listed == sorted(counts, reverse=True)[:MOST_ROWS]
    if len(counts) > MOST_ROWS:
        found = re.match(r"and (\d+) more: (\d+) episodes?,", lines[-1])
        assert found
        assert (int(found[1]), int(found[2])) == (
            len(counts) - MOST_ROWS,
            sum(counts) - sum(listed),
        )


def test_an_outcomes_share_is_a_number_and_a_bar() -> None:
    text = store_text(summary({}, {"success": 30, "collision": 9, "no_plan": 1}), ["outcome"])
    assert re.search(rf"^success +30 +75\.0 %  #{{{round(0.75 * BAR)}}}$", text, re.MULTILINE)
    assert re.search(r"^no_plan +1 +2\.5 %  #$", text, re.MULTILINE)


@given(st.floats(0.0, 1.0), st.integers(1, 80))
def test_a_bar_is_seen_unless_there_is_nothing(share: float, width: int) -> None:
    drawn = bar(share, width)
    assert set(drawn) <= {"#"}
    assert bool(drawn) is (share > 0.0)
    assert abs(len(drawn) - share * width) <= 1.0


def test_a_store_without_episodes_has_its_tables(tmp_path: Path) -> None:
    prepare_store(tmp_path / "empty.zarr", CONFIG, JOINTS, 3, {})
    text = store_text(summarise(Dataset(tmp_path / "empty.zarr")), GROUPS)
    assert "3 of 3 episodes are missing" in text
    assert "outcome  episodes  share" in text


class TestPlatforms:
    def test_the_fingerprint_is_told(self, tmp_path: Path, run: Any) -> None:
        store = generated(tmp_path)
        code, out, _ = run("info", store, "--full")
        assert code == 0
        assert str(HERE) in out
        assert "platforms" not in out
        told = json.loads(run("info", store, "--json")[1])
        assert told["attributes"]["fingerprint"] == HERE.parts()
        assert told["platforms"] == {str(HERE): 3}
        assert set(told["attributes"]["platform"]) == {
            *("machine", "libc", "cpu", "level", "kernels")
        }

    def test_rows_of_several_platforms_are_counted(self, tmp_path: Path, run: Any) -> None:
        store = generated(tmp_path)
        set_texts(store, {1: THERE.text})
        out = run("info", store)[1]
        assert "made on 2 platforms" in out
        assert f"  2 rows on {HERE}\n  1 row on {THERE}\n" in out

    def test_a_dataset_card_names_them_with_their_rows(self, tmp_path: Path, run: Any) -> None:
        store, card = generated(tmp_path), tmp_path / "card"
        assert run("card", store, "--out", card)[0] == 0
        text = (card / "README.md").read_text(encoding="utf-8")
        assert markdown.word(str(HERE)) in text
        assert "several platforms" not in text
        assert "on any other whose fingerprint is the same" in text
        set_texts(store, {1: THERE.text})
        assert run("card", store, "--out", card)[0] == 0
        text = (card / "README.md").read_text(encoding="utf-8")
        assert "made on several platforms" in text
        assert f"| 1 | {markdown.word(str(THERE))} |" in text

    def test_a_store_of_a_version_without_fingerprints_has_none(
        self, tmp_path: Path, run: Any
    ) -> None:
        code, out, _ = run("info", old_store(tmp_path))
        assert code == 0
        assert "fingerprint" not in out
        told = json.loads(run("info", tmp_path / "old.zarr", "--json")[1])
        assert told["platforms"] == {}


def generated(folder: Path) -> Path:
    """Return a new store of three rows."""
    config = FactoryConfig(resolution=(32, 24), block_size=4)
    generate.generate(config, 3, folder / "ds.zarr", workers=1)
    return folder / "ds.zarr"
