"""A small real store with a bit of everything, ways to damage it, and all that can be read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.curation.relabel import relabel
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError
from grasp_factory.factory import generate
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.metadata_checksum import SEAL

CONFIG = FactoryConfig.from_plain(
    {
        "seed": 3,
        "resolution": [32, 24],
        "block_size": 4,
        "video_hz": 5,
        "quality": {"min_score": 5, "min_target_pixels": 5},
    }
)
"""Of whose first episodes some are quarantined, for the target is small in the image."""
N = 10
"""Two whole blocks, which are packed, and a short one."""
LABEL = "gentle"
SEGMENT_BLOCKS = 2
NOT_COMPARED = ("checksum", "array_crc32c")
"""Columns that others are compared with."""

Damage = Callable[[Path], None]


def make_store(path: Path) -> Path:
    """Return a store of ``CONFIG`` at ``path``, packed, with an added label."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(segment_packing, "SEGMENT_BLOCKS", SEGMENT_BLOCKS)
        generate.generate(CONFIG, N, path, workers=1, max_failures=1.0)
    relabel(path, LABEL, LabelConfig(max_slip_distance=0.003))
    return path


def files(store: Path) -> list[Path]:
    """Return every file of a store, sorted."""
    return sorted(path for path in store.rglob("*") if path.is_file())


def change(file: Path, place: int, value: int) -> Callable[[], None]:
    """Set a byte of a file, and return what puts the old one back."""
    whole = file.read_bytes()
    changed = bytearray(whole)
    changed[place] = value
    file.write_bytes(changed)
    return lambda: void(file.write_bytes(whole))


def void(_: object) -> None:
    """Return nothing."""


def cut(name: str) -> Damage:
    """Return what takes the last bytes of a file away."""
    return lambda store: void((store / name).write_bytes((store / name).read_bytes()[:-5]))


def lengthen(name: str) -> Damage:
    """Return what adds a few bytes to a file."""
    return lambda store: void((store / name).write_bytes((store / name).read_bytes() + b"12345"))


def empty(name: str) -> Damage:
    """Return what empties a file."""
    return lambda store: void((store / name).write_bytes(b""))


def delete(name: str) -> Damage:
    """Return what deletes a file."""
    return lambda store: (store / name).unlink()


def swap(a: str, b: str) -> Damage:
    """Return what gives each of two files the other's bytes."""

    def damage(store: Path) -> None:
        first, second = ((store / name).read_bytes() for name in (a, b))
        (store / a).write_bytes(second)
        (store / b).write_bytes(first)

    return damage


def readings(store: Path, *, checked: bool = False) -> Iterator[tuple[str, Any]]:
    """Give all that can be read of a store, piece by piece; an error in place of what raises one.

    What is given for the same name of two stores is equal if and only if it is the same in every
    bit. An error that is not one of this package passes.
    """
    try:
        dataset = Dataset(store, checked=checked)
    except GraspFactoryError as error:
        yield "open", error
        return
    yield "attributes", dict(dataset.attributes)
    yield "length", len(dataset)
    columns = [name for name in dataset.columns if not (checked and name in NOT_COMPARED)]
    yield "columns", columns
    for name in columns:
        yield f"column {name}", _try(dataset.column, name)
    for i in range(N):
        yield f"episode {i}", _try(_contents, dataset, i)
        yield f"recipe {i}", _try(dataset.spec, i)
        yield f"series {i}", _try(_series, dataset, i)
        for name in ("policy", "object_com"):
            yield f"value {name} {i}", _try(dataset.value, i, name)
        for kind in ("rgb", "depth", "segmentation"):
            yield f"image {kind} {i}", _try(dataset.image, i, "front", kind, i % 2)
    yield "blocks", _try(_blocks, dataset)
    yield "success", _try(_successes, dataset)
    yield "label", _try(dataset.label, LABEL)
    if not checked:
        yield "arrays", _try(_arrays, dataset)


def same(a: Any, b: Any) -> bool:
    """Say whether two readings are the same in every bit; two errors are."""
    if isinstance(a, GraspFactoryError) or isinstance(b, GraspFactoryError):
        return isinstance(a, GraspFactoryError) and isinstance(b, GraspFactoryError)
    if isinstance(a, np.ndarray | np.generic):
        a, b = np.asarray(a), np.asarray(b)
        if (a.dtype, a.shape) != (b.dtype, b.shape):
            return False
        is_text = a.dtype.kind in "UT"
        return bool(a.tolist() == b.tolist() if is_text else a.tobytes() == b.tobytes())
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return bool(a == b)


def _try(read: Callable[..., Any], *args: Any) -> Any:
    try:
        return read(*args)
    except GraspFactoryError as error:
        return error


def _contents(dataset: Dataset, i: int) -> list[Any]:
    return sorted(dataset[i].contents().items())


def _series(dataset: Dataset, i: int) -> list[Any]:
    return list(dataset.series(i, "phase", "tcp_pose").items())


def _blocks(dataset: Dataset) -> list[Any]:
    return [indices for indices, _ in dataset.iter_blocks()]


def _successes(dataset: Dataset) -> Any:
    return dataset.where(success=True).indices


def _arrays(dataset: Dataset) -> list[Any]:
    return [
        (
            path,
            _described(array.attrs.asdict()),
            array.shape,
            str(array.dtype),
            repr(array.fill_value),
        )
        for path, array in sorted(dataset.arrays().items())
    ]


def _described(attributes: dict[str, Any]) -> dict[str, Any]:
    """Return attributes without the seal, which is no content: a changed one is noted by verify."""
    return {key: value for key, value in attributes.items() if key != SEAL}
