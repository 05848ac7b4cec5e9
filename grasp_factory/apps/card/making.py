"""Making the files of a card from its store."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from grasp_factory import __version__
from grasp_factory.apps.card import figures
from grasp_factory.apps.card.croissant import Described, TableFile, croissant
from grasp_factory.apps.card.facts import CardFacts, read_facts
from grasp_factory.apps.card.folder import README, check_folder, digest, foreign_files, place, seal
from grasp_factory.apps.card.licences import LICENCES, UNKNOWN
from grasp_factory.apps.card.limits import known_limits
from grasp_factory.apps.card.markdown import word
from grasp_factory.apps.card.publication import Publication
from grasp_factory.apps.card.readme import (
    CONFIG_FILE,
    MEASURES,
    OUTCOMES,
    SHEET,
    Contents,
    config_text,
    readme,
)
from grasp_factory.apps.card.table import write_table
from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.apps.pictures.sheet import choose_episodes, sheet_of, write_png
from grasp_factory.core.place import place_at
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import array_facts
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.files import cannot_write, locate

CROISSANT, TABLE = "croissant.json", "episodes.csv"
FILES = (README, CONFIG_FILE, CROISSANT, TABLE, SHEET, OUTCOMES, MEASURES)
"""All files of a card."""
SUFFIX = ".card"
"""Suffix of the name of a card's folder next to its store."""
_SHOWN = 6
"""Episodes of the contact sheet."""
_OF_SIMULATION = ("simulation", "pybullet")
_TAGS = (
    *("robotics", "grasping", "manipulation", "simulation", "pybullet", "zarr", "tactile"),
    *("force-torque", "depth", "rgb-d"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """A card that was written."""

    path: str
    """The folder."""
    files: tuple[str, ...]
    episodes: int
    missing: int
    """Rows that the store did not have yet."""
    licence: str


def write_card(
    path: Path,
    out: Path | None = None,
    publication: Publication | None = None,
    *,
    force: bool = False,
) -> Card:
    """Describe a store: a README for the Hub, Croissant, the episodes as a table, and figures.

    The output depends only on the store and the arguments. The store is only read.

    Args:
        path: The store.
        out: The folder to write to; ``<store>.card`` next to the store if it is None.
        publication: The facts that the publisher states.
        force: Replace files that a person wrote or changed.

    Raises:
        StoreMismatchError: if there is no store.
        UsageError: for a store without episodes, a folder that cannot be used, or a folder with
            files that no card has written.
        StoreError: if the store is damaged, or nothing can be written to the disk.
    """
    dataset, store = Dataset(path), locate(path)
    folder = store.with_name(store.name + SUFFIX) if out is None else out
    check_folder(folder, store)
    try:
        target = place_at(folder)
        if not force and (foreign := foreign_files(target, FILES)):
            what = f"{folder}: {', '.join(foreign)} not written by this command, or changed since"
            raise UsageError(f"{what}; --force replaces them, --out names another folder")
        facts = read_facts(dataset)
        described = _describe(dataset, store, facts, publication or Publication())
        target.mkdir(exist_ok=True)
        with scratch_folder(folder, "card") as scratch:
            made = _make_files(scratch, dataset, facts, described, _below(store, folder))
            place(made, target)
    except OSError as error:
        raise cannot_write(folder, error) from None
    return Card(
        path=str(folder),
        files=FILES,
        episodes=facts.total.episodes,
        missing=facts.missing,
        licence=described.licence,
    )


def _make_files(
    scratch: Path, dataset: Dataset, facts: CardFacts, described: Described, store: str
) -> dict[str, Path]:
    """Make every file of a card in an empty folder; return them by name, the README last."""
    files = {name: scratch / name.replace("/", "_") for name in FILES}
    write_table(files[TABLE], facts.table)
    digests = {TABLE: digest(files[TABLE])}
    table = TableFile(
        name=TABLE,
        size=files[TABLE].stat().st_size,
        sha256=digests[TABLE],
        columns=facts.table,
    )
    config = dataset.config
    files[CROISSANT].write_text(croissant(described, table, store), encoding="utf-8")
    files[CONFIG_FILE].write_text(config_text(config), encoding="utf-8")
    for name, draw in _drawings(dataset, facts).items():
        write_png(files[name], draw())
    contents = Contents(
        described=described,
        facts=facts,
        config=config,
        attributes=dataset.attributes,
        arrays=tuple(array_facts(dataset)),
        store=store,
        table=TABLE,
    )
    digests |= {name: digest(file) for name, file in files.items() if file.exists()}
    files[README].write_text(seal(readme(contents), digests), encoding="utf-8")
    return {name: files[name] for name in (*FILES[1:], README)}


def _drawings(dataset: Dataset, facts: CardFacts) -> dict[str, Callable[[], BgrImage]]:
    values, label = facts.values(), dataset.config.label
    chosen = values["row"][choose_episodes(values["success"], _SHOWN)].tolist()
    return {
        SHEET: lambda: sheet_of(dataset, chosen, next(iter(dataset.config.cameras))),
        OUTCOMES: lambda: figures.outcomes_chart(facts.outcomes),
        MEASURES: lambda: figures.measures_chart(values, label),
    }


def _describe(
    dataset: Dataset, store: Path, facts: CardFacts, publication: Publication
) -> Described:
    config, attributes = dataset.config, dataset.attributes
    total, real = facts.total, facts.real
    sentence = (
        f"{total.episodes} grasp attempts of a {word(config.robot)} on {total.objects} objects,"
        f" {_origin(facts)}: images, touch over time, and the outcome of each with the"
        " measurements behind it."
    )
    stated = str(attributes.get("license", "")).lower()
    # Such a store contains users' meshes, whose licence is not known.
    own = stated if stated in LICENCES and not config.object_folders else UNKNOWN
    return Described(
        name=publication.name or _text(store.name.removesuffix(".zarr") or store.name),
        description=publication.description or sentence,
        licence=publication.licence or own,
        url=publication.url,
        date_published=publication.date_published,
        version=publication.version,
        keywords=(
            *(tag for tag in _TAGS if real < total.episodes or tag not in _OF_SIMULATION),
            config.robot,
        ),
        limits=known_limits(config, real=real, episodes=total.episodes),
        made_with=str(attributes.get("created_by", f"grasp-factory {__version__}")),
    )


def _origin(facts: CardFacts) -> str:
    """Return where the episodes come from."""
    simulated = facts.total.episodes - facts.real
    if not facts.real:
        return "simulated in PyBullet"
    recorded = "recorded with real sensors"
    return (
        f"{simulated} simulated in PyBullet and {facts.real} {recorded}" if simulated else recorded
    )


def _below(store: Path, folder: Path) -> str:
    """Return the store's path relative to the card's folder, or its name if it is not inside."""
    here = locate(folder)
    path = store.relative_to(here).as_posix() if here in store.parents else store.name
    return _text(path)


def _text(path: str) -> str:
    """Return a path as text that can be encoded; bytes that are not valid text become ``?``."""
    return path.encode(errors="replace").decode()
