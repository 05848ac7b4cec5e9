"""Examples kept in a file that processes share: the same values, once read, and gone at the end."""

from __future__ import annotations

import errno
import gc
import multiprocessing
import os
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.places import TINY
from support.scale import soak_only
from torch.utils.data import DataLoader

from grasp_factory.apps.learning.example_cache import KeptInputs, runs_around
from grasp_factory.policies.networks import KINDS
from grasp_factory.torch import GraspDataset

SHAPES = {"image": (3, 4, 4), "width": (1,)}


def drawn(count: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(count)
    return {n: rng.random((count, *shape), dtype=np.float32) for n, shape in SHAPES.items()}


@given(st.lists(st.integers(0, 9), max_size=8), st.lists(st.integers(0, 9), min_size=1))
def test_what_was_kept_comes_back_and_nothing_else(put: list[int], asked: list[int]) -> None:
    kept, everything = KeptInputs(SHAPES, 10, 2**20), drawn(10)
    places = np.array(put, np.int64)
    kept.keep(places, {name: values[places] for name, values in everything.items()})
    inputs, found = kept.take(np.array(asked))
    assert found.tolist() == [place in put for place in asked]
    for name, values in inputs.items():
        assert (values[found] == everything[name][np.array(asked)][found]).all()


def test_what_does_not_fit_is_not_kept() -> None:
    size = 4 * (48 + 1) + 1
    kept, everything = KeptInputs(SHAPES, 10, 3 * size), drawn(10)
    kept.keep(np.arange(10), everything)
    assert kept.take(np.arange(10))[1].tolist() == [True] * 3 + [False] * 7
    assert os.path.getsize(kept._path) <= 3 * size


def test_what_one_process_reads_no_other_one_gets() -> None:
    kept, everything = KeptInputs(SHAPES, 10, 2**20), drawn(10)
    other = pickle.loads(pickle.dumps(kept))
    kept.keep(np.array([2]), {name: values[[2]] for name, values in everything.items()})
    assert kept.claim(np.arange(5)).tolist() == [0, 1, 3, 4]
    assert other.claim(np.arange(7)).tolist() == [5, 6]
    assert other.take(np.arange(10))[1].tolist() == [k == 2 for k in range(10)]
    assert kept.claim(np.array([9, 11])).tolist() == [9]


def test_without_space_for_the_file_nothing_is_read_to_be_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> tuple[int, str]:
        raise OSError(errno.ENOSPC, "no space")

    with monkeypatch.context() as patched:
        patched.setattr("tempfile.mkstemp", full)
        kept = KeptInputs(SHAPES, 10, 2**20)
    assert kept.claim(np.arange(10)).tolist() == []
    filled = KeptInputs(SHAPES, 10, 2**20)
    monkeypatch.setattr(os, "pwrite", full)
    assert filled.claim(np.arange(10)).tolist() == []


@pytest.mark.parametrize(("share", "order"), [(0.0, [0, 2, 4]), (0.5, [2, 4, 0]), (0.7, [4, 0, 2])])
def test_runs_around_positions_are_whole_and_begin_at_a_share(
    share: float, order: list[int]
) -> None:
    runs = runs_around(np.array([17, 1, 8, 3, 11]), 4, 18, share)
    assert [run[0] // 4 for run in runs] == order
    assert {len(run) for run in runs} == {4, 2}
    assert sorted(np.concatenate(runs).tolist()) == [0, 1, 2, 3, 8, 9, 10, 11, 16, 17]


def test_the_file_goes_with_its_maker_and_not_with_a_copy() -> None:
    kept = KeptInputs(SHAPES, 4, 2**20)
    kept.keep(np.arange(4), drawn(4))
    path, copy = kept._path, pickle.loads(pickle.dumps(kept))
    assert copy.take(np.arange(4))[1].all()
    del copy
    gc.collect()
    assert path.exists()
    late = pickle.loads(pickle.dumps(kept))
    del kept
    gc.collect()
    assert not path.exists()
    assert not late.take(np.arange(4))[1].any()
    late.keep(np.arange(4), drawn(4))  # there is nowhere to keep it, and that is no failure


def _forked(kept: KeptInputs) -> None:
    del kept
    gc.collect()
    os._exit(0)


def test_a_forked_process_leaves_the_file_alone() -> None:
    kept = KeptInputs(SHAPES, 4, 2**20)
    process = multiprocessing.get_context("fork").Process(target=_forked, args=(kept,))
    process.start()
    process.join()
    assert kept._path.exists()


def test_a_full_disk_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = KeptInputs(SHAPES, 4, 2**20)

    def full(*args: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    kept.keep(np.arange(4), drawn(4))
    assert not kept.take(np.arange(4))[1].any()


def test_no_place_for_the_file_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: object) -> tuple[int, str]:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tempfile.mkstemp", full)
    kept = KeptInputs(SHAPES, 4, 2**20)
    for each in (kept, pickle.loads(pickle.dumps(kept))):
        each.keep(np.arange(4), drawn(4))
        assert not each.take(np.arange(4))[1].any()


@pytest.mark.slow
@pytest.mark.parametrize("start", ["fork", *soak_only("spawn")])
def test_later_epochs_show_what_the_first_did(start: str) -> None:
    examples = GraspDataset(TINY, uses=KINDS["vision"])
    fresh = GraspDataset(TINY, uses=KINDS["vision"], keep_bytes=0)
    loader = DataLoader(examples, 2, num_workers=2, multiprocessing_context=start)
    epochs = [list(loader) for _ in range(2)]
    assert examples._kept is not None
    assert examples._kept.take(np.arange(len(examples)))[1].all()
    expected = list(DataLoader(fresh, 2))
    for epoch in epochs:
        for batch, clean in zip(epoch, expected, strict=True):
            assert all((batch[name] == clean[name]).all() for name in clean)


def test_kept_examples_are_not_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    examples = GraspDataset(TINY)
    first = examples[1]["image"]

    def unread(*args: object) -> None:
        raise AssertionError("read again")

    monkeypatch.setattr("grasp_factory.apps.learning.examples.ExampleReader.inputs", unread)
    assert (examples[1]["image"] == first).all()
    with pytest.raises(AssertionError, match="read again"):
        examples[0]


def test_noise_is_drawn_anew_and_not_kept() -> None:
    examples = GraspDataset(TINY, noise="stereo")
    first = examples[0]["image"]
    examples.set_epoch(1)
    assert (examples[0]["image"] != first).any()
