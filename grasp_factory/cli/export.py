"""The command that writes datasets in the format of another tool: ``export``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.completion import completes, formats
from grasp_factory.cli.params import AS_JSON, STORE_PATH, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.row_choice import chosen_of_each, row_options
from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.splits import SPLITS
from grasp_factory.core.text_format import count, size_text
from grasp_factory.errors import UsageError, shown

if TYPE_CHECKING:
    from grasp_factory.writers.exporters import ExportContents, Exporter
    from grasp_factory.writers.exporters.exporting import Exported

_IMPORTS = ("grasp_factory.dataset.dataset", "grasp_factory.writers.exporters.exporting")
"""What takes workers most of their start."""


@click.command(
    cls=Command,
    examples=(
        "grasp-factory export --list",
        "grasp-factory export grasps.zarr frames --to article",
        "grasp-factory export grasps.zarr shards --to webdataset --split train",
    ),
)
@click.argument("paths", metavar="STORE... OUT", nargs=-1, type=STORE_PATH)
@option(
    "--to",
    "name",
    metavar="FORMAT",
    shell_complete=completes(formats),
    help="Format, see --list.",
)
@option("--list", "as_list", is_flag=True, help="List the formats: what each has and leaves out.")
@option(
    "--option",
    "assignments",
    metavar="KEY=VALUE",
    multiple=True,
    help="Set an option of the format to a YAML value. Repeatable.",
)
@option(
    "--workers",
    metavar="N",
    type=click.IntRange(1, 256),
    default=1,
    show_default=True,
    help="Processes that work. The files do not depend on it.",
)
@row_options
@option(
    "--split",
    metavar="NAME",
    type=click.Choice(SPLITS),
    heading="Choice of episodes",
    help=f"Episodes of a split: {', '.join(SPLITS)}.",
)
@AS_JSON
def export(
    paths: tuple[Path, ...],
    *,
    name: str | None,
    as_list: bool,
    assignments: tuple[str, ...],
    workers: int,
    split: str | None,
    where: tuple[str, ...],
    as_json: bool,
    **rows: Any,
) -> None:
    """Export episodes to another format.

    Writes the episodes of one or several stores that all of --episodes, --ids, --where and --split
    choose, or all episodes, to the folder OUT. OUT must not exist; it appears when it is complete.
    Beside the data, grasp_factory.json says which rows it has and what is left out.
    """
    if as_list:
        _print_formats(as_json=as_json)
        return
    if len(paths) < 2 or name is None:
        raise UsageError(
            "export needs STORE, OUT and --to; `grasp-factory export --list` lists the formats"
        )
    from grasp_factory.core.executors import early_workers

    conditions = (*where, f"split={split}") if split else where
    with early_workers(workers - 1, imports=_IMPORTS) as ready:
        from grasp_factory.cli.bars import counted
        from grasp_factory.dataset.dataset import Dataset
        from grasp_factory.writers.exporters import exporter_named
        from grasp_factory.writers.exporters.exporting import run_export

        exporter = exporter_named(name)
        *stores, out = paths
        datasets = [Dataset(path, checked=True) for path in stores]
        rows_of_each = chosen_of_each(datasets, where=conditions, **rows)
        chosen = list(zip(datasets, rows_of_each, strict=True))
        settings = _settings(assignments)
        with counted("on_episode") as hooks:
            found = run_export(
                exporter, chosen, out, settings, workers=workers, ready=ready, **hooks
            )
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


def _print_formats(*, as_json: bool) -> None:
    from grasp_factory.writers.exporters import NOT_OFFERED, all_exporters

    exporters = all_exporters()
    if as_json:
        print_json({row.name: _facts(row) for row in exporters})
        return
    lines = [f"{name} is not offered: {why}" for name, why in NOT_OFFERED.items()]
    say("\n\n".join([*map(_format_text, exporters), *lines]))


def _facts(exporter: Exporter) -> dict[str, Any]:
    return {
        "description": exporter.description,
        "extra": exporter.extra,
        "options": to_plain(exporter.settings({})),
        **to_plain(exporter.contents),
    }


def _format_text(exporter: Exporter) -> str:
    needs = f" (pip install 'grasp-factory[{exporter.extra}]')" if exporter.extra else ""
    settings = to_plain(exporter.settings({}))
    lines = [f"{exporter.name}: {exporter.description}{needs}"]
    if settings:
        lines.append(f"  options: {', '.join(f'{k}={v}' for k, v in settings.items())}")
    return "\n".join([*lines, *(f"  {line}" for line in _contents_lines(exporter.contents))])


def _contents_lines(contents: ExportContents) -> list[str]:
    return [
        f"has: {', '.join(contents.written) or 'nothing but the record of the episodes'}",
        *(f"leaves out: {what}, because {why}" for what, why in contents.shown_left_out().items()),
        *(f"{case}: {what}" for case, what in contents.treatment.items()),
    ]


def _exported_text(found: Exported) -> str:
    head = f"{found.path}: {count(found.episodes, 'episode')} as {found.format}"
    lines = [f"{head}, {size_text(found.bytes)}"]
    lines += [f"{count(n, 'episode')} left out: {why}" for why, n in found.excluded.items()]
    if found.quarantined:
        rows = count(found.quarantined, "quarantined row")
        lines.append(f"{rows} left out: there is no data")
    return "\n".join([*lines, *_contents_lines(found.contents)])
