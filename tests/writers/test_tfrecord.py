"""`tfrecord`, read by a parser of its own; `bin/check-exports tfds` reads with TFDS itself.

The parser follows only the definitions of TFRecord, protobuf and features.json.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import google_crc32c
import numpy as np
import pytest
from numpy.typing import NDArray
from support.exporter_contract import cameras, make_store
from support.stored import varied

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.writers.exporters.tfrecord_file import example, record


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


def messages(data: bytes) -> Iterator[bytes]:
    """Yield the contents of the records of a TFRecord file, whose checksums are right."""
    while data:
        (length,) = struct.unpack_from("<Q", data)
        head, body, rest = data[:8], data[12 : 12 + length], data[12 + length :]
        for checked, stored in ((head, data[8:12]), (body, rest[:4])):
            crc = google_crc32c.value(checked)
            rotated = ((crc >> 15) | (crc << 17)) & 0xFFFFFFFF
            assert struct.unpack("<I", stored) == ((rotated + 0xA282EAD8) % 2**32,)
        yield body
        data = rest[4:]


def varint(data: bytes, at: int) -> tuple[int, int]:
    """Return the varint at a position, and the position after it."""
    number = shift = 0
    while True:
        number |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 0x80:
            return number, at


def fields(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the numbers and contents of the fields of a message; all have a length."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        assert key & 7 == 2
        length, at = varint(data, at)
        assert at + length <= len(data)
        yield key >> 3, data[at : at + length]
        at += length


def parsed(message: bytes) -> dict[str, Any]:
    """Return the values of a tf.train.Example by the name of the feature."""
    ((_, features),) = fields(message)
    found: dict[str, Any] = {}
    for _, entry in fields(features):
        (one, name), (two, feature) = fields(entry)
        ((kind, values),) = fields(feature)
        items = [value for _, value in fields(values)]
        assert (one, two) == (1, 2)
        assert name.decode() not in found
        if kind == 2:
            found[name.decode()] = np.frombuffer(b"".join(items), "<f4")
        elif kind == 3:
            found[name.decode()] = np.array(list(integers(items[0])), np.int64)
        else:
            found[name.decode()] = items
    return found


def integers(packed: bytes) -> Iterator[int]:
    at = 0
    while at < len(packed):
        number, at = varint(packed, at)
        yield number - 2**64 if number >= 2**63 else number


def leaves(tree: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the description of each feature in features.json."""
    assert tree["pythonClassName"].startswith("tensorflow_datasets.core.features.")
    if "sequence" in tree:
        tree = tree["sequence"]["feature"]
    if "featuresDict" not in tree:
        yield path.removeprefix("/"), tree.get("tensor") or {**tree["image"], "encoding": "png"}
        return
    for name, node in tree["featuresDict"]["features"].items():
        yield from leaves(node, f"{path}/{name}")


def decoded(values: Any, about: Any, *, steps: bool) -> NDArray[Any]:
    """Return the array that features.json describes, (K, ...) for features of steps."""
    shape = [int(side) for side in about["shape"].get("dimensions", [])]
    whole = [-1, *shape] if steps else shape
    if about["dtype"] == "string":
        return np.array([value.decode() for value in values]).reshape(whole)
    if about["encoding"] == "png":
        images = [cv2.imdecode(np.frombuffer(value, np.uint8), 1)[..., ::-1] for value in values]
        return np.stack(images).reshape(whole)
    if about["encoding"] != "none":
        unpack = zlib.decompress if about["encoding"] == "zlib" else bytes
        values = np.frombuffer(b"".join(map(unpack, values)), about["dtype"])
    return np.asarray(values, about["dtype"]).reshape(whole)


def read(out: Path) -> dict[int, tuple[str, dict[str, NDArray[Any]]]]:
    """Return the split and the arrays of each episode, by its number."""
    features = dict(leaves(json.loads((out / "features.json").read_text())))
    about = json.loads((out / "dataset_info.json").read_text())
    episodes = {}
    files = {"dataset_info.json", "features.json"}
    for split in about["splits"]:
        size = 0
        for k, length in enumerate(split["shardLengths"]):
            count = len(split["shardLengths"])
            name = f"{about['name']}-{split['name']}.tfrecord-{k:05d}-of-{count:05d}"
            files.add(name)
            found = list(messages((out / name).read_bytes()))
            assert len(found) == int(length)
            size += sum(map(len, found))
            for message in found:
                stored = parsed(message)
                assert set(stored) == set(features)
                arrays = {
                    path: decoded(stored[path], what, steps=path.startswith("steps/"))
                    for path, what in features.items()
                }
                number = int(arrays["episode_metadata/episode"])
                episodes[number] = (split["name"], arrays)
        assert size == int(split["numBytes"])
    record = {"grasp_factory.json", "grasp_factory_episodes.jsonl"}
    assert {path.name for path in out.iterdir()} == files | record
    return episodes


