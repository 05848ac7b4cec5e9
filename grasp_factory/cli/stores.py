"""The commands about a store that is there: is it whole, and making it whole again."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE, print_json
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.core.serialization import to_plain

WORKERS = click.option(
    "--workers", type=int, default=2, show_default=True, help="Processes; 1 works without a pool."
)


@click.command()
@STORE
@click.option("--deep", type=int, default=0, metavar="N", help="Simulate N episodes again as well.")
@click.option(
    "--deep-seed", type=int, help="What they are drawn from.  [default: another each time]"
)
@WORKERS
@AS_JSON
@click.pass_context
def verify(
    ctx: click.Context,
    path: Path,
    *,
    deep: int,
    deep_seed: int | None,
    workers: int,
    as_json: bool,
) -> None:
    """Check that the store at PATH is what was written.

    Looks at its structure, at the checksums of every episode and at what must hold for every
    array. Changes nothing. Exits with 0 if all is well, and with 1 after naming every problem.
    """
    from grasp_factory.cli.curation_report import verify_text
    from grasp_factory.cli.progress import counted
    from grasp_factory.curation.verify import verify as run

    with counted("on_episode") as hooks:
        report = run(path, deep, workers, deep_seed=deep_seed, **hooks)
    if as_json:
        print_json(to_plain(report) | {"is_whole": report.is_whole})
    else:
        click.echo(verify_text(report))
    ctx.exit(0 if report.is_whole else 1)


@click.command()
@STORE
@WORKERS
@click.option(ACCEPT, is_flag=True, help="Simulate here also what was made on another platform.")
@AS_JSON
@click.pass_context
def repair(
    ctx: click.Context, path: Path, *, workers: int, accept_other_platform: bool, as_json: bool
) -> None:
    """Make again what is damaged or missing in a store.

    Whatever `verify` finds in the store at PATH is made again from its config and recipes;
    episodes that are whole stay as they are. Exits with 0 if the store is whole afterwards.
    """
    from grasp_factory.cli.curation_report import repair_text
    from grasp_factory.cli.progress import counted
    from grasp_factory.curation.repair import repair as run

    with counted("on_episode") as hooks:
        result = run(path, workers, accept_other_platform=accept_other_platform, **hooks)
    if as_json:
        more = {"is_whole": result.is_whole}
        remade = [to_plain(made) | {"is_same": made.is_same} for made in result.remade]
        print_json(to_plain(result) | {"remade": remade} | more)
    else:
        click.echo(repair_text(result))
    ctx.exit(0 if result.is_whole else 1)
