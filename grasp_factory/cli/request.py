"""The request that the options of a run and of its dataset describe."""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from grasp_factory.cli.plugin_options import trust_store
from grasp_factory.core.config.yaml_loader import read_yaml
from grasp_factory.core.plugins.file_loading import file_reference
from grasp_factory.core.plugins.plugin_sources import allow_file
from grasp_factory.core.serialization import check
from grasp_factory.errors import UsageError, shown
from grasp_factory.factory.run_request import Request, resolve_request

_LEARNED = "learned"


def request_from(
    *,
    file: Path | None,
    assignments: tuple[str, ...],
    model: Path | None,
    plugins: tuple[Path, ...] = (),
    trust: bool = False,
    **flags: Any,
) -> Request:
    """Return the checked request that the options describe; import its folders and its model.

    Args:
        file: a YAML file with settings.
        assignments: ``KEY=VALUE`` texts.
        model: file of a trained model.
        plugins: files of the user that may be run, which the settings do not name by their paths.
        trust: whether the source files of a store at ``out`` may be run.
        flags: settings by key.

    Raises:
        PluginError: for a file of the user that cannot be used.
        UsageError: for a folder without a usable object, or a file that is not a model.
        ConfigError: naming the key, what it got and what is valid.
    """
    from grasp_factory.factory.plugins import with_plugins

    for plugin in plugins:
        allow_file(plugin)
    settings = {key: value for key, value in flags.items() if value not in (None, ())}
    for key, name in (("policies", "--policy"), ("object_sets", "--objects")):
        if key in settings:
            settings[key] = _once_each(name, settings[key])
    for key in ("cameras", "object_splits"):
        if key in settings:
            settings[key] = list(settings[key])
    written = read_yaml(file) if file else {}
    folders = [name for name in settings.get("object_sets", {}) if _is_folder(name)]
    if folders:
        weights = settings.pop("object_sets")
        robot = with_plugins(resolve_request(written, settings, assignments).config).robot
        digests = _import(folders, robot)
        names = {text: name for text, (name, _) in digests.items()}
        settings["object_sets"] = {names.get(t, t): weight for t, weight in weights.items()}
        settings["object_folders"] = dict(digests.values())
    request = resolve_request(written, settings, assignments)
    config = with_plugins(request.config)
    if trust:
        trust_store(request.out, config)
    request = replace(request, config=config)
    return request if model is None else _with_model(request, model)


def _with_model(request: Request, file: Path) -> Request:
    """Return the request with a model, which is imported, for the policy ``learned``."""
    from grasp_factory.policies.model_registry import import_model

    config = request.config
    if _LEARNED not in config.policies:
        raise UsageError(f"--model is for the policy {_LEARNED}: add --policy {_LEARNED}")
    own = {**config.policy_parameters.get(_LEARNED, {}), "model": import_model(file)}
    parameters = {**config.policy_parameters, _LEARNED: own}
    return replace(request, config=replace(config, policy_parameters=parameters))


def _once_each(option_name: str, pairs: Sequence[tuple[str, float]]) -> dict[str, float]:
    weights = dict(pairs)
    for name in weights:
        check([n for n, _ in pairs].count(name) == 1, option_name, name, "each name once")
    return weights


def _import(folders: Sequence[str], robot: str) -> dict[str, tuple[str, str]]:
    """Import folders and return each one's set name and digest."""
    from grasp_factory.cli.object_import import import_usable

    found: dict[str, tuple[str, str]] = {}
    places: dict[str, str] = {}
    for folder in sorted(folders, key=os.path.realpath):  # names do not depend on their order
        same = places.setdefault(os.path.realpath(folder), folder)
        if same != folder:
            raise UsageError(
                f"--objects: {shown(same)} and {shown(folder)} are the same folder, valid: each"
                " folder once"
            )
        report = import_usable(Path(folder), robot, [name for name, _ in found.values()])
        found[folder] = report.name, report.sha256
    return found


def _is_folder(name: str) -> bool:
    from grasp_factory.objects import OBJECT_SETS

    is_plugin = name.endswith(".py") or file_reference(name) is not None
    return name not in OBJECT_SETS and not is_plugin and ("/" in name or os.path.isdir(name))
