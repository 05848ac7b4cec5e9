"""Examples for PyTorch: the store's, in any process, each once, mirrored and noisy when asked."""

from __future__ import annotations

import copy
import itertools
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.opened_files import opened_shards
from support.scale import soak_only
from torch.utils.data import DataLoader

from grasp_factory.apps.learning.examples import ExampleReader, Examples
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UnknownNameError, UsageError
from grasp_factory.factory.generate import generate
from grasp_factory.policies.networks import KINDS, TouchWindow, mirrored
from grasp_factory.signals.grasp_crop import CropShape
from grasp_factory.torch import Example, GraspDataset, GraspStream

pytestmark = pytest.mark.slow

N = 22
SMALL = CropShape(size=12)
BOTH = KINDS["both"]
usually_forked = pytest.mark.parametrize("start", ["fork", *soak_only("spawn")])
"""A start of fresh processes takes seconds: the stream's test has one in every run."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store in blocks of 4."""
    config = FactoryConfig.from_plain({"resolution": [96, 72], "block_size": 4})
    path = tmp_path_factory.mktemp("torch") / "store"
    generate(config, N, path, workers=1)
    return path


@pytest.fixture(scope="module")
def examples(path: Path) -> GraspDataset:
    return GraspDataset(path, crop=SMALL)


def plain(path: Path, rows: Any, uses: Iterable[str] = KINDS["vision"], **how: Any) -> Examples:
    reader = ExampleReader(dataset=Dataset(path, **how), uses=tuple(uses), crop=SMALL)
    return reader.read(np.asarray(rows))


def check(examples: Iterable[Example], want: Examples) -> None:
    """Fail unless they are the examples of these rows, in this order."""
    count = 0
    for k, example in enumerate(examples):
        assert set(example) == {*want.inputs, "success", "row"}
        for name, values in want.inputs.items():
            assert example[name].dtype == torch.float32
            assert example[name].numpy().tobytes() == values[k].tobytes()
            assert example[name].shape == values[k].shape
        assert example["success"].dtype == torch.float32
        assert float(example["success"]) == want.success[k]
        assert example["row"] == want.rows[k]
        count += 1
    assert count == len(want)


def rows_of(batches: Iterable[Any]) -> list[int]:
    return [row for batch in batches for row in batch["row"].tolist()]


