"""The command ``capture devices``: the table of devices."""

# ruff: noqa: PLC0415

from __future__ import annotations

import click

from grasp_factory.cli.params import AS_JSON, Command
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.text_format import table


@click.command(
    "devices",
    cls=Command,
    examples=(
        "grasp-factory capture devices",
        "grasp-factory capture devices bmi088",
        "grasp-factory capture devices --json",
    ),
)
@click.argument("name", required=False)
@AS_JSON
def devices(name: str | None, as_json: bool) -> None:
    """List the devices, or the settings of one.

    Without NAME, lists the drivers: their names are values of `driver` in session.yaml. With NAME,
    lists the settings of that driver with their defaults.
    """
    from grasp_factory.capture.devices import DEVICES
    from grasp_factory.capture.devices.device_facts import device_facts, setting_facts
    from grasp_factory.errors import lookup

    if name is not None:
        settings = setting_facts(lookup(DEVICES, "device", name))
        if as_json:
            print_json(settings)
        else:
            say(table([(key, fact["default"]) for key, fact in settings.items()]))
        return
    facts = [device_facts(model) for model in DEVICES.values()]
    if as_json:
        print_json(facts)
        return
    say(table([tuple(facts[0]), *(tuple(fact.values()) for fact in facts)]))
