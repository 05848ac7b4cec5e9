"""Merging several stores into one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from grasp_factory.curation.merge.building import Order, base_of, build
from grasp_factory.curation.merge.platform_check import check_platforms
from grasp_factory.curation.merge.provenance import (
    Maker,
    generator_difference,
    seed_sources,
    surroundings_difference,
)
from grasp_factory.curation.merge.repeat_check import check_repeats
from grasp_factory.curation.merge.result import Collected
from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.staged_store import StagedStore
from grasp_factory.curation.merge.union import in_place, union
from grasp_factory.curation.versions.origin import states_of, write_origin
from grasp_factory.errors import StoreMismatchError, UsageError


def merge(
    stores: Iterable[Path | str],
    out: Path | str,
    *,
    accept_other_platform: bool = False,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[], None] = lambda: None,
) -> Collected:
    """Copy the rows of several stores of one config into a new store.

    If all stores are parts of one seed's dataset, the result is that dataset, and each row keeps
    its number. Otherwise the rows are grouped by seed, and the result has the root attribute
    ``sources``. The result takes its seed and root attributes from the first store, or from the
    first that may hold real episodes, if there is one: rows of other stores have no samples of
    real devices there.

    Args:
        stores: paths of stores whose configs differ in the seed, and in having ``capture``, at
            most. Other processes may write to them meanwhile; only blocks that are committed when a
            store is opened are merged.
        out: a path where nothing exists yet, or an empty directory.
        accept_other_platform: also merge rows of one seed whose fingerprints differ.
        on_start: called with the number of rows to copy, after every check.
        on_row: called for each row when it has been written, read back and compared.

    Raises:
        UsageError: for stores that cannot be merged, or an output path that is taken.
        StoreError: if a store is damaged, two of them differ in an episode that both have, or the
            disk fails. Nothing is left then.
    """
    place = StagedStore(out)
    sources = _open(stores)
    place.check_apart(source.place for source in sources)
    found = union([source.present() for source in sources])
    check_repeats(sources, found)
    of_platforms = check_platforms(sources, accept=accept_other_platform)
    seeds = {source.config.seed for source in sources}
    is_plain = len(seeds) == 1 and not any(source.is_collected for source in sources)
    if not (is_plain or len(found.plan)):
        raise UsageError("the stores have no episodes: there is nothing to merge")
    first = base_of(sources).config
    plan = in_place(found.plan, first.seed, max(map(len, sources))) if is_plain else found.plan
    order = Order(
        place=place,
        sources=sources,
        plan=plan,
        seeds=seed_sources(found.plan, [s.makers for s in sources], first),
        is_plain=is_plain,
        repeats=found.repeats,
        warnings=(*of_platforms, *_warnings(sources)),
    )
    states = states_of(source.path for source in sources)
    result = build(order, on_start, on_row)
    write_origin(out, "merge", states)
    return result


def _open(stores: Iterable[Path | str]) -> list[SourceStore]:
    sources = [SourceStore(store) for store in stores]
    if not sources:
        raise UsageError("no stores: name one or more to merge")
    seen: dict[tuple[int, int], SourceStore] = {}
    for source in sources:
        stat = source.place.stat()
        twin = seen.setdefault((stat.st_dev, stat.st_ino), source)
        if twin is not source:
            raise UsageError(f"{source.path} is the same store as {twin.path}: name it once")
        source.check_fits(sources[0])
    _check_generators(sources)
    return sources


def _check_generators(sources: Sequence[SourceStore]) -> None:
    """Check that the same generator versions made all episodes of a seed."""
    made: dict[int, tuple[Maker, SourceStore]] = {}
    for source in sources:
        for seed, makers in source.makers.items():
            for maker in makers:
                before, other = made.setdefault(seed, (maker, source))
                if found := generator_difference(maker, before):
                    raise StoreMismatchError(
                        f"{source.path} and {other.path} hold episodes of seed {seed} that other"
                        f" versions made ({found}): make one of them again, with another seed or"
                        " with those versions"
                    )


def _warnings(sources: Sequence[SourceStore]) -> Iterable[str]:
    """Yield a warning for each store that made a seed's rows in other surroundings than another.

    Two stores that both have a fingerprint are skipped: their fingerprints are compared instead.
    """
    made: dict[int, tuple[Maker, SourceStore]] = {}
    for source in sources:
        for seed, makers in source.makers.items():
            before, other = made.setdefault(seed, (makers[0], source))
            if makers[0].fingerprint and before.fingerprint:
                continue
            if found := surroundings_difference(makers[0], before):
                yield (
                    f"{source.path} and {other.path} hold episodes of seed {seed} from other"
                    f" surroundings ({found}): images and forces may differ in their last bits"
                )
