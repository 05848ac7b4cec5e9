"""Parse the inputs of earlier fuzzing again and again, and print how much memory that takes.

    PYTHONPATH=tests python -m fuzz.replay MODULE FOLDER

``FOLDER`` is the one that ``python -m fuzz`` was given. It needs no Atheris. Memory must not grow
from the third pass on. An input that ends in an exception which is no refusal ends the program.
"""

from __future__ import annotations

import resource
import sys
import warnings
from importlib import import_module
from pathlib import Path

PASSES = 6
MOST_INPUTS = 300
MOST_GROWTH_KB = 8_000
"""In the last three passes; what the allocator does by itself is less."""


def main() -> None:
    """Replay all targets of a module."""
    module, folder = sys.argv[1:]
    warnings.simplefilter("ignore")
    grown = False
    for name, target in import_module(f"fuzz.{module}").TARGETS.items():
        corpus = Path(folder) / f"{module} {name}".replace("/", "-").replace(" ", "-")
        inputs = [file.read_bytes() for file in sorted(corpus.glob("*"))[:MOST_INPUTS]]
        used = []
        for _ in range(PASSES):
            for data in inputs or target.examples():
                target.run(data)
            used.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        growth = used[-1] - used[PASSES // 2 - 1]
        grown |= growth > MOST_GROWTH_KB
        print(f"{name:32} {len(inputs):>5} inputs, memory grows by {growth} kB", flush=True)
    sys.exit(grown)


if __name__ == "__main__":
    main()
