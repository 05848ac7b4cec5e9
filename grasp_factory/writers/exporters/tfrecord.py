"""RLDS in TFRecord files: episodes of steps that TensorFlow Datasets reads, and OpenX models use.

Layout of an episode: https://github.com/google-research/rlds#dataset-format. Files of a data set:
https://www.tensorflow.org/datasets/external_tfrecord. An episode has its steps at the rate of its
videos, and all arrays of the store as ``episode_metadata``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.field import Field
from grasp_factory.core.schema import NOT_IN_AN_EPISODE
from grasp_factory.core.serialization import check_range
from grasp_factory.core.splits import SPLITS
from grasp_factory.core.text_format import size_text
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
    parts_of,
)
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.steps import (
    NO_FRAMES,
    RATE,
    REAL_STEPS,
    EpisodeSteps,
    observations,
    steps_of,
    task_text,
    without_frames,
)
from grasp_factory.writers.exporters.tfds_features import TfdsFeature, features_json
from grasp_factory.writers.exporters.tfrecord_file import RECORD_BYTES, example, record

NAME, VERSION = "grasp_factory", "1.0.0"
"""Of the data set in TFDS."""
MOST_BYTES = 2**31 - 1
"""Of an episode: https://protobuf.dev/programming-guides/proto-limits/#total."""

FeatureValues = tuple[TfdsFeature, NDArray[Any]]
"""A feature, and its values of an episode: those of all steps, (K, ...), or of the episode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TfrecordSettings:
    """Settings of the format."""

    episodes_per_shard: int = 16
    """Most episodes in a file."""

    def __post_init__(self) -> None:
        check_range(self, "episodes_per_shard", 1, 1_000_000)


SizesBySplit = Mapping[str, Sequence[int]]
"""Bytes of each example that a part wrote for a split, in the order of the episodes."""


def excludes(episodes: Selection, settings: TfrecordSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Exclude episodes without video frames.

    Raises:
        UsageError: if the stores have no videos.
    """
    return {NO_FRAMES: without_frames(episodes)}


def write_part(job: ExportJob, part: ExportPart) -> SizesBySplit:
    """Write the records of each split to a file aside: ``finish`` makes the files of them."""
    fields = job.episodes.fields
    sizes: dict[str, list[int]] = {}
    with ExitStack() as stack:
        files: dict[str, BinaryIO] = {}
        for place, episode in part.episodes:
            split = str(episode.columns["split"])
            if split not in files:
                file = _aside(job, part.number, split).open("wb")
                files[split], sizes[split] = stack.enter_context(file), []
            data = example(
                {
                    name: feature.encode(values, steps=name.startswith("steps/"))
                    for name, (feature, values) in episode_arrays(place, episode, fields).items()
                }
            )
            _check_size(job, place, data)
            files[split].write(record(data))
            sizes[split].append(len(data))
    return sizes


def _check_size(job: ExportJob, place: int, data: bytes) -> None:
    """Refuse what no reader of protobuf takes."""
    if len(data) > MOST_BYTES:
        raise UsageError(
            f"tfrecord: row {job.episodes.origin(place)[1]} takes {size_text(len(data))} as"
            f" one message, valid: at most {size_text(MOST_BYTES)}, which is the limit of protobuf;"
            " leave it out, or take webdataset"
        )


def episode_arrays(
    place: int, episode: Episode, fields: Mapping[str, Field]
) -> dict[str, FeatureValues]:
    """Return what is stored of an episode, by the name of the feature."""
    steps = steps_of(episode)
    return {
        **{f"steps/{name}": item for name, item in _of_steps(episode, steps)},
        "episode_metadata/episode": _plain(np.array(place)),
        **{
            f"episode_metadata/{path}": _of_field(fields[path], values)
            for path, values in episode.contents().items()
            if path in fields and path not in NOT_IN_AN_EPISODE and not path.startswith("videos/")
        },
    }


