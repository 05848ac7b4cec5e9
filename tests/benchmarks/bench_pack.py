"""How long packing takes, how much memory, and how many files it saves.

    PYTHONPATH=tests python -m benchmarks.bench_pack [--episodes 64] [--shard 64] [--folder DIR]

Makes a store of 640x480 with the default block size, packs it, and compares all rows' checksums.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation.pack import pack_store
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate


def data_files(store: Path) -> Iterator[Path]:
    """Yield the files of a store that hold rows."""
    return (f for f in store.rglob("*") if f.is_file() and f.name != "zarr.json")


def packing(source: Path, out: Path, shard: int) -> None:
    """Pack in this process, and print its time and memory."""
    Dataset(source).column("checksum")  # imports are not counted
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started, cpu = time.perf_counter(), time.process_time()
    rows = pack_store(source, out, shard).rows
    wall, cpu = time.perf_counter() - started, time.process_time() - cpu
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{1e3 * wall / rows:.2f} ms an episode, {1e3 * cpu / rows:.2f} ms of the processor")
    print(f"memory {after / 1024:.0f} MiB, {before / 1024:.0f} MiB before")


def main() -> None:
    """Make, pack, print, remove."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=64)
    parser.add_argument("--shard", type=int, default=64)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--pack", type=Path, nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.pack:
        packing(*given.pack, given.shard)
        return
    folder = Path(tempfile.mkdtemp(prefix="pack-", dir=given.folder))
    try:
        a, b = folder / "a.zarr", folder / "b.zarr"
        plain = {"physics": to_plain(PHYSICS_PRESETS["fast"])}
        generate(FactoryConfig.from_plain(plain), given.episodes, a)
        command = [sys.executable, __file__, "--pack", str(a), str(b), "--shard", str(given.shard)]
        subprocess.run(command, check=True)
        for store in (a, b):
            sizes = [file.stat().st_size for file in data_files(store)]
            small = sum(size < 1000 for size in sizes)
            print(f"{store.name}: {len(sizes)} files, {small} below 1 kB, {sum(sizes)} bytes")
        same = [Dataset(store).column("checksum").tolist() for store in (a, b)]
        print("equal" if same[0] == same[1] else "DIFFERENT")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
