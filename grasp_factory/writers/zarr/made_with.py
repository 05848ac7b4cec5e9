"""Compare the versions and the platform that made a store with those of this process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.writers.zarr.header import root_attributes


def changed_since(attributes: Mapping[str, Any]) -> list[str]:
    """Return ``what: recorded, now present`` for each version and platform fact that changed.

    Platform facts that the store does not record are left out.
    """
    then, here = attributes.get("platform", {}), _here(attributes)["platform"]
    known = {key: now for key, now in here.items() if key in then}
    return changed_versions(attributes) + _changed(then, known)


def changed_versions(attributes: Mapping[str, Any]) -> list[str]:
    """Return ``what: recorded, now present`` for each version that changed."""
    return _changed(attributes.get("versions", {}), _here(attributes)["versions"])


def _changed(then: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    return [
        f"{key}: {then.get(key, 'unknown')}, now {now}"
        for key, now in here.items()
        if then.get(key) != now
    ]


def _here(attributes: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    ours = root_attributes(FactoryConfig.from_plain(attributes["config"]), {})
    return {group: ours[group] for group in ("versions", "platform")}
