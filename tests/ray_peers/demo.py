"""bin/ray-demo: a store that two nodes make, compared with that of one process."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from support.helpers import assert_same_tree

from ray_peers.cluster import two_nodes

COMMAND = (sys.executable, "-m", "grasp_factory", "generate")
DEFAULTS = ("--n", "16", "--workers", "1", "--resolution", "64x48", "--set", "block_size=2")


def main() -> None:
    """Make both stores and compare them."""
    options = (*DEFAULTS, *sys.argv[1:])
    with tempfile.TemporaryDirectory() as folder, two_nodes() as nodes:
        both = Path(folder, "both.zarr"), Path(folder, "alone.zarr")
        where = ("--executor", nodes.address)
        run = (*COMMAND, *options, "--out", str(both[0]), *where)
        subprocess.run(run, env=nodes.environment, check=True)
        alone = (*COMMAND, *options, "--out", str(both[1]), "--quiet")
        subprocess.run(alone, check=True)
        assert_same_tree(*both)
    print("Both stores have the same bytes.")


if __name__ == "__main__":
    main()
