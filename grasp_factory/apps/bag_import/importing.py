"""Listing and importing a bag: a worker process with limits reads it, for it may be anybody's."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from grasp_factory.apps.bag_import.extraction import (
    LAYOUTS,
    STEPS,
    BagImport,
    ImportJob,
    extract,
    listed,
)
from grasp_factory.apps.bag_import.topic_listing import BagFacts
from grasp_factory.capture.bags.bag_file import bag_suffix
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.output_folder import check_free, publish
from grasp_factory.core.place import place_at
from grasp_factory.core.place_tree import fsync_tree
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import StoreError, lookup
from grasp_factory.writers.exporters.json_file import write_json

RECORD = "grasp_factory_import.json"
_LONGEST_PREFIX = 40
"""Characters of the name that the hidden scratch folder repeats: file systems limit its length."""


def list_topics(bag: Path) -> BagFacts:
    """Return the topics of a bag, and how many messages belong to none of them.

    Raises:
        UsageError: if it is no bag.
        StoreError: if it is damaged, or needs too much memory or time.
    """
    bag_suffix(bag)
    with scratch_folder(Path(tempfile.gettempdir()), "grasp-factory-bag") as aside:
        found: BagFacts = in_import_process(listed, (bag, aside), bag)
    return found


def import_bag(
    bag: Path,
    out: Path,
    layout: str,
    topics: Sequence[str] = (),
    *,
    on_start: Callable[[int], None] = lambda total: None,
    on_step: Callable[[], None] = lambda: None,
) -> BagImport:
    """Write the images and series of a bag to the folder ``out``; after an error it does not exist.

    Args:
        bag: a bag of ROS 1 or ROS 2.
        out: the folder to create. It must not exist.
        layout: a name of ``LAYOUTS``.
        topics: the topics to import; none for all that the layout can hold.
        on_start: called with the number of steps.
        on_step: called after each step.

    Raises:
        UsageError: if it is no bag, for a topic that is not in it or cannot be imported, or a
            place that is taken.
        StoreError: if the bag is damaged or needs too much memory or time, or the disk fails.
    """
    lookup(LAYOUTS, "layout", layout)
    bag_suffix(bag)
    check_free(out, "an import")
    on_start(STEPS)
    try:
        with scratch_folder(out.parent, f"{out.name[:_LONGEST_PREFIX]}.importing") as scratch:
            built, aside = scratch / "out", scratch / "aside"
            built.mkdir()
            aside.mkdir()
            job = ImportJob(bag=bag, folder=built, aside=aside, layout=layout, topics=tuple(topics))
            found: BagImport = in_import_process(extract, job, bag, lambda _: on_step())
            write_json(built / RECORD, to_plain(found))
            fsync_tree(place_at(built))
            publish(built, out, "an import")
    except OSError as error:
        raise StoreError(f"{out} cannot be written: {error.strerror or error}") from None
    return found
