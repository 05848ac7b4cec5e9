"""Arrays that another program has written anew, with other chunks or codecs."""

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
    """Say whether a field's ``zarr.json``, not as it was sealed, may be another program's.

    Then its rows tell whether the array is still what it was: their checksums know nothing of
    chunks and codecs. Where blocks are found by the names of files, those must have stayed.
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
    if described == layout.attributes(row, config) and names == layout.dimension_names(row):
        return True
    return row != schema.DIGESTS and is_recoded(document)


def is_recoded(document: Any) -> bool:
    """Say whether an array's ``zarr.json`` names other codecs than the array was written with."""
    codecs = document.get("codecs") if isinstance(document, dict) else None
    if not isinstance(codecs, list) or not isinstance(document.get("attributes"), dict):
        return False
    names = {str(codec.get("name")) for codec in codecs if isinstance(codec, dict)}
    return names not in _CODECS


def sorted_out(names: Sequence[str], broken: Iterable[Problem]) -> tuple[list[Problem], list[str]]:
    """Return a problem for each of these arrays with other values, and a note on the rest."""
    changed = {problem.array for problem in broken}
    what = "written anew by another program, with other values"
    problems = [Problem(episode=None, array=name, what=what) for name in names if name in changed]
    same = [name for name in names if name not in changed]
    if not same:
        return problems, []
    more = f" and {len(same) - 3} more" if len(same) > 3 else ""
    what = "written anew by another program; the values are those that were written"
    return problems, [f"{', '.join(same[:3])}{more}: {what}"]


_KEYS = {"name": layout.KEYS["name"], "configuration": {"separator": layout.KEYS["separator"]}}


def _grid(rows: int) -> dict[str, Any]:
    return {"name": "regular", "configuration": {"chunk_shape": [rows]}}