def _of_steps(episode: Episode, steps: EpisodeSteps) -> Iterator[tuple[str, FeatureValues]]:
    """Yield the arrays of RLDS, (K, ...), by name."""
    count = len(steps.record)
    number = np.arange(count)
    text = np.full(count, task_text(str(episode.columns["object_family"])))
    for name, values in observations(episode, steps).items():
        yield f"observation/{name}", _of_step(values)
    yield "observation/state", _of_step(steps.state)
    yield "action", _of_step(steps.action)
    yield "reward", _of_step(steps.reward)
    yield "discount", _of_step(np.ones(count, np.float32))
    yield "is_first", _of_step(number == 0)
    yield "is_last", _of_step(number == count - 1)
    yield "is_terminal", _of_step(number == count - 1)
    yield "language_instruction", _of_step(text)


def _of_step(values: NDArray[Any]) -> FeatureValues:
    """Return values (K, ...) with their feature; images are PNG files."""
    shape = values.shape[1:]
    if values.ndim == 4 and values.dtype == np.uint8:
        return TfdsFeature(shape=shape, dtype="uint8", encoding="png"), values
    return TfdsFeature.of(values, shape), values


def _of_field(row: Field, values: NDArray[Any]) -> FeatureValues:
    """Return an episode's values of an array of the store, with their feature."""
    if row.is_image:
        return TfdsFeature(shape=values.shape, dtype=row.dtype, encoding="zlib"), values
    shape = (None, *values.shape[1:]) if row.length_column else values.shape
    return TfdsFeature.of(values, shape), values


def _plain(values: NDArray[Any]) -> FeatureValues:
    return TfdsFeature.of(values, values.shape), values


def finish(job: ExportJob, parts: Sequence[SizesBySplit]) -> None:
    """Join the records of each split to files, and describe them for TFDS."""
    splits = []
    for name in SPLITS:
        sizes = [size for part in parts for size in part.get(name, ())]
        records = _records(job, name, parts)
        shards = parts_of(len(sizes), job.settings.episodes_per_shard)
        for number, shard in enumerate(shards):
            file = f"{NAME}-{name}.tfrecord-{number:05d}-of-{len(shards):05d}"
            with (job.folder / file).open("wb") as out:
                out.writelines(islice(records, len(shard)))
        if shards:
            splits.append(
                {
                    "name": name,
                    "shardLengths": [str(len(shard)) for shard in shards],
                    "numBytes": str(sum(sizes)),
                    "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
                }
            )
    about = {"name": NAME, "version": VERSION, "fileFormat": "tfrecord", "splits": splits}
    arrays = episode_arrays(0, job.episodes[0], job.episodes.fields)
    features = features_json({name: feature for name, (feature, _) in arrays.items()})
    for file, data in (("dataset_info.json", about), ("features.json", features)):
        write_json(job.folder / file, data)


def _records(job: ExportJob, split: str, parts: Sequence[SizesBySplit]) -> Iterator[bytes]:
    """Yield the records of a split, and remove each file aside after its last one."""
    for number, part in enumerate(parts):
        if split in part:
            path = _aside(job, number, split)
            with path.open("rb") as file:
                for size in part[split]:
                    yield file.read(size + RECORD_BYTES)
            path.unlink()


def _aside(job: ExportJob, number: int, split: str) -> Path:
    return job.aside / f"{number:08d}.{split}"


TFRECORD = Exporter(
    name="tfrecord",
    description="RLDS in TFRecord files, for TensorFlow Datasets and models of Open X-Embodiment",
    contents=ExportContents(
        written=("*",),
        treatment={
            "rate": f"{RATE}; episode_metadata has all records of all series",
            "action": "joint positions (rad) and gripper width (m) that are commanded at the next"
            " step; observation/state has the measured ones",
            "reward": "the sum up to the next step, so 1 at the end of a success",
            "split": "train, val and test are splits of the data set; one without episodes is not"
            " there",
            "types": "TFDS keeps numbers as int64 and float32 only, so arrays of other types are"
            " stored as their bytes, and TFDS returns them exactly",
            "no video": "episodes without video frames are not in the files",
            "no grasp": "the robot does not move and there are no video frames",
            "NaN": "kept",
            REAL_ROWS: REAL_STEPS,
            "truth": "object_pose is the simulator's truth, which a real robot does not observe",
            "language_instruction": "names the family of the target's shape",
        },
    ),
    excludes=excludes,
    write_part=write_part,
    finish=finish,
    parameters=TfrecordSettings,
)