def test_every_array_is_read_back(dataset: Dataset, tmp_path: Path) -> None:
    out = dataset.export("tfrecord", tmp_path / "out").path
    found = read(out)
    assert set(found) == set(range(len(dataset.committed)))
    for number, episode in enumerate(dataset):
        split, arrays = found[number]
        assert split == episode.columns["split"]
        streams, videos = episode.streams, episode.videos
        for path, values in episode.contents().items():
            if not path.startswith("videos/"):
                stored = arrays.pop(f"episode_metadata/{path}")
                np.testing.assert_array_equal(stored, values, strict=values.dtype.kind != "U")
        at = [np.flatnonzero(streams["timestamp"] <= t)[-1] for t in videos["timestamp"]]
        for name, values in streams.items():
            if name != "reward":
                stored = arrays.pop(f"steps/observation/{name}")
                np.testing.assert_array_equal(stored, values[at], strict=True)
        for path, values in videos.items():
            name = "video_" * (path == "timestamp") + path.replace("/rgb", "_image")
            stored = arrays.pop(f"steps/observation/{name.replace('/', '_')}")
            np.testing.assert_array_equal(stored, values, strict=True)
        measured = np.c_[streams["joint_positions"], streams["gripper_width"]][at]
        target = np.c_[streams["joint_position_targets"], streams["gripper_width_target"]]
        first = np.arange(len(at)) == 0
        last = first[::-1]
        expected = {
            "observation/state": measured,
            "action": target[[*at[1:], -1]],
            "reward": (last & episode.success).astype(np.float32),
            "discount": np.ones(len(at), np.float32),
            "is_first": first,
            "is_last": last,
            "is_terminal": last,
        }
        for name, values in expected.items():
            np.testing.assert_array_equal(arrays.pop(f"steps/{name}"), values, strict=True)
        family = str(episode.columns["object_family"])
        text = f"Grasp the {family} and lift it."
        assert set(arrays.pop("steps/language_instruction").tolist()) == {text}
        assert set(arrays) == {"episode_metadata/episode"}


def test_splits_are_cut_into_files_in_the_order_of_the_episodes(tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "store.zarr")
    out = dataset.export("tfrecord", tmp_path / "out", episodes_per_shard=1, workers=2).path
    lines = (out / "grasp_factory_episodes.jsonl").read_text().splitlines()
    splits = {line["episode"]: line["columns"]["split"] for line in map(json.loads, lines)}
    found = {number: split for number, (split, _) in read(out).items()}
    assert found == splits
    assert {"train", "val"} <= set(splits.values())
    for name in set(splits.values()):
        of_split = [number for number, split in found.items() if split == name]
        assert of_split == sorted(of_split)


def test_a_camera_may_have_any_letters_in_its_name(tmp_path: Path) -> None:
    named = {"überkopf": cameras("overhead")["overhead"]}
    dataset = make_store(tmp_path / "store.zarr", cameras=named)
    ((_, arrays),) = read(dataset.export("tfrecord", tmp_path / "out", [0]).path).values()
    images = arrays["steps/observation/überkopf_image"]
    np.testing.assert_array_equal(images, dataset[0].videos["überkopf/rgb"])


KNOWN = {
    "negative and long integers": (
        {"a": np.array([-1, 0, 1, 300, 2**63 - 1, -(2**63)])},
        "0a2c0a2a0a016112251a230a21ffffffffffffffffff010001ac02ffffffffffffffff7f"
        "80808080808080808001",
    ),
    "floats": (
        {"b": np.array([1.5, np.inf], np.float32)},
        "0a130a110a0162120c120a0a080000c03f0000807f",
    ),
    "bytes of no and of much length": (
        {"c": [b"", b"x" * 130]},
        "0a93010a90010a0163128a010a87010a000a8201" + "78" * 130,
    ),
}


@pytest.mark.parametrize("what", KNOWN)
def test_a_message_has_the_bytes_that_tensorflow_writes(what: str) -> None:
    features, written = KNOWN[what]
    assert example(features).hex() == written  # type: ignore[arg-type]


def test_a_record_has_the_bytes_that_tensorflow_writes() -> None:
    assert record(b"abc").hex() == "0300000000000000b099490e6162636e57f121"


@pytest.mark.parametrize("size", [0, -1, 10**9])
def test_a_file_has_one_episode_or_more(dataset: Dataset, tmp_path: Path, size: int) -> None:
    with pytest.raises(ConfigError, match=r"episodes_per_shard: got .*, valid: 1 to 1000000"):
        dataset.export("tfrecord", tmp_path / "out", episodes_per_shard=size)


def test_a_store_without_videos_is_refused_with_what_to_do(tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "store.zarr", video_hz=0)
    with pytest.raises(UsageError, match=r"has no videos.*: generate .* with --video-hz 10"):
        dataset.export("tfrecord", tmp_path / "out")


def test_an_episode_that_no_message_can_hold_is_refused(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp_factory.writers.exporters.tfrecord.MOST_BYTES", 1000)
    with pytest.raises(UsageError, match=r"row \d+ takes .* as one message, valid: at most 1.0 kB"):
        dataset.export("tfrecord", tmp_path / "out")
    assert not (tmp_path / "out").exists()
