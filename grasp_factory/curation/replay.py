"""Running a stored recipe again, to check whether it still yields the stored episode."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from grasp_factory.core.episode import Episode
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.platforms import (
    Fingerprint,
    differing,
    fingerprint_of,
    meaning,
    parsed,
)
from grasp_factory.core.simulated_row import with_room_for_real
from grasp_factory.curation import isolation
from grasp_factory.curation.episode_distance import (
    Arrays,
    EpisodeDistance,
    episode_distance,
    first_different,
)
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.row_reader import RowReader
from grasp_factory.dataset.selection import check_index
from grasp_factory.errors import RecipeError, StoreError, UsageError
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.plugins import activate, check_given
from grasp_factory.simulation.fingerprint import fingerprint
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.made_with import changed_since, changed_versions


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """The result of running a stored recipe again."""

    index: int
    same: bool
    """Every array has the same bytes."""
    recorded: str
    """Outcome, or why the recipe could not be built."""
    replayed: str
    difference: str
    """The first array that differs, and how; empty when none does."""
    changed: tuple[str, ...]
    """Versions and platform facts that differ from those of the recording."""
    has_other_versions: bool
    """Whether versions are among them."""
    fingerprint: str
    """Fingerprint of the platform that made the row; empty if the store does not record it."""
    here: str
    """The fingerprint of this platform."""
    differing: tuple[str, ...]
    """Parts in which these two differ."""
    distance: EpisodeDistance | None
    """How far apart the two episodes are; None if they are the same, or one is quarantined."""
    is_imported: bool = False
    """Whether a real episode was imported again from its session."""

    @property
    def platform(self) -> str:
        """One line on how the platform affects the result; empty if there is nothing to report."""
        if self.is_imported:
            return ""
        if not self.fingerprint:
            what = "the store does not tell which platform made the episode"
            return f"{what}: whether bytes must be the same here is not known"
        if self.differing:
            what = f"the fingerprint differs from the recording's in {meaning(self.differing)}"
            return f"{what}: bytes need not be the same here; compare where it was recorded"
        if self.same:
            return ""
        if self.has_other_versions:
            return "the fingerprint is the recording's: it is not the platform, but the versions"
        return (
            "fingerprint and versions are the recording's, so the bytes should be the same: run"
            " `grasp-factory verify`, and try again. If it stays, check code of your own, such as a"
            " policy that draws without `rng`, with `grasp-factory conformance`; else report it"
        )


def _ignore(message: Any) -> None:
    """Ignore a message: a replay reports nothing."""


def replay(path: Path, index: int) -> Replay:
    """Run the recipe of one stored episode in a fresh world, in a process of its own, and compare.

    Raises:
        UsageError: for an index that the store does not have, or an episode not made yet.
        StoreError: if the stored episode is damaged, or its recipe ends the process.
        LimitError: if its recipe needs more memory or time than the limits allow.
    """

    def stop(job: int, why: str) -> int:
        raise StoreError(f"episode {job} of {path}: {isolation.ended(why)}")

    check_given(Dataset(path).config)
    task = partial(replay_here, path)
    (result,) = isolation.isolated().run(task, [index], _ignore, stop, isolation.patience)
    return result


def replay_import(path: Path, index: int, session: Path) -> Replay:
    """Import one real episode again from its session, and compare.

    A process with limits reads the session.

    Raises:
        UsageError: for an index that the store does not have, or a simulated episode.
        CaptureError: if it is another session, or a damaged one.
        StoreError: if the stored episode is damaged.
    """
    from grasp_factory.capture.importing.importing_store import import_again  # noqa: PLC0415

    dataset = Dataset(path)
    index = check_index(dataset, index)
    spec = dataset.spec(index)
    if spec.recording is None:
        raise UsageError(f"episode {index} of {path} is simulated: replay it without --session")
    stored = _stored(dataset, index)
    again = import_again(session, spec, dataset.config)
    before: Arrays = stored.contents() if isinstance(stored, Episode) else {}
    after: Arrays = again.contents() if isinstance(again, Episode) else {}
    recorded, replayed = _words(stored), _words(again)
    difference = first_different(before, after)
    changed = tuple(changed_since(dataset.attributes))
    return Replay(
        index=index,
        same=not difference and recorded == replayed,
        recorded=recorded,
        replayed=replayed,
        difference=difference,
        changed=changed,
        has_other_versions=bool(changed_versions(dataset.attributes)),
        fingerprint="",
        here="",
        differing=(),
        distance=_distance(stored, again) if difference else None,
        is_imported=True,
    )


def _stored(dataset: Dataset, index: int) -> Episode | Quarantined:
    """Return a row as it is stored.

    Raises:
        StoreError: if it is damaged.
    """
    (row,) = RowReader(dataset.path).read(index, index + 1)
    return row.content


def _distance(a: Episode | Quarantined, b: Episode | Quarantined) -> EpisodeDistance | None:
    is_pair = isinstance(a, Episode) and isinstance(b, Episode)
    return episode_distance(a, b) if is_pair else None  # type: ignore[arg-type]


def _words(row: Episode | Quarantined) -> str:
    return row.outcome.name.lower() if isinstance(row, Episode) else row.reason


def replay_here(path: Path, index: int, report: SendMessage = _ignore) -> Replay:
    """Do as ``replay`` does, in this process. Nothing is reported."""
    dataset = Dataset(path)
    index = check_index(dataset, index)
    check_simulated(dataset, index)
    embedded_assets.unpack(path, dataset.config)
    activate(dataset.config)
    known, here = made_on(dataset, index), fingerprint(dataset.config)
    quarantined = dataset.status[index] == 2
    recorded = str(dataset.column("error")[index]) if quarantined else ""
    before: Arrays = {}
    stored: Episode | None = None
    again: Episode | None = None
    if not quarantined:
        if not dataset.verify(index):
            raise StoreError(f"{path} is damaged: episode {index} does not match its checksum")
        stored = dataset[index]
        before, recorded = stored.contents(), stored.outcome.name.lower()
    try:
        with World(dataset.config.renderer) as world:
            made = run_episode(world, dataset.spec(index))
        again = with_room_for_real(made, dataset.config)
        after, replayed = again.contents(), again.outcome.name.lower()
        if before:  # a store from before a sensor was added lacks its arrays
            after = {path: values for path, values in after.items() if path in before}
    except RecipeError as error:
        after, replayed = {}, str(error)
    difference = first_different(before, after)
    return Replay(
        index=index,
        same=not difference and recorded == replayed,
        recorded=recorded,
        replayed=replayed,
        difference=difference,
        changed=tuple(changed_since(dataset.attributes)),
        has_other_versions=bool(changed_versions(dataset.attributes)),
        fingerprint=str(known or ""),
        here=str(here),
        differing=differing(known, here) if known else (),
        distance=episode_distance(stored, again) if difference and stored and again else None,
    )


def check_simulated(dataset: Dataset, index: int) -> None:
    """Check that a row can be simulated again.

    Raises:
        UsageError: for a real episode, which needs its session.
    """
    source = dataset.spec(index).recording
    if source is not None:
        raise UsageError(
            f"episode {index} of {dataset.path} is a real one: add --session FOLDER, the session"
            f" {source.session} that it was imported from"
        )


def made_on(dataset: Dataset, index: int) -> Fingerprint | None:
    """Return the fingerprint of the platform that made a row; None if it is not recorded."""
    if "fingerprint" not in dataset.columns:
        return fingerprint_of(dataset.attributes)
    return parsed(str(Columns.open(dataset.path).read_rows("fingerprint", index, index + 1)[0]))
