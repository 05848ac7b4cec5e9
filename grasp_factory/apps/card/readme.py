"""The card for people and for the Hub: Markdown with a YAML front matter."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from grasp_factory.apps.card.croissant import RECORDS, Described
from grasp_factory.apps.card.facts import CardFacts, Group
from grasp_factory.apps.card.markdown import details, escape, fenced, table, word
from grasp_factory.apps.card.meanings import MEANINGS, label_conditions, thresholds_text
from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.platforms import FINGERPRINT, fingerprint_of
from grasp_factory.core.text_format import count, escaped, percent, size_text
from grasp_factory.curation.merge.provenance import stored_sources
from grasp_factory.writers.zarr.header import SOURCES

CONFIG_FILE = "config.yaml"
SHEET, OUTCOMES, MEASURES = (f"figures/{name}.png" for name in ("sheet", "outcomes", "measures"))
MOST_ROWS = 30
"""Maximum rows of a table of words or reasons."""
_LONGEST_UNIT = 100
"""Characters of a unit that are shown."""
_SIZES = ("1K", "10K", "100K", "1M", "10M", "100M", "1B", "10B")
"""The limits of the Hub's size categories."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """The data that the card is made from."""

    described: Described
    facts: CardFacts
    config: FactoryConfig
    attributes: Mapping[str, Any]
    """The attributes of the store's root group."""
    arrays: tuple[Mapping[str, Any], ...]
    """Path, shape, dtype and units of each array of the store."""
    store: str
    """Path of the store, relative to the folder of the card."""
    table: str
    """The name of the file with the episodes."""


def readme(contents: Contents) -> str:
    """Return the card's text."""
    sections = (
        _head(contents),
        _counts(contents),
        _label(contents),
        _loading(contents),
        _origin(contents),
        _limits(contents),
    )
    parts = [front_matter(contents), *(part for section in sections for part in section)]
    return "\n\n".join(parts) + "\n"


def front_matter(contents: Contents) -> str:
    """Return the metadata that the Hub reads, between lines of dashes."""
    data_files = [{"split": RECORDS, "path": contents.table}]
    metadata = {
        "license": contents.described.licence,
        "pretty_name": escaped(contents.described.name),
        "task_categories": ["robotics"],
        "tags": list(map(escaped, contents.described.keywords)),
        "size_categories": [size_category(contents.facts.total.episodes)],
        "configs": [{"config_name": RECORDS, "data_files": data_files}],
    }
    text = yaml.safe_dump(metadata, sort_keys=False, allow_unicode=True, width=10_000)
    return f"---\n{text}---"


def size_category(episodes: int) -> str:
    """Return the Hub's size category for a number of examples."""
    place = len(str(episodes)) - 4
    return "n<1K" if place < 0 else f"{_SIZES[place]}<n<{_SIZES[place + 1]}"


def config_text(config: FactoryConfig) -> str:
    """Return a config as a file that ``generate --config`` takes."""
    return yaml.safe_dump(config.to_plain(), sort_keys=False, default_flow_style=None, width=100)


def _head(contents: Contents) -> Iterator[str]:
    described, facts = contents.described, contents.facts
    yield f"# {escape(described.name)}"
    yield described.description
    made = f"Version {described.version}, made with {escape(described.made_with)}"
    if described.date_published:
        made += f", published {described.date_published}"
    parts = [f"{made}.", f"Licence: `{described.licence}`."]
    if contents.config.object_folders:
        sets = ", ".join(map(word, contents.config.object_folders))
        parts.append(f"The objects of {sets} are their makers': see their licences as well.")
    if described.url:
        parts.append(f"Page: <{described.url}>.")
    yield " ".join(parts)
    yield f"![Episodes before and after, with depth and segmentation]({SHEET})"
    rows = [
        ("episodes", facts.total.episodes),
        ("success", f"{facts.total.successes} ({_rate(facts.total)})"),
        ("objects", facts.total.objects),
        ("robot", word(contents.config.robot)),
        ("cameras", ", ".join(map(word, contents.config.cameras))),
        ("images", "{} x {} pixels".format(*contents.config.resolution)),
        ("size of the store", size_text(facts.bytes)),
    ]
    yield table(("", ""), rows)
    if facts.missing:
        yield (
            f"**{facts.missing} of {facts.rows} rows are missing**: the store was not complete when"
            " this card was written."
        )


def _counts(contents: Contents) -> Iterator[str]:
    facts = contents.facts
    yield "## Splits"
    objects = sum(group.objects for group in facts.groups["split"])
    if objects == facts.total.objects:
        yield "Splits are by object: no object is in two of them."
    else:
        yield f"{objects - facts.total.objects} objects are in more than one split."
    yield _groups_table("split", facts.groups["split"])
    yield "## Class balance"
    yield f"![Episodes by outcome]({OUTCOMES})"
    outcomes = [
        (word(w), n, percent(n / facts.total.episodes), MEANINGS[Outcome[w.upper()]])
        for w, n in facts.outcomes.items()
    ]
    yield table(("outcome", "episodes", "share", "the attempt ended because"), outcomes, (1, 2))
    for column, groups in facts.groups.items():
        if column != "split":
            yield _groups_table(column.replace("_", " "), groups)
    if facts.quality:
        yield "## Quality"
        yield (
            "Each episode has a score from 1 to 5, the best, by the thresholds in the config's"
            " section `quality`."
        )
        scores = [
            (score, n, percent(n / facts.total.episodes)) for score, n in facts.quality.items()
        ]
        yield table(("score", "episodes", "share"), scores, (0, 1, 2))
    if facts.quarantined:
        yield "## Quarantined episodes"
        yield (
            f"{count(facts.quarantined, 'row')} of {facts.rows} hold no episode: only the recipe"
            " and the reason are kept. They are not in the counts above."
        )
        reasons = [(n, word(reason[:300])) for reason, n in facts.reasons.items()]
        yield table(("rows", "reason"), _most(reasons), (0,))


