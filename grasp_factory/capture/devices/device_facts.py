"""What a list of devices says of each, and of its settings."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.core.serialization import to_plain


def device_facts(model: DeviceModel) -> dict[str, str]:
    """Return the facts of a device by their names."""
    return {
        "name": model.name,
        "kind": model.kind.name.lower(),
        "extra": model.extra or "-",
        "description": model.description,
    }


def setting_facts(model: DeviceModel) -> dict[str, dict[str, Any]]:
    """Return the defaults of a device's settings by name, as YAML takes them."""
    facts = {}
    for field in dataclasses.fields(model.settings):
        is_needed = field.default is dataclasses.MISSING
        default = "needed" if is_needed else json.dumps(to_plain(field.default))
        facts[field.name] = {"needed": is_needed, "default": default}
    return facts
