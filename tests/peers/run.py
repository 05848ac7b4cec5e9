"""Reads exports with the software of other projects and compares all values with the store.

A peer is a folder beside this file:

- ``requirements.txt``: what pip installs in the peer's own environment, with exact versions. If the
  first line is ``# apt: NAME ...``, Debian's Python reads, with these packages; if it is
  ``# pip: OPTION ...``, pip gets these options; if it is ``# source: URL COMMIT FOLDER``, the
  repository is cloned, for software that pip cannot install, and Python finds its folder.
- ``read.py EXPORT OUT``: runs there. It imports the other project and NumPy, nothing of this one,
  and writes what the other project read to the file OUT, ``np.savez(out, **arrays)``.
- ``compare.py``: runs here. ``FORMAT`` and ``SETTINGS`` say what is exported, ``GENERATE`` adds
  arguments to ``generate``, and ``compare(dataset, export, read)`` compares and returns the number
  of values that are equal, or raises ``AssertionError``.
"""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from grasp_factory.dataset.dataset import Dataset

HERE = Path(__file__).parent
ENVIRONMENTS = HERE.parents[1] / ".peers"
STORE = ("--n", "6", "--seed", "3", "--resolution", "64x48", "--clutter", "3", "--video-hz", "10")


def python_of(folder: Path) -> str:
    """Return the Python that has a peer's software; install it first if it is not there."""
    peer, listed = folder.name, folder / "requirements.txt"
    first = listed.read_text().splitlines()[0]
    if first.startswith("# apt:"):
        packages = first.removeprefix("# apt:").split()
        if subprocess.run(["dpkg", "-s", *packages], capture_output=True, check=False).returncode:
            subprocess.run(["apt-get", "install", "-y", "-q", *packages], check=True)
        return "/usr/bin/python3"
    python, installed = ENVIRONMENTS / peer / "bin/python", ENVIRONMENTS / peer / "installed.txt"
    if not installed.exists() or installed.read_text() != listed.read_text():
        shutil.rmtree(ENVIRONMENTS / peer, ignore_errors=True)
        subprocess.run([sys.executable, "-m", "venv", ENVIRONMENTS / peer], check=True)
        more = first.removeprefix("# pip:").split() if first.startswith("# pip:") else []
        command = [python, "-m", "pip", "install", "-q", *more, "-r", listed]
        subprocess.run(command, check=True)
        shutil.copy(listed, installed)
    return str(python)


def source_of(peer: str) -> str:
    """Return the folder of the peer's cloned software; clone it first; else empty."""
    first = (HERE / peer / "requirements.txt").read_text().splitlines()[0]
    if not first.startswith("# source:"):
        return ""
    url, commit, folder = first.removeprefix("# source:").split()
    clone = ENVIRONMENTS / f"{peer}-{commit}"
    if not clone.exists():
        subprocess.run(["git", "clone", "-q", "--no-checkout", url, clone], check=True)
    subprocess.run(["git", "-C", clone, "checkout", "-q", commit], check=True)
    return str(clone / folder)


def check(peer: str, work: Path) -> str:
    """Generate, export, read and compare; return what was found as a line."""
    compare = importlib.import_module(f"peers.{peer}.compare")
    python = python_of(HERE / peer)
    more = tuple(getattr(compare, "GENERATE", ()))
    store = work / f"{'_'.join(more) or 'store'}.zarr"
    if not store.exists():
        command = [sys.executable, "-m", "grasp_factory", "generate", "--out", store, "--quiet"]
        subprocess.run([*command, *STORE, *more], check=True)
    dataset, export, read = Dataset(store), work / peer, work / f"{peer}.npz"
    dataset.export(compare.FORMAT, export, **compare.SETTINGS)
    command = [python, str(HERE / peer / "read.py"), str(export), str(read)]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": source_of(peer)})
    with np.load(read, allow_pickle=False) as arrays:
        equal = compare.compare(dataset, export, dict(arrays))
    return f"{peer}: {compare.FORMAT}: {equal} values are equal"


def main() -> int:
    peers = sorted(path.parent.name for path in HERE.glob("*/compare.py"))
    wanted = sys.argv[1:] or peers
    if unknown := set(wanted) - set(peers):
        print(f"unknown peers: {', '.join(sorted(unknown))} (valid: {', '.join(peers)})")
        return 2
    failed = 0
    with tempfile.TemporaryDirectory() as work:
        for peer in wanted:
            try:
                print(check(peer, Path(work)), flush=True)
            except (AssertionError, subprocess.CalledProcessError) as error:
                failed = 1
                print(f"{peer}: FAILED: {error}", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())
