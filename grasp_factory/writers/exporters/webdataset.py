"""WebDataset: tar files with one sample per episode, for sequential reading.

A sample's files share the episode's number as their name and follow each other in the tar file:
images, arrays as .npy, and a .json with the label. The tar files repeat byte for byte. Layout:
https://github.com/webdataset/webdataset
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.serialization import check_range
from grasp_factory.errors import UsageError, shown
from grasp_factory.writers.exporters.base import (
    ExportContents,
    Exporter,
    ExportJob,
    ExportPart,
    episodes_of_each_file,
    parts_of,
)
from grasp_factory.writers.exporters.images import png
from grasp_factory.writers.exporters.plain_columns import plain_columns
from grasp_factory.writers.exporters.selection import Selection


@dataclass(frozen=True, slots=True, kw_only=True)
class WebDatasetSettings:
    """Settings of the format."""

    episodes_per_shard: int = 0
    """Episodes in a tar file; 0 for an eighth of all, 8 to 64."""

    def __post_init__(self) -> None:
        check_range(self, "episodes_per_shard", 0, 1_000_000)


def excludes(episodes: Selection, settings: WebDatasetSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Check that lower case keeps the cameras apart; no episode is excluded.

    Raises:
        UsageError: if two names of cameras differ in case only.
    """
    cameras = list(episodes.config.cameras)
    if len({name.lower() for name in cameras}) < len(cameras):
        raise UsageError(
            f"webdataset: got cameras {shown(cameras)}, valid: names that differ in"
            " more than case, because its reader ignores case"
        )
    return {}


def split(episodes: Selection, settings: WebDatasetSettings) -> list[range]:
    """Return the episodes of each tar file."""
    n = len(episodes)
    return parts_of(n, episodes_of_each_file(n, settings.episodes_per_shard))


def write_part(job: ExportJob, part: ExportPart) -> None:
    """Write a tar file."""
    path = job.folder / f"episodes-{part.number:06d}.tar"
    with tarfile.open(path, "w") as tar:
        for place, episode in part.episodes:
            for suffix, data in sample(episode):
                member = tarfile.TarInfo(f"{place:08d}.{suffix}")  # time 0, so that bytes repeat
                member.size = len(data)
                is_long = len(member.name.encode()) > tarfile.LENGTH_NAME
                tar.format = tarfile.PAX_FORMAT if is_long else tarfile.USTAR_FORMAT
                tar.addfile(member, io.BytesIO(data))


def sample(episode: Episode) -> Iterator[tuple[str, bytes]]:
    """Yield the name after the first dot and the bytes of each file of an episode.

    A reader takes what follows the first dot as the name of a file's content, in lower case.
    """
    contents = episode.contents()
    label = plain_columns(episode.spec, contents)
    yield "json", json.dumps(label, allow_nan=False).encode()
    yield "cls", str(int(episode.success)).encode()
    for path, values in contents.items():
        group, _, name = path.partition("/")
        if group == "episodes":
            continue
        key = f"{group.removesuffix('s')}_{name}".replace("/", "_").lower()
        if group == "cameras" and path.endswith(("/rgb", "/segmentation")):
            for image, time in zip(values, ("before", "after"), strict=True):
                yield f"{key}_{time}.png", png(image)
        else:
            yield f"{key}.npy", npy(values)


def npy(values: NDArray[Any]) -> bytes:
    """Return an array as the bytes of a .npy file."""
    data = io.BytesIO()
    np.save(data, values, allow_pickle=False)
    return data.getvalue()


WEBDATASET = Exporter(
    name="webdataset",
    description="tar files of samples for WebDataset and Hugging Face datasets",
    contents=ExportContents(
        written=("*",),
        treatment={
            "NaN": "kept in .npy files, null in .json",
            "no grasp": "grasp_position and the other columns of the grasp are null",
            "no video": "the video's arrays have the length 0",
        },
    ),
    excludes=excludes,
    split=split,
    write_part=write_part,
    parameters=WebDatasetSettings,
)
