"""The command that writes a dataset in the format of another tool: ``export``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.row_choice import chosen_rows, row_options
from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.text_format import count, size_text, table
from grasp_factory.errors import UsageError, lookup, shown

if TYPE_CHECKING:
    from grasp_factory.writers.exporters.exporting import Exported


@click.command(
    cls=Command,
    examples=(
        "grasp-factory export",
        "grasp-factory export --json",
    ),
)
@click.argument("path", required=False, type=click.Path(path_type=Path))
@click.argument("out", required=False, type=click.Path(path_type=Path))
@option("--format", "name", metavar="NAME", help="Format, see `grasp-factory export`.")
@option(
    "--option",
    "assignments",
    metavar="KEY=VALUE",
    multiple=True,
    help="Set an option of the format to a YAML value. Repeatable.",
)
@row_options
@AS_JSON
def export(
    path: Path | None,
    out: Path | None,
    *,
    name: str | None,
    assignments: tuple[str, ...],
    as_json: bool,
    **rows: Any,
) -> None:
    """Export episodes to another format.

    Without arguments, lists the formats. With PATH, OUT and --format, writes episodes of the store
    at PATH to OUT, which must not exist. Writes all episodes, or those that all of --episodes,
    --ids and --where choose.
    """
    from grasp_factory.writers.exporters import EXPORTERS

    if path is None:
        _print_formats({key: row.description for key, row in EXPORTERS.items()}, as_json=as_json)
        return
    if out is None or name is None:
        raise UsageError(
            "export needs PATH, OUT and --format; `grasp-factory export` lists the formats"
        )
    exporter = lookup(EXPORTERS, "format", name)
    from grasp_factory.cli.bars import Counter
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.writers.exporters.exporting import run_export

    dataset = Dataset.open(path, checked=True)
    chosen = chosen_rows(dataset, **rows)
    every = dataset.committed.tolist() if chosen is None else chosen
    settings = _settings(assignments)
    with Counter(len(every), "episode") as counter:
        found = run_export(exporter, dataset, every, out, settings, on_episode=counter.count)
    if as_json:
        print_json(to_plain(found) | {"path": str(found.path)})
    else:
        say(_exported_text(found))


def _settings(assignments: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or key in found:
            raise UsageError(f"--option: got {shown(text)}, valid: KEY=VALUE, each key once")
        found[key] = parse_yaml(value, f"--option {key}")
    return found


def _print_formats(formats: dict[str, str], *, as_json: bool) -> None:
    if as_json:
        print_json(formats)
    else:
        say(table(formats.items()) if formats else "This version has no export formats.")


def _exported_text(found: Exported) -> str:
    head = f"{found.path}: {count(found.episodes, 'episode')} as {found.format}"
    lines = [f"{head}, {size_text(found.bytes)}"]
    lines += [f"written: {what}" for what in found.contents.written]
    lines += [f"left out: {what}, because {why}" for what, why in found.contents.left_out.items()]
    return "\n".join(lines)
