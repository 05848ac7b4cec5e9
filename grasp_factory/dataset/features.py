"""What a store holds: each array with its type, shape, unit, frame and meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from grasp_factory.core.html_parts import html_table
from grasp_factory.core.schema import Field
from grasp_factory.core.text_format import table

_HEAD = ("array", "shape", "dtype", "unit", "meaning")


@dataclass(frozen=True, slots=True, repr=False)
class Features(Mapping[str, Field]):
    """The fields of a store's arrays by path; ``print`` and notebooks show them as a table."""

    fields: Mapping[str, Field]
    shapes: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """The shapes of the arrays of the store, without the episodes."""

    def __getitem__(self, path: str) -> Field:
        return self.fields[path]

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        return len(self.fields)

    def __repr__(self) -> str:
        return table([_HEAD, *self._rows()])

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        return html_table(_HEAD, self._rows())

    def _rows(self) -> list[tuple[str, ...]]:
        return [
            (
                path,
                " x ".join(map(str, ("N", *self.shapes.get(path, one.dims)))),
                one.dtype,
                one.units,
                one.description,
            )
            for path, one in self.fields.items()
        ]