class TestByIndex:
    def test_are_what_the_reader_reads(self, path: Path) -> None:
        for uses in KINDS.values():
            dataset = GraspDataset(path, uses=uses, crop=SMALL, touch=TouchWindow())
            usable = dataset.rows
            assert len(usable) == len(dataset) > 4
            names = ", ".join([*uses, "success", "row"])
            assert repr(dataset).endswith(f": {len(dataset)} examples of {names}")
            check((dataset[i] for i in range(len(dataset))), plain(path, usable, uses))
            check(dataset.__getitems__([3, 0, 3, -1]), plain(path, usable[[3, 0, 3, -1]], uses))

    def test_of_some_rows_are_those_that_have_a_grasp(self, path: Path) -> None:
        every = GraspDataset(path).rows
        dataset = Dataset(path)
        planned = np.isfinite(dataset.column("grasp_width"))
        assert every.tolist() == np.flatnonzero(planned).tolist()
        chosen = every[[5, 1, 5, 2]]
        some = GraspDataset(dataset[chosen])
        assert some.rows.tolist() == sorted(chosen.tolist())
        assert some.blocks.tolist() == [row // 4 for row in some.rows]

    def test_a_batch_opens_each_file_once(
        self, examples: GraspDataset, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        opened = opened_shards(monkeypatch)
        order = np.random.default_rng(0).permutation(16)
        examples.__getitems__(order.tolist())
        assert set(opened.values()) == {1}

    def test_beyond_the_end_is_no_example(self, examples: GraspDataset) -> None:
        count = len(examples)
        for index in (count, -count - 1):
            with pytest.raises(
                IndexError, match=f"example {index}: valid: {-count} to {count - 1}"
            ):
                examples[index]

    @usually_forked
    def test_are_the_same_from_workers(
        self, path: Path, examples: GraspDataset, start: str
    ) -> None:
        examples[0]  # the parent has read before
        loader = DataLoader(examples, 5, num_workers=2, multiprocessing_context=start)
        batches = list(loader)
        want = plain(path, examples.rows)
        for name, values in want.inputs.items():
            loaded = torch.cat([batch[name] for batch in batches])
            assert loaded.numpy().tobytes() == values.tobytes()
        assert rows_of(batches) == examples.rows.tolist()
        assert torch.cat([b["success"] for b in batches]).tolist() == want.success.tolist()

    def test_travel_without_the_images(self, path: Path) -> None:
        dataset = GraspDataset(path, crop=SMALL, noise="stereo", noise_seed=2, mirror_seed=3)
        dataset.set_epoch(4)
        data = pickle.dumps(dataset)
        assert len(data) < 20_000
        again = pickle.loads(data)
        assert again.epoch == 4
        for a, b in zip(again.__getitems__([1, 5]), dataset.__getitems__([1, 5]), strict=True):
            assert torch.equal(a["image"], b["image"])

    def test_of_a_store_in_another_layout_are_read_by_forked_workers(
        self, path: Path, tmp_path: Path
    ) -> None:
        """Zarr itself reads it, with threads that do not outlive a fork."""
        copy = Path(shutil.copytree(path, tmp_path / "copy"))
        root = zarr.open_group(copy, mode="r+")
        for name in ("cameras/front/depth", "cameras/front/intrinsics"):
            array: Any = root[name]
            values, attributes = np.asarray(array[:]), array.attrs.asdict()
            chunk = (2, *values.shape[1:])
            keys = {"name": "v2", "separator": "."}
            shutil.rmtree(copy / name)
            root.create_array(
                name, data=values, chunks=chunk, attributes=attributes, chunk_key_encoding=keys
            )
        dataset = GraspDataset(copy, crop=SMALL)
        want = plain(path, dataset.rows)
        check(dataset.__getitems__(range(len(dataset))), want)
        loader = DataLoader(dataset, 5, num_workers=2, multiprocessing_context="fork", timeout=60)
        loaded = torch.cat([batch["image"] for batch in loader])
        assert loaded.numpy().tobytes() == want.inputs["image"].tobytes()


class TestStreams:
    @settings(max_examples=25)
    @given(
        seed=st.integers(0, 99),
        epoch=st.integers(0, 5),
        pool=st.integers(1, 30),
        world_size=st.integers(1, 4),
    )
    def test_have_each_row_once_over_all_ranks(
        self, examples: GraspDataset, seed: int, epoch: int, pool: int, world_size: int
    ) -> None:
        examples.set_epoch(epoch)
        shares = []
        for rank in range(world_size):
            stream = GraspStream(examples, seed=seed, pool=pool, rank=rank, world_size=world_size)
            share = [example["row"] for example in stream]
            assert [example["row"] for example in stream] == share
            shares.append(share)
        assert sorted(itertools.chain(*shares)) == examples.rows.tolist()
        blocks = [{row // 4 for row in share} for share in shares]
        assert sum(map(len, blocks)) == len(set().union(*blocks)), "a block has one reader"
        assert max(map(len, blocks)) - min(map(len, blocks)) <= 1

    def test_have_the_dataset_s_examples(self, path: Path, examples: GraspDataset) -> None:
        found = list(GraspStream(examples, seed=3))
        check(found, plain(path, [example["row"] for example in found]))

    def test_come_in_another_order_with_each_seed_and_epoch(self, examples: GraspDataset) -> None:
        orders = set()
        for seed, epoch in itertools.product(range(3), range(3)):
            stream = GraspStream(examples, seed=seed)
            stream.set_epoch(epoch)
            orders.add(tuple(example["row"] for example in stream))
        stream.set_epoch(0)
        assert len(orders) == 9

    def test_mix_the_blocks_as_far_as_the_pool_goes(self, examples: GraspDataset) -> None:
        def runs(pool: int) -> int:
            blocks = [example["row"] // 4 for example in GraspStream(examples, pool=pool)]
            return len(list(itertools.groupby(blocks)))

        count = len(set(examples.blocks.tolist()))
        assert runs(1) == count
        assert runs(16) > 1.5 * count

    def test_read_each_block_once(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        unread = GraspDataset(path, crop=SMALL)
        opened = opened_shards(monkeypatch)
        list(GraspStream(unread))
        assert set(opened.values()) == {1}
        list(GraspStream(unread))  # kept by now
        assert set(opened.values()) == {1}

    @usually_forked
    def test_are_shared_out_among_workers(
        self, path: Path, examples: GraspDataset, start: str
    ) -> None:
        stream = GraspStream(examples, seed=1, pool=5)
        how = {"num_workers": 2, "multiprocessing_context": start, "persistent_workers": True}
        loader = DataLoader(stream, 4, **how)
        orders = []
        for epoch in (0, 1, 0):
            stream.set_epoch(epoch)
            orders.append(rows_of(loader))
            assert sorted(orders[-1]) == examples.rows.tolist()
        stream.set_epoch(0)
        assert orders[0] == orders[2] != orders[1]

    @pytest.mark.parametrize(
        ("how", "message"),
        [
            ({"seed": -1}, "seed: got -1, valid: a whole number from 0 on"),
            ({"pool": 0}, "pool: got 0, valid: a whole number from 1 on"),
            ({"world_size": 0}, "world_size: got 0, valid: a whole number from 1 on"),
            ({"rank": 2, "world_size": 2}, "rank: got 2, valid: 0 to 1"),
            ({"rank": 0.0}, "rank: got 0.0, valid: 0 to 0"),
        ],
        ids=str,
    )
    def test_of_what_is_no_share_are_refused(
        self, examples: GraspDataset, how: dict[str, Any], message: str
    ) -> None:
        with pytest.raises(UsageError, match=f"^{message}$"):
            GraspStream(examples, **how)


class TestAugmentation:
    def test_noise_is_that_of_another_seed_in_each_epoch(self, path: Path) -> None:
        dataset = GraspDataset(path, crop=SMALL, uses=BOTH, noise="stereo", noise_seed=7)
        for epoch in (0, 1, 0):
            dataset.set_epoch(epoch)
            want = plain(path, dataset.rows[:3], BOTH, noise="stereo", noise_seed=7 + epoch)
            check(dataset.__getitems__([0, 1, 2]), want)
            assert (
                want.inputs["image"].tobytes()
                != plain(path, dataset.rows[:3]).inputs["image"].tobytes()
            )

    def test_noise_of_an_opened_dataset_is_its_own(self, path: Path) -> None:
        noisy = Dataset(path, noise="stereo", noise_seed=1)
        dataset = GraspDataset(noisy, crop=SMALL)
        dataset.set_epoch(3)
        check(
            dataset.__getitems__([2]), plain(path, dataset.rows[[2]], noise="stereo", noise_seed=1)
        )
        with pytest.raises(UsageError, match="noise: got one, and a Dataset that was opened with"):
            GraspDataset(noisy, noise="stereo")

    def test_noise_is_added_to_a_view_of_a_clean_store(self, path: Path) -> None:
        view = Dataset(path).where(success=[True, False])[3:9]
        dataset = view.to_torch(crop=SMALL, noise="stereo", noise_seed=2)
        assert set(dataset.rows.tolist()) <= set(view.indices.tolist())
        dataset.set_epoch(1)
        want = plain(path, dataset.rows[:2], noise="stereo", noise_seed=3)
        check(dataset.__getitems__([0, 1]), want)

    @usually_forked
    def test_noise_reaches_workers(self, path: Path, start: str) -> None:
        """The parent has used the same libraries before, some of which have threads."""
        dataset = GraspDataset(path, crop=SMALL, noise="stereo")
        dataset.__getitems__([0, 1])
        how = {"num_workers": 2, "multiprocessing_context": start, "persistent_workers": True}
        loader = DataLoader(dataset, 4, timeout=100, **how)
        for epoch in (0, 2):
            dataset.set_epoch(epoch)
            loaded = torch.cat([batch["image"] for batch in loader])
            want = plain(path, dataset.rows, noise="stereo", noise_seed=epoch)
            assert loaded.numpy().tobytes() == want.inputs["image"].tobytes()

    def test_mirroring_is_drawn_by_seed_epoch_and_index(self, path: Path) -> None:
        dataset = GraspDataset(path, crop=SMALL, uses=BOTH, mirror_seed=5)
        count = len(dataset)
        before = plain(path, dataset.rows, BOTH)
        four = [
            mirrored(before.inputs, np.full(count, x), np.full(count, y))
            for x, y in itertools.product([False, True], repeat=2)
        ]
        drawn = []
        for epoch in (0, 1, 2, 0):
            dataset.set_epoch(epoch)
            found = dataset.__getitems__(range(count))
            one_by_one = [dataset[i] for i in reversed(range(count))][::-1]
            kinds = []
            for k, (example, alone) in enumerate(zip(found, one_by_one, strict=True)):
                assert torch.equal(example["image"], alone["image"])
                data = example["image"].numpy().tobytes(), example["touch"].numpy().tobytes()
                choices = [(e["image"][k].tobytes(), e["touch"][k].tobytes()) for e in four]
                kinds.append(choices.index(data))
            drawn.append(kinds)
        assert drawn[0] == drawn[3]
        assert drawn[0] != drawn[1] != drawn[2]
        assert set(drawn[0] + drawn[1] + drawn[2]) == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"uses": ("image", "touhc")}, "unknown input 'touhc'; did you mean 'touch'"),
        (
            {"uses": ["rgb"]},
            r"input 'rgb': it is an image of the whole scene: ds.images\(rows, camera, 'rgb',"
            r" frame\), or ds\[i\].cameras; valid: image, width, touch",
        ),
        ({"uses": "image"}, r"uses: got 'image', valid: a list, such as \['image'\]"),
        ({"uses": ()}, "uses: got no input, valid: some of image, width, touch"),
        ({"noise": "sterio"}, "unknown noise 'sterio'; did you mean 'stereo'"),
        ({"noise": "stereo", "noise_seed": -1}, "noise seed: got -1, valid: a whole number"),
        ({"mirror_seed": True}, "mirror_seed: got True, valid: a whole number from 0 on"),
    ],
    ids=str,
)
def test_what_cannot_be_read_is_refused(path: Path, how: dict[str, Any], message: str) -> None:
    with pytest.raises((UsageError, UnknownNameError), match=message):
        GraspDataset(path, **how)


def test_an_epoch_is_a_number(examples: GraspDataset) -> None:
    with pytest.raises(UsageError, match="epoch: got -1, valid: a whole number from 0 on"):
        examples.set_epoch(-1)


def test_numpy_users_do_not_load_torch() -> None:
    code = (
        "import sys, grasp_factory.apps.learning.examples, grasp_factory.policies.networks;"
        "import grasp_factory.dataset.dataset;"
        "print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda d: pickle.loads(pickle.dumps(d))])
def test_a_copys_workers_hear_of_a_new_epoch(
    path: Path, copied: Callable[[GraspDataset], GraspDataset]
) -> None:
    examples = copied(GraspDataset(path, crop=SMALL, mirror_seed=0))
    loader = DataLoader(
        examples, 4, num_workers=1, persistent_workers=True, multiprocessing_context="fork"
    )
    images = []
    for epoch in range(6):
        examples.set_epoch(epoch)
        images.append(next(iter(loader))["image"])
    assert any((image != images[0]).any() for image in images)
