"""A store that the nodes of a cluster make, and nodes that must not take part."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from support.fake_cluster import FakeCluster
from support.fake_episodes import JOINTS, small_config
from support.helpers import assert_same_tree
from support.scale import soak_only

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.executors import EXECUTORS, ExecutorKind
from grasp_factory.core.executors.cluster.coordinator import ClusterExecutor
from grasp_factory.core.platforms import Fingerprint
from grasp_factory.errors import StoreMismatchError
from grasp_factory.factory.generate import generate
from grasp_factory.factory.node_check import NodeCheck, node_check
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
CONFIG = dataclasses.replace(FactoryConfig(), resolution=(32, 24), block_size=1)
N = 3


@pytest.fixture(scope="module")
def want(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store that this process makes alone."""
    path = tmp_path_factory.mktemp("want") / "ds.zarr"
    generate(CONFIG, N, path, executor="inline")
    return path


@pytest.mark.parametrize("nodes", [2, *soak_only(1, 4, 0)])
def test_any_number_of_nodes_makes_the_bytes_of_one_process(
    tmp_path: Path, want: Path, monkeypatch: pytest.MonkeyPatch, nodes: int
) -> None:
    said: list[str] = []
    fake = ExecutorKind(
        name="fake",
        description="agents in threads of this process",
        make=lambda made: ClusterExecutor(partial(FakeCluster, *"abcd"[:nodes]), 1, made.tell),
        has_nodes=True,
    )
    monkeypatch.setitem(EXECUTORS, "fake", fake)
    monkeypatch.chdir(tmp_path)
    executor = "fake" if nodes else "local"
    generate(CONFIG, N, "ds.zarr", 1 if nodes else 2, executor=executor, on_node=said.append)
    assert_same_tree(want, tmp_path / "ds.zarr")
    assert len(said) == nodes
    assert sorted(os.listdir(tmp_path)) == ["ds.zarr", "ds.zarr.runs.jsonl"]


@pytest.fixture
def check(tmp_path: Path) -> Iterator[NodeCheck]:
    prepare_store(tmp_path / "ds.zarr", small_config(), JOINTS, 1, {})
    (tmp_path / "ds.zarr/.probe-0.partial").touch()  # of a killed run
    with node_check(tmp_path / "ds.zarr", small_config(), accept=False, is_alone=True) as made:
        yield made
    assert not list((tmp_path / "ds.zarr").glob(".probe*"))


def test_this_machine_is_a_node_that_may_work(check: NodeCheck) -> None:
    check()


def test_a_node_that_sees_another_disk_is_refused(check: NodeCheck, tmp_path: Path) -> None:
    prepare_store(tmp_path / "other.zarr", small_config(), JOINTS, 1, {})
    for path in (tmp_path / "other.zarr", tmp_path / "none.zarr"):
        with pytest.raises(StoreMismatchError, match=r"is not the same folder on .*: --exec"):
            dataclasses.replace(check, path=path)()


def test_a_node_with_other_versions_is_refused(check: NodeCheck) -> None:
    other = dataclasses.replace(check, versions={**check.versions, "numpy": "1.0"})
    with pytest.raises(StoreMismatchError, match=r"has numpy \S+, not 1\.0: install the same"):
        other()


def test_a_node_of_another_platform_is_refused_unless_that_is_accepted(check: NodeCheck) -> None:
    there = Fingerprint(engine="0" * 8, images="1" * 8, libm="2" * 8, arithmetic="3" * 8)
    other = dataclasses.replace(check, platform=there)
    with pytest.raises(StoreMismatchError, match="is another platform: the fingerprint differs in"):
        other()
    dataclasses.replace(other, accept_other_platform=True)()
