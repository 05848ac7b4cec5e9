"""Arrays that another program has rewritten with other chunks or codecs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.curation.verify.problems import Problem
from grasp_factory.writers.zarr import layout
from grasp_factory.writers.zarr.metadata_checksum import SEAL

_CODECS = ({"bytes", "zstd"}, {"vlen-utf8", "zstd"}, {"sharding_indexed"})
"""Names of the codecs of arrays as this package, or Zarr by itself, writes them."""


def is_rewritten(document: Any, row: schema.Field, config: FactoryConfig) -> bool:
    """Return whether another program may have rewritten a field's ``zarr.json`` and its array.

    The ``zarr.json`` does not match its seal. If the result is True, the rows' checksums show
    whether the values are unchanged: they do not depend on chunks and codecs. An array whose file
    names identify blocks must still have these names.
    """
    if not isinstance(document, dict) or document.get("chunk_key_encoding") != _KEYS:
        return False
    shape, attributes = document.get("shape"), document.get("attributes")
    if not isinstance(shape, list) or not isinstance(attributes, dict):
        return False
    fill = "NaN" if row.fill != row.fill else row.fill
    is_of = (document.get("node_type"), document.get("data_type"), document.get("fill_value"))
    if len(shape) != len(row.dims) + 1 or is_of != ("array", row.dtype, fill):
        return False
    if row == schema.STATUS and document.get("chunk_grid") != _grid(config.block_size):
        return False
    described = {key: value for key, value in attributes.items() if key != SEAL}
    names = document.get("dimension_names")
    recorded = schema.digested(schema.expand(config))
    if described == layout.attributes(row, recorded) and names == layout.dimension_names(row):
        return True
    return row != schema.DIGESTS and is_recoded(document)


def is_recoded(document: Any) -> bool:
    """Return whether a ``zarr.json`` names other codecs than its array was written with."""
    codecs = document.get("codecs") if isinstance(document, dict) else None
    if not isinstance(codecs, list) or not isinstance(document.get("attributes"), dict):
        return False
    names = {str(codec.get("name")) for codec in codecs if isinstance(codec, dict)}
    return names not in _CODECS


def rewritten_findings(
    names: Sequence[str], broken: Iterable[Problem]
) -> tuple[list[Problem], list[str]]:
    """Return a problem for each of these arrays with changed values, and a note on the others."""
    changed = {problem.array for problem in broken}
    what = "rewritten by another program, with other values"
    problems = [Problem(episode=None, array=name, what=what) for name in names if name in changed]
    same = [name for name in names if name not in changed]
    if not same:
        return problems, []
    more = f" and {len(same) - 3} more" if len(same) > 3 else ""
    what = "rewritten by another program; the values are those that were written"
    return problems, [f"{', '.join(same[:3])}{more}: {what}"]


_KEYS = {"name": layout.KEYS["name"], "configuration": {"separator": layout.KEYS["separator"]}}


def _grid(rows: int) -> dict[str, Any]:
    return {"name": "regular", "configuration": {"chunk_shape": [rows]}}
