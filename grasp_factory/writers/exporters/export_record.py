"""What every export says of itself: two files beside the data, for people and for imports.

``grasp_factory.json`` says which rows of which stores the export has, what it left out and why.
``grasp_factory_episodes.jsonl`` has a line for each episode: its store, row and checksum, all its
columns, and its other small arrays. A coded value is its word. NaN, and a coded value that was not
measured, are null. The other values are those of the store. Data that is embedded in a store is in
``grasp_factory_embedded/``.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import grasp_factory
from grasp_factory.core.episode import Episode
from grasp_factory.core.field import Field
from grasp_factory.core.schema import FINGERPRINT
from grasp_factory.core.serialization import to_plain
from grasp_factory.writers.exporters.base import Exporter, ExportJob
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.plain_columns import plain, plain_columns
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.zarr.embedded import embedded_in, read_embedded

RECORD = "grasp_factory.json"
EPISODES = "grasp_factory_episodes.jsonl"
EMBEDDED = "grasp_factory_embedded"
VERSION = 1
"""Of the layout of both files."""


def line_of_each(episodes: Selection, places: Sequence[int]) -> Callable[[int, Episode], str]:
    """Return a function that returns an episode's line in ``grasp_factory_episodes.jsonl``.

    Args:
        episodes: the episodes of the export.
        places: the numbers of those that the function will be called with.

    Raises:
        StoreError: if a store is damaged.
    """
    fields = episodes.fields
    checksums = _words(episodes, places, "checksum")
    has_one = FINGERPRINT.path in fields  # stores of old versions have no fingerprint
    fingerprints = _words(episodes, places, "fingerprint") if has_one else {}

    def line(place: int, episode: Episode) -> str:
        store, row = episodes.origin(place)
        contents = episode.contents()
        said = {
            "episode": place,
            "store": store,
            "row": row,
            "checksum": checksums[place],
            "fingerprint": fingerprints.get(place, ""),
            "columns": plain_columns(episode.spec, contents),
            "arrays": {
                path: plain(values)
                for path, values in contents.items()
                if is_small(fields.get(path))
            },
        }
        return json.dumps(said, allow_nan=False) + "\n"

    return line


def _words(episodes: Selection, places: Sequence[int], column: str) -> dict[int, str]:
    return dict(zip(places, map(str, episodes.values(places, column)), strict=True))


def is_small(field: Field | None) -> bool:
    """Return whether a field is neither a column nor an image nor a time series."""
    return field is not None and not (
        field.path.startswith("episodes/") or field.is_image or field.length_column
    )


def write_record(
    job: ExportJob,
    exporter: Exporter,
    excluded: Mapping[str, Selection],
    parts: Sequence[Path],
) -> None:
    """Write both files to an export's folder.

    Args:
        job: what was exported, and to which folder.
        exporter: the format.
        excluded: what the format could not hold, by reason.
        parts: files with the lines of the episodes, in order.

    Raises:
        OSError: if they cannot be written.
    """
    episodes = job.episodes
    record = {
        "what": f"grasp episodes of grasp-factory as {exporter.name}; the rows are in {EPISODES}",
        "version": VERSION,
        "grasp_factory": grasp_factory.__version__,
        "format": exporter.name,
        "settings": to_plain(job.settings),
        "episodes": len(episodes),
        "stores": [
            {
                "name": source.path.name,
                "attributes": to_plain(source.attributes),
                "label_thresholds": {
                    name: to_plain(source.label_thresholds(name)) for name in source.labels
                },
            }
            for source in episodes.sources
        ],
        "arrays": sorted(episodes.fields),
        "contents": to_plain(exporter.contents),
        "excluded": {
            reason: [rows.origin(k) for k in range(len(rows))] for reason, rows in excluded.items()
        },
        "labels": _labels(episodes),
        "annotations": _annotations(episodes),
    }
    write_json(job.folder / RECORD, record)
    _write_embedded(job)
    with (job.folder / EPISODES).open("wb") as lines:
        for part in parts:
            with part.open("rb") as file:
                shutil.copyfileobj(file, lines)


def _write_embedded(job: ExportJob) -> None:
    """Write the meshes and models that the stores carry; what several carry is the same."""
    for source in job.episodes.sources:
        for path in embedded_in(source.config):
            file = job.folder / EMBEDDED / path
            data = None if file.exists() else read_embedded(source.path, path)
            if data is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(data)


def _labels(episodes: Selection) -> dict[str, list[str | None]]:
    """Return the words of added labels, (n,) each, by name; None where a label has no outcome."""
    words = dict(enumerate(episodes.fields["episodes/outcome"].names))
    names = sorted({name for source in episodes.sources for name in source.labels})
    codes = {name: episodes.label(name) for name in names}
    return {name: [words.get(code) for code in codes[name].tolist()] for name in names}


def _annotations(episodes: Selection) -> dict[str, Any]:
    """Return the annotations by the episode's number."""
    by_store = [source.annotations for source in episodes.sources]
    said: dict[str, Any] = {}
    for place in range(len(episodes)):
        store, row = episodes.origin(place)
        if row in by_store[store]:
            said[str(place)] = to_plain(by_store[store][row])
    return said
