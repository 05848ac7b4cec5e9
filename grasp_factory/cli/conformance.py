"""The command that checks a policy, a robot or an object set: ``conformance``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import click

from grasp_factory.cli.params import AS_JSON, Command
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.text_format import count, table
from grasp_factory.errors import EXIT_DONE, EXIT_FAILURE


@click.command(
    cls=Command,
    examples=(
        "grasp-factory conformance my_file.py:plan",
        "grasp-factory conformance my_robot.py:ROBOT --json",
        "grasp-factory conformance top_down",
    ),
)
@click.argument("name")
@AS_JSON
@click.pass_context
def conformance(ctx: click.Context, name: str, as_json: bool) -> None:
    """Check a policy, a robot or an object set.

    NAME is an object in a Python file, FILE.py:NAME, or a name that `grasp-factory policies`,
    `robots` or `objects` lists. Runs the checks that those of this package pass, and prints a
    table. Exits with 1 if one fails.
    """
    from grasp_factory.apps.conformance.conformance_run import checks_of, results, row_named
    from grasp_factory.cli.bars import watched
    from grasp_factory.core.config.plugin_origin import KINDS

    kind, row = row_named(name)
    checks, found = checks_of(row), []
    with watched("check", len(checks)) as step:
        for result in results(checks):
            found.append(result)
            step()
    failed = [result for result in found if result.fault]
    if as_json:
        print_json({"kind": KINDS[kind], "name": row.name, "results": found})
    else:
        rows = [("FAILED" if one.fault else "passed", one.check) for one in found]
        say(table(rows))
        for one in failed:
            say(f"\n{one.check}:\n  {one.fault}")
        total = count(len(found), "check")
        verdict = f"{len(failed)} of {total} failed" if failed else f"{total} passed"
        say(f"\n{KINDS[kind]} {row.name}: {verdict}")
    ctx.exit(EXIT_FAILURE if failed else EXIT_DONE)