def _label(contents: Contents) -> Iterator[str]:
    yield "## The label"
    yield "`success` is true, and `outcome` is `success`, if"
    yield "\n".join(f"- {condition}" for condition in label_conditions(contents.config))
    yield (
        "The measurements behind it are columns, so that the line can be drawn elsewhere:"
        " `grasp-factory relabel` does, without simulating again."
    )
    yield f"![Histograms of the measurements behind the label]({MEASURES})"
    if contents.facts.labels:
        yield "Labels that were added, as columns `labels/NAME`:"
        rows = [
            (word(x.name), x.episodes, percent(x.successes / x.episodes if x.episodes else None),
             word(thresholds_text(x.thresholds)))
            for x in contents.facts.labels
        ]  # fmt: skip
        yield table(("label", "episodes", "success", "thresholds"), rows, (1, 2))


def _loading(contents: Contents) -> Iterator[str]:
    camera = next(iter(contents.config.cameras))
    store = escaped(json.dumps(contents.store, ensure_ascii=False))  # Python has JSON's escapes
    first = int(contents.facts.values()["row"][0])
    yield "## Load it"
    ours = f"""\
from grasp_factory import Dataset

ds = Dataset({store})
train = ds.where(split="train", success=True)  # a dataset of these episodes
episode = ds[{first}]
camera = episode.cameras["{camera}"]  # rgb, depth, segmentation: before and after
touch = episode.streams["tactile_wrench"]  # (steps, 2 pads, 6)"""
    yield fenced(ours, "python")
    plain = f"""\
import zarr  # 3, and nothing of ours

root = zarr.open({store}, mode="r")
before = root["cameras/{camera}/rgb"][{first}, 0]  # (height, width, 3)
outcome = root["episodes/outcome"]
word = outcome.attrs["names"][int(outcome[{first}])]"""
    yield fenced(plain, "python")
    yield (
        f"`{contents.table}` has the columns with one value an episode, and `croissant.json`"
        " describes it for machines. Its `row` is the episode's place in the store. Units are SI,"
        " quaternions xyzw, cameras OpenCV."
    )
    descriptions = {f.path: f.description for f in schema.expand(contents.config)}
    rows = [
        (word(a["path"]), " x ".join(map(str, a["shape"])), a["dtype"],
         escape(str(a["units"])[:_LONGEST_UNIT]), descriptions.get(a["path"], ""))
        for a in contents.arrays
    ]  # fmt: skip
    arrays = table(("array", "shape", "type", "unit", "what"), rows)
    yield details(f"All {len(rows)} arrays of the store", arrays)


def _origin(contents: Contents) -> Iterator[str]:
    attributes, config = contents.attributes, contents.config
    yield "## How it was made"
    if SOURCES in attributes:
        yield (
            "The store was put together from others. Each row's recipe is in `episodes/spec`, and"
            " `grasp-factory replay` runs it again."
        )
        sources = [(s.seed, s.rows, word(s.config_sha256)) for s in stored_sources(attributes)]
        yield table(("seed", "rows", "SHA-256 of the config"), _most(sources), (0, 1))
    else:
        yield (
            f"Every episode follows from the config, the seed ({config.seed}) and its number. This"
            " makes them again:"
        )
        if config.object_folders:
            sets = ", ".join(map(word, config.object_folders))
            yield f"(`grasp-factory objects DIR` first, with the folder of each of {sets})"
        for policy, sha256 in config.models.items():
            yield f"(with the trained model of {word(policy)}, SHA-256 {word(sha256)})"
        name = shlex.quote(escaped(contents.store.rpartition("/")[2]))
        command = f"grasp-factory generate --config {CONFIG_FILE} --n {contents.facts.rows}"
        yield fenced(f"{command} --out {name}", "")
    facts = {**attributes["versions"], **attributes["platform"]}
    if known := fingerprint_of(attributes):
        facts[FINGERPRINT] = str(known)
    facts["config_sha256"] = attributes["config_sha256"]
    yield table(("made with", ""), [(word(k), word(str(v))) for k, v in facts.items()])
    if len(contents.facts.platforms) > 1:
        yield "Its rows were made on several platforms, which `episodes/fingerprint` tells:"
        rows = [(n, word(known)) for known, n in contents.facts.platforms.items()]
        yield table(("rows", "fingerprint"), _most(rows), (0,))
    yield details("The config", fenced(config_text(config), "yaml"))


def _limits(contents: Contents) -> Iterator[str]:
    yield "## Known limits"
    yield "\n".join(f"- {limit}" for limit in contents.described.limits)


def _groups_table(title: str, groups: Iterable[Group]) -> str:
    rows = [(word(g.word), g.objects, g.episodes, g.successes, _rate(g)) for g in groups]
    head = (title, "objects", "episodes", "successes", "success")
    return table(head, _most(rows), (1, 2, 3, 4))


def _most(rows: list[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """Return the first rows, and one that counts the others."""
    more = len(rows) - MOST_ROWS
    if more <= 0:
        return rows
    return [*rows[:MOST_ROWS], (f"and {more} more", *[""] * (len(rows[0]) - 1))]


def _rate(group: Group) -> str:
    return percent(group.successes / group.episodes if group.episodes else None)
