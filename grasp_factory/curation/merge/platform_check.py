"""Check of platforms: rows of one seed may come from several only if the user accepts that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from grasp_factory.core.platforms import ACCEPT, PARTS, differing, meaning, parsed
from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.errors import StoreMismatchError

Texts = Mapping[int, frozenset[str]]
"""By seed: the fingerprints that are stored with a store's rows of that seed."""
_OWN = "each row tells its own in episodes/fingerprint"


def check_platforms(sources: Sequence[SourceStore], *, accept: bool) -> list[str]:
    """Check that rows of one seed come from one platform; return warnings about different ones.

    Rows without a fingerprint are not compared.

    Raises:
        StoreMismatchError: if rows of a seed come from several platforms, unless that is accepted.
    """
    told = [source.fingerprints() for source in sources]
    warnings = []
    if found := _within_a_seed(sources, told):
        if not accept:
            raise StoreMismatchError(f"{found}; keep them apart, or add {ACCEPT}")
        warnings.append(f"{found}; {_OWN}")
    elif found := _between_seeds(sources, told):
        warnings.append(f"{found}; {_OWN}")
    return warnings


def _within_a_seed(sources: Sequence[SourceStore], told: Sequence[Texts]) -> str:
    first: dict[int, int] = {}
    for k, texts in enumerate(told):
        for seed, mine in texts.items():
            twin = first.setdefault(seed, k)
            others = told[twin][seed]
            if mine != others:
                what = f"hold episodes of seed {seed} from different platforms"
                pair = f"{sources[k].path} and {sources[twin].path}"
                return f"{pair} {what}: the fingerprint differs in {_difference(mine, others)}"
    return ""


def _between_seeds(sources: Sequence[SourceStore], told: Sequence[Texts]) -> str:
    known = [(k, frozenset().union(*texts.values())) for k, texts in enumerate(told) if texts]
    for k, mine in known[1:]:
        twin, others = known[0]
        if mine != others:
            pair = f"{sources[k].path} and {sources[twin].path}"
            what = "were made on different platforms"
            return f"{pair} {what}: the fingerprint differs in {_difference(mine, others)}"
    return ""


def _difference(mine: frozenset[str], others: frozenset[str]) -> str:
    """Return the parts in which these fingerprints differ."""
    known = [found for text in sorted(mine | others) if (found := parsed(text))]
    return meaning(part for part in PARTS if any(part in differing(known[0], b) for b in known))
