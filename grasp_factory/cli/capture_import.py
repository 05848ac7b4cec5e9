"""The command that makes a store of a recorded session: ``capture import``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say, say_lines
from grasp_factory.core.optional import require
from grasp_factory.core.serialization import from_plain, to_plain
from grasp_factory.core.text_format import count
from grasp_factory.errors import UsageError

if TYPE_CHECKING:
    from grasp_factory.capture.importing.importing_store import ImportedRow, ImportedSession
    from grasp_factory.core.config.factory_config import FactoryConfig

_PATH = click.Path(path_type=Path)


@click.command(
    name="import",
    cls=Command,
    examples=(
        "grasp-factory capture import session_1 --out real.zarr",
        "grasp-factory capture import session_1 --out real.zarr --min-quality 4",
        "grasp-factory capture import session_1 --out r.zarr --cuts c.csv --like g.zarr",
    ),
)
@click.argument("session", type=_PATH)
@option("--out", metavar="STORE", type=_PATH, required=True, help="The store to make.")
@option(
    "--cut",
    type=click.Choice(["events", "gripper"]),
    help="What says where episodes begin and end.  [default: events]",
)
@option(
    "--cuts",
    metavar="FILE",
    type=_PATH,
    help="CSV file of episodes: start,end in seconds from the session's start, and outcome.",
)
@option("--settings", "file", metavar="FILE", type=_PATH, help="YAML file of import settings.")
@option(
    "--min-quality",
    type=click.IntRange(1, 5),
    metavar="SCORE",
    help="Quarantine episodes of a lower quality, 1 to 5.  [default: 1]",
)
@option("--config", metavar="FILE", type=_PATH, help="YAML config of the store.")
@option("--like", metavar="STORE", type=_PATH, help="Take the config of this store, to merge both.")
@AS_JSON
def capture_import(
    session: Path,
    out: Path,
    *,
    cut: str | None,
    cuts: Path | None,
    file: Path | None,
    min_quality: int | None,
    config: Path | None,
    like: Path | None,
    as_json: bool,
) -> None:
    """Make a store of a recorded session.

    Cuts the session into episodes, labels each, and writes them to a new store. What was not
    measured is NaN or 255 in it. An episode without a label, or of too low quality, is quarantined.
    """
    require("mcap", "rosbags", extra="capture")
    from grasp_factory.capture.importing.cuts import read_cuts
    from grasp_factory.capture.importing.import_settings import ImportSettings
    from grasp_factory.capture.importing.importing_store import import_session
    from grasp_factory.core.config.yaml_loader import read_yaml

    if cut and cuts:
        raise UsageError("--cut and --cuts: choose one")
    plain: dict[str, Any] = dict(read_yaml(file)) if file else {}
    if cut or cuts:
        plain["cut"] = cut or "list"
    if min_quality is not None:
        plain["quality"] = {**(plain.get("quality") or {}), "min_score": min_quality}
    settings = from_plain(ImportSettings, plain, "settings")
    progress = _EpisodeProgress(show=not as_json)
    found = import_session(
        session,
        out,
        settings,
        base=_base(config, like),
        listed=read_cuts(cuts) if cuts else (),
        on_start=progress.start,
        on_row=progress.add,
    )
    if as_json:
        print_json(to_plain(found))
    else:
        say_lines(_lines(found))


def _base(config: Path | None, like: Path | None) -> FactoryConfig | None:
    from grasp_factory.core.config.factory_config import FactoryConfig
    from grasp_factory.core.config.yaml_loader import read_yaml
    from grasp_factory.dataset.dataset import Dataset

    if config and like:
        raise UsageError("--config and --like: choose one")
    if like:
        return Dataset(like).config
    return FactoryConfig.from_plain(read_yaml(config)) if config else None


class _EpisodeProgress:
    """Says each episode when it is made, on stderr."""

    def __init__(self, *, show: bool) -> None:
        self._show, self._of = show, 0

    def start(self, episodes: int) -> None:
        """Take how many there are."""
        self._of = episodes

    def add(self, row: ImportedRow) -> None:
        """Say what became of an episode."""
        if self._show:
            where = f"{row.start_s:.3f} s, {row.duration_s:.3f} s long"
            why = f" ({row.reason})" if row.reason else ""
            say(f"episode {row.index + 1} of {self._of}: at {where}: {row.outcome}{why}", err=True)


def _lines(found: ImportedSession) -> Iterator[str]:
    outcomes = Counter(row.outcome for row in found.rows)
    told = ", ".join(f"{number} {name}" for name, number in sorted(outcomes.items()))
    yield f"{found.path}: {count(found.committed, 'real episode')} of {found.session} ({told})"
