"""Faults in the rooms ``writers`` and ``dataset``: what is on the disk, and reading it."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "bop-without-the-poses-after",
        "writers/exporters/bop.py",
        'series=("streams/object_pose",)',
        "series=()",
        ("conformance/test_exporters.py",),
    ),
    Fault(
        "committed-before-the-data",
        "writers/zarr/block_attempt.py",
        "            for file in self._files:\n                staged =",
        "            self._staged[self._marker.inner].replace(self._marker)\n"
        "            for file in self._files:\n                staged =",
        ("writers/test_writers.py", "writers/test_disk_faults.py"),
    ),
    Fault(
        "directories-not-synced",
        "writers/zarr/block_attempt.py",
        "            fsync_places(_folders(self._files))\n",
        "",
        ("writers/test_writers.py", "writers/test_disk_faults.py"),
    ),
    Fault(
        "stale-segment-kept-by-a-write",
        "writers/zarr/writer.py",
        "            unpack_block(self._place, block)\n",
        "",
        ("writers/test_column_segments.py",),
    ),
    Fault(
        "lock-on-a-removed-file",
        "core/locked_file.py",
        "if has_name(descriptor, file, folder):",
        "if descriptor:",
        ("core/test_locked_file.py", "writers/test_store.py"),
    ),
    Fault(
        "shard-index-not-compared",
        "writers/zarr/chunks.py",
        'if google_crc32c.value(index) != int.from_bytes(stored, "little"):',
        "if len(stored) != _CHECKSUM_BYTES:",
        ("writers/test_array_reader.py",),
    ),
    Fault(
        "single-frames-not-checked",
        "dataset/checked_reader.py",
        "    def _check(self, values: NDArray[Any], start: int, stop: int) -> None:",
        "    def read_frames(self, rows, frame):\n"
        "        return self._array.read_frames(rows, frame)\n\n"
        "    def _check(self, values: NDArray[Any], start: int, stop: int) -> None:",
        ("dataset/test_checked_reading.py",),
    ),
    Fault(
        "quarantined-rows-read",
        "dataset/row_lookup.py",
        "(statuses == MISSING) | (statuses == QUARANTINED)",
        "statuses == MISSING",
        ("dataset/test_reading.py", "dataset/test_dataset.py"),
    ),
    Fault(
        "range-includes-its-end",
        "dataset/filters.py",
        "values < self.below",
        "values <= self.below",
        ("dataset/test_dataset.py", "dataset/test_reading.py"),
    ),
    Fault(
        "annotations-appended-without-a-lock",
        "dataset/annotations/log_file.py",
        "flags=os.O_APPEND, mode=0o666, check=check, folder=folder",
        "flags=os.O_APPEND, mode=0o666, check=check, folder=folder, shared=True",
        ("dataset/test_annotations.py",),
    ),
    Fault(
        "damaged-annotation-believed",
        "dataset/annotations/lines.py",
        "if not sealed or int(sealed[1], 16) != zlib.crc32(text):",
        "if not sealed:",
        ("dataset/test_annotations.py",),
    ),
    Fault(
        "order-of-an-older-index",
        "dataset/index/handle.py",
        "return query, generation, self._threads.file",
        "return query, self._threads.file",
        ("dataset/test_index.py", "dataset/test_query.py"),
    ),
)
