"""Trains networks of other projects on exports, with their own loaders, and draws their losses.

    PYTHONPATH=tests python -m peers.training FOLDER [PEER ...]

It keeps stores and exports in FOLDER and goes on with what is there. It writes the lines of each
``train.py`` to ``FOLDER/PEER.log``, or to ``FOLDER/PEER.log.part`` while it trains, and draws the
picture ``FOLDER/losses.png``.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from grasp_factory.dataset.dataset import Dataset
from peers.run import HERE, python_of, source_of

OVERHEAD = ("--n", "600", "--seed", "3", "--camera", "overhead", "--resolution", "320x240")
VIDEO = ("--n", "24", "--seed", "3", "--resolution", "64x48", "--video-hz", "10")
LINE = re.compile(r"^(?:epoch )?(\d+):?(?: training)? (\d+\.\d+)(?:, validation (\d+\.\d+))?", re.M)
"""What a ``train.py`` prints: step or epoch, training loss, and perhaps validation loss."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """One run of a peer's ``train.py``."""

    title: str
    generate: Sequence[str]
    """Arguments of ``generate``."""
    format: str
    arguments: Sequence[str]
    """Arguments of ``train.py`` after the export."""
    unit: str
    """What the first number of a line counts."""


TRAININGS: Mapping[str, Training] = {
    "lerobot": Training(
        title="ACT of LeRobot",
        generate=VIDEO,
        format="lerobot",
        arguments=("200",),
        unit="steps",
    ),
    "ggcnn": Training(
        title="GG-CNN",
        generate=OVERHEAD,
        format="jacquard",
        arguments=("10", "40"),
        unit="epochs of 320 images",
    ),
    "vgn": Training(
        title="VGN",
        generate=OVERHEAD,
        format="vgn",
        arguments=("5", "16"),
        unit="epochs",
    ),
}


def run(peer: str, folder: Path) -> str:
    """Generate, export and train, as far as that is not done; return what ``train.py`` printed."""
    training, log = TRAININGS[peer], folder / f"{peer}.log"
    if log.exists():
        return log.read_text()
    store = folder / f"{'overhead' if training.generate is OVERHEAD else 'video'}.zarr"
    generate = [sys.executable, "-m", "grasp_factory", "generate", "--out", str(store), "--quiet"]
    subprocess.run([*generate, *training.generate], check=True)
    export = folder / peer
    if not export.exists():
        Dataset(store).export(training.format, export)
    command = [
        python_of(HERE / peer),
        str(HERE / peer / "train.py"),
        str(export),
        *training.arguments,
    ]
    env = {**os.environ, "PYTHONPATH": source_of(peer)}
    unfinished = folder / f"{peer}.log.part"
    with unfinished.open("w") as file:
        subprocess.run(command, check=True, env=env, stdout=file)
    unfinished.rename(log)
    return log.read_text()


def draw(path: Path, printed: Mapping[str, str]) -> None:
    """Draw the losses of each peer, with a panel for each."""
    figure = Figure(figsize=(4.0 * len(printed), 3.2), layout="constrained")
    panels = figure.subplots(1, len(printed), squeeze=False)[0]
    for ax, (peer, text) in zip(panels, printed.items(), strict=True):
        rows = [match.groups() for match in LINE.finditer(text)]
        counts = [int(count) for count, _, _ in rows]
        ax.plot(counts, [float(loss) for _, loss, _ in rows], marker=".", label="training")
        if tested := [float(loss) for _, _, loss in rows if loss]:
            ax.plot(counts, tested, marker=".", label="validation")
            ax.legend()
        training = TRAININGS[peer]
        ax.set(title=f"{training.title} on {training.format}", xlabel=training.unit)
        ax.set_ylabel("loss")
        ax.set_ylim(bottom=0)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def main() -> None:
    folder, *peers = sys.argv[1:]
    Path(folder).mkdir(parents=True, exist_ok=True)
    printed = {peer: run(peer, Path(folder)) for peer in peers or TRAININGS}
    for text in printed.values():
        print(text)
    draw(Path(folder) / "losses.png", printed)


if __name__ == "__main__":
    main()
