"""Parts of a store in object storage, made by machines that share nothing else."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_episodes import make_episode, small_config
from support.object_server import ObjectServer

from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.object_storage import put_once as putting
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.object_storage.put_once import PROBE
from grasp_factory.curation.upload import generate_there, stages
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import AccessRefusedError, StoreMismatchError
from grasp_factory.factory import block_maker
from grasp_factory.factory.generate import generate
from grasp_factory.factory.platform_check import check_same_platform
from grasp_factory.factory.run_records import Summary
from grasp_factory.factory.run_request import Request, Shard
from grasp_factory.writers.zarr import header

pytest.importorskip("obstore")

CONFIG = small_config(block_size=8)
N = 40
"""With two parts, blocks of 8 are joined to blocks of 16; the last has a half."""
NAME = "data/parts.zarr"
ADDRESS = f"s3://bucket/{NAME}"


def pretend(world: Any, spec: Any) -> Any:
    """Return an episode that follows from its recipe, without physics."""
    return dataclasses.replace(make_episode(CONFIG, spec.index), spec=spec)


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_maker, "run_episode", pretend)
    monkeypatch.setattr(stages, "BLOCKS_OF_A_PART", 1)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[ObjectServer]:
    found = ObjectServer()
    found.set_environment(monkeypatch)
    monkeypatch.setattr(putting, "FIRST_PAUSE_S", 0.001)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    yield found
    found.close()


def make(request: Request) -> Summary:
    return generate(request.config, request.n, request.out, workers=1, shard=request.shard)


def request_of(shard: Shard) -> Request:
    return Request(config=CONFIG, n=N, out=store_path(ADDRESS), shard=shard)


def dead_after(puts: int) -> Callable[[str, str], str]:
    """Return a fault: the server refuses all that comes after a number of PUTs."""
    count = 0

    def fault(method: str, key: str) -> str:
        nonlocal count
        count += method == "PUT"
        return "403 Dead" if count > puts else ""

    return fault


def make_part(shard: Shard) -> Summary:
    """Make a part of the store as a machine would that has nothing of the others."""
    return generate_there(request_of(shard), make, check_same_platform)


def objects_of(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file())
    named = {f"{NAME}/{file.relative_to(folder)}": file.read_bytes() for file in files}
    return named | {f"{NAME}/{PROBE}": b"1"}


def rows_there() -> list[int]:
    return Dataset(ADDRESS).committed.tolist()


def waiting(folder: Path) -> list[Path]:
    """Return what waits in the cache to be sent."""
    uploads = folder / "cache" / "uploads"
    return list(uploads.iterdir()) if uploads.is_dir() else []


def test_all_parts_are_the_store_of_one_run_in_larger_blocks(
    server: ObjectServer, tmp_path: Path
) -> None:
    assert make_part(Shard(2, 2)).asked == 24
    assert rows_there() == [*range(16), *range(32, 40)]
    assert make_part(Shard(1, 2)).made == 16
    generate(dataclasses.replace(CONFIG, block_size=16), N, tmp_path / "direct.zarr", workers=1)
    assert server.objects == objects_of(tmp_path / "direct.zarr")
    assert not list((tmp_path / "cache" / "uploads").iterdir())


def test_a_part_that_is_there_is_not_made_again(server: ObjectServer) -> None:
    make_part(Shard(1, 2))
    again = generate_there(request_of(Shard(1, 2)), never, check_same_platform)
    assert (again.asked, again.made, again.already_there) == (16, 0, 16)
    assert again.store.path == ADDRESS


def test_a_part_has_blocks_of_the_size_that_is_there(server: ObjectServer) -> None:
    make_part(Shard(1, 2))
    make_part(Shard(0, 5))  # by itself it would have blocks of 8
    assert rows_there() == list(range(32))


def test_a_part_that_was_killed_while_it_was_sent_goes_on(server: ObjectServer) -> None:
    make_part(Shard(0, 2))
    with server.faulty(dead_after(120)), pytest.raises(AccessRefusedError):
        make_part(Shard(1, 2))
    assert rows_there() == [*range(16), *range(32, 40)]
    assert make_part(Shard(1, 2)).made == 0
    assert rows_there() == list(range(N))


def test_a_part_begins_again_if_others_begin_with_blocks_of_another_size(
    server: ObjectServer, tmp_path: Path
) -> None:
    def make_while_another_begins(request: Request) -> Summary:
        if not server.objects.keys() - {f"{NAME}/{PROBE}"}:
            make_part(Shard(1, 2))
        return make(request)

    found = generate_there(request_of(Shard(4, 5)), make_while_another_begins, check_same_platform)
    assert (found.asked, rows_there()) == (0, list(range(16, 32)))
    assert not list((tmp_path / "cache" / "uploads").iterdir())


def test_what_was_made_for_another_length_is_not_sent(server: ObjectServer) -> None:
    longer = dataclasses.replace(request_of(Shard(1, 2)), n=2 * N)
    with server.faulty(dead_after(2)), pytest.raises(AccessRefusedError):
        generate_there(longer, make, check_same_platform)
    make_part(Shard(1, 2))
    assert len(Dataset(ADDRESS)) == N


def test_what_another_machine_has_sent_is_removed_from_the_cache(
    server: ObjectServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with server.faulty(dead_after(2)), pytest.raises(AccessRefusedError):
        make_part(Shard(1, 2))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "other"))
    make_part(Shard(1, 2))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    assert list((tmp_path / "cache" / "uploads").iterdir())
    assert make_part(Shard(1, 2)).made == 0
    assert not list((tmp_path / "cache" / "uploads").iterdir())


class TestStages:
    @pytest.fixture(autouse=True)
    def small(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(stages, "STAGE", 16)
        monkeypatch.setattr(stages, "LARGEST", 16)

    @pytest.mark.parametrize(("shard", "sizes"), [(Shard(1, 1), [24, 16]), (Shard(2, 2), [24])])
    def test_of_a_large_part_are_sent_one_by_one(
        self, server: ObjectServer, tmp_path: Path, shard: Shard, sizes: list[int]
    ) -> None:
        before = []

        def watched(request: Request) -> Summary:
            before.append((len(rows_there()) if before else 0, len(waiting(tmp_path))))
            return make(request)

        sent: list[int] = []
        found = generate_there(request_of(shard), watched, check_same_platform, sent.append)
        assert (sent, before) == (sizes, [(0, 1), (24, 1)][: len(sizes)])
        assert (found.asked, found.made, found.already_there) == (sum(sizes), sum(sizes), 0)
        assert not waiting(tmp_path)

    def test_make_the_store_of_one_run(self, server: ObjectServer, tmp_path: Path) -> None:
        make_part(Shard(0, 1))
        generate(dataclasses.replace(CONFIG, block_size=16), N, tmp_path / "direct.zarr", workers=1)
        assert server.objects == objects_of(tmp_path / "direct.zarr")

    def test_that_are_there_are_not_made_on_another_machine(
        self, server: ObjectServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def dies_later(request: Request) -> Summary:
            if request.shard.index == 1:
                raise KeyboardInterrupt
            return make(request)

        with pytest.raises(KeyboardInterrupt):
            generate_there(request_of(Shard(0, 1)), dies_later, check_same_platform)
        assert len(rows_there()) == 24
        monkeypatch.setenv(VARIABLE, str(tmp_path / "other"))
        found = make_part(Shard(0, 1))
        assert (found.asked, found.made, found.already_there) == (N, 16, 24)
        assert rows_there() == list(range(N))

    def test_end_with_the_first_that_has_too_many_failures(self, server: ObjectServer) -> None:
        def fails(request: Request) -> Summary:
            return dataclasses.replace(make(request), failed=True)

        found = generate_there(request_of(Shard(0, 1)), fails, check_same_platform)
        assert (found.failed, found.asked) == (True, 24)
        assert all(key.endswith(PROBE) for key in server.objects)


@pytest.mark.parametrize("parts", [1, 2, 3, 7, 4000])
@pytest.mark.parametrize("n", [1, 8192, 16384, 100_003])
def test_the_stages_of_all_parts_are_all_rows_once(n: int, parts: int) -> None:
    found = []
    for index in range(parts) if parts < 10 else (0, 1, parts):
        asked = dataclasses.replace(request_of(Shard(index, parts)), n=n)
        rows = [stages.rows_of(stage, 512) for stage in stages.stages_of(asked, 512)]
        assert sorted(np.concatenate(rows)) == stages.rows_of(asked, 512).tolist()
        assert len(rows) == 1 or min(map(len, rows)) >= stages.STAGE // 2
        found += rows
    if parts < 10:
        assert sorted(np.concatenate(found)) == list(range(n))


def test_more_parts_than_blocks_leave_some_with_nothing_to_do(server: ObjectServer) -> None:
    made = [make_part(Shard(k, 6)) for k in (4, 5)]
    assert [each.asked for each in made] == [8, 0]
    assert rows_there() == list(range(32, 40))


def test_a_machine_with_another_processor_that_makes_the_same_bytes_takes_part(
    server: ObjectServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_part(Shard(0, 2))
    begun = Dataset(ADDRESS).attributes
    monkeypatch.setattr(header, "platform_facts", lambda: {"cpu": "another"})
    make_part(Shard(1, 2))
    assert rows_there() == list(range(N))
    assert Dataset(ADDRESS).attributes == begun


def test_a_machine_that_makes_other_bytes_is_refused_before_it_begins(
    server: ObjectServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_part(Shard(0, 2))
    root, libm = f"{NAME}/zarr.json", Dataset(ADDRESS).attributes["fingerprint"]["libm"]
    server.objects[root] = server.objects[root].replace(libm.encode(), b"00000000")
    with pytest.raises(StoreMismatchError, match=r"was begun on another platform.*read both"):
        generate_there(request_of(Shard(1, 2)), never, check_same_platform)


def never(request: Request) -> Summary:
    raise AssertionError
