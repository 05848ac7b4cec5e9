"""How a dataset shows itself: a few lines of text, and a table with pictures in a notebook."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from grasp_factory.core.html_parts import html_row, html_table, html_text, picture
from grasp_factory.core.text_format import count, escaped, named_lines
from grasp_factory.dataset.counts import count_outcomes
from grasp_factory.errors import GraspFactoryError

if TYPE_CHECKING:
    from grasp_factory.dataset.dataset import Dataset

WIDEST = 100
"""Characters of a line of text."""
MOST_LINES = 7
"""Lines of a list of names."""
SHOWN = 5
"""Episodes in a notebook."""
THUMB_WIDTH = 120
"""Pixels of a picture."""
_COLUMNS = ("outcome", "object_id", "policy", "split")


def dataset_text(dataset: Dataset) -> str:
    """Return the size, the cameras and the names of the columns; no column is read."""
    lines = [f"Dataset({_name(dataset)}): {_size(dataset)}"]
    facts = [(name, ", ".join(words)) for name, words in _parts(dataset)]
    return "\n".join([*map(escaped, lines), *named_lines(facts, WIDEST, MOST_LINES)])


def dataset_html(dataset: Dataset) -> str:
    """Return the first episodes with their pictures, and how often each outcome occurs."""
    name = html_text(", ".join(map(str, dataset.paths)))
    head = f"<p><b>Dataset</b> {name}: {html_text(_size(dataset))}</p>"
    try:
        there = dataset.committed
        outcomes = count_outcomes(dataset.column("outcome")[there])
        rows = "".join(_rows(dataset, there[:SHOWN].tolist()))
    except GraspFactoryError as error:
        return f"<div>{head}<p>{html_text(error)}</p></div>"
    more = len(there) - SHOWN
    rest = f"<p>and {html_text(count(more, 'more episode'))}</p>" if more > 0 else ""
    return f"<div>{head}{html_table((), outcomes.items())}<table>{rows}</table>{rest}</div>"


def _name(dataset: Dataset) -> str:
    names = list(map(str, dataset.paths))
    return repr(names[0] if len(names) == 1 else names)


def _size(dataset: Dataset) -> str:
    """Return how many rows there are, and of a view, of how many."""
    if dataset.whole is dataset:
        return count(len(dataset), "row")
    return f"{count(len(dataset), 'episode')} of {count(len(dataset.whole), 'row')}"


def _parts(dataset: Dataset) -> Iterator[tuple[str, Sequence[str]]]:
    width, height = dataset.config.resolution
    yield "cameras", [f"{name} ({width} x {height})" for name in dataset.config.cameras]
    series = [path for path, field in dataset.features.items() if field.length_column]
    yield "series", series
    yield "columns", dataset.columns


def _rows(dataset: Dataset, indices: Sequence[int]) -> Iterator[str]:
    """Yield a line of HTML for each of some episodes."""
    camera = next(iter(dataset.config.cameras), None)
    few = dataset.select(indices)
    known = [name for name in _COLUMNS if name in dataset.columns]
    seen = ("before", "after") if camera else ()
    yield html_row("th", map(html_text, ("", *seen, *known)))
    words = [few[name].tolist() for name in known]
    images = [few.images(range(len(few)), camera, "rgb", k) for k in (0, 1)] if camera else []
    for k, index in enumerate(indices):
        cells = [html_text(index)]
        cells += [picture(each[k], "camera", THUMB_WIDTH) for each in images]
        cells += [html_text(column[k]) for column in words]
        yield html_row("td", cells)
