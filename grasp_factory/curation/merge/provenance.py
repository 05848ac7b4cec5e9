"""Provenance of a store's rows by seed: the root attribute ``sources``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.core.serialization import from_plain
from grasp_factory.curation.merge.union import RowPlan
from grasp_factory.errors import ConfigError, StoreError
from grasp_factory.writers.zarr.header import SOURCES

GENERATORS = ("grasp_factory", "pybullet", "numpy", "torch")
"""Packages whose versions affect an episode's bytes; torch does if a policy has a model."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Maker:
    """Versions and platform that episodes were made with, and the platform's fingerprint."""

    versions: Mapping[str, str]
    platform: Mapping[str, str]
    fingerprint: Mapping[str, str] = field(default_factory=dict)
    """Of the platform that began the store; empty if its version recorded no fingerprints."""

    @property
    def generators(self) -> dict[str, str]:
        """The versions that decide the bytes."""
        return {name: self.versions.get(name, "unknown") for name in GENERATORS}

    @property
    def rest(self) -> dict[str, str]:
        """Versions and platform facts that should not affect the bytes."""
        versions = {k: v for k, v in self.versions.items() if k not in GENERATORS}
        return {**versions, **self.platform}


@dataclass(frozen=True, slots=True, kw_only=True)
class SeedSource:
    """Where the rows of one seed come from; without paths, hosts and times."""

    seed: int
    rows: int
    """Number of committed and quarantined rows."""
    config_sha256: str
    """Of the config with this seed."""
    made_with: tuple[Maker, ...]
    """One maker, or several if the seed's blocks were made on several platforms."""


def makers_of(path: Path, attributes: Mapping[str, Any], seed: int) -> dict[int, tuple[Maker, ...]]:
    """Return the makers of a store's rows by seed, in the order of its seeds.

    Args:
        path: the store's path.
        attributes: the root's attributes.
        seed: the config's seed, which all rows have unless the store was merged or split.

    Raises:
        StoreError: if the attributes are damaged.
    """
    try:
        if SOURCES in attributes:
            return {source.seed: source.made_with for source in stored_sources(attributes)}
        keys = ("versions", "platform", FINGERPRINT)
        facts = {key: attributes[key] for key in keys if key in attributes}
        return {seed: (from_plain(Maker, facts),)}
    except (ConfigError, StoreError) as error:
        raise StoreError(f"{path} is damaged: zarr.json: {error}") from None


def stored_sources(attributes: Mapping[str, Any]) -> tuple[SeedSource, ...]:
    """Return the sources in the root attributes of a merged or split store, seed by seed.

    Raises:
        StoreError: if they are damaged.
    """
    try:
        return tuple(from_plain(SeedSource, item) for item in attributes[SOURCES])
    except (ConfigError, KeyError, TypeError) as error:
        raise StoreError(f"attribute {SOURCES} is damaged: {error}") from None


def seed_sources(
    plan: RowPlan, makers: Sequence[Mapping[int, tuple[Maker, ...]]], config: FactoryConfig
) -> tuple[SeedSource, ...]:
    """Return the provenance of a plan's rows, seed by seed in their order.

    Args:
        plan: rows that all come from a store.
        makers: of each store, by seed.
        config: the stores' config; only the seed differs.
    """
    seeds, first, counts = np.unique(plan.seed, return_index=True, return_counts=True)
    out = []
    for k in np.argsort(first):
        seed = int(seeds[k])
        used = np.unique(plan.store[plan.seed == seed]).tolist()
        own = replace(config, seed=seed)
        made_with = once(maker for store in used for maker in makers[store][seed])
        out.append(
            SeedSource(
                seed=seed, rows=int(counts[k]), config_sha256=own.sha256(), made_with=made_with
            )
        )
    return tuple(out)


def generator_difference(a: Maker, b: Maker) -> str:
    """Return how the versions that decide an episode's bytes differ; empty if they do not."""
    return first_difference(a.generators, b.generators) or ""


def surroundings_difference(a: Maker, b: Maker) -> str:
    """Return how other versions and platform facts that both have differ; empty if not."""
    known = a.rest.keys() & b.rest.keys()
    mine, others = ({k: v for k, v in maker.rest.items() if k in known} for maker in (a, b))
    return first_difference(mine, others) or ""


def once(makers: Iterable[Maker]) -> tuple[Maker, ...]:
    """Return each of several makers once, in their order."""
    out: list[Maker] = []
    for maker in makers:
        if maker not in out:
            out.append(maker)
    return tuple(out)
