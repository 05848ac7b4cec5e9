"""The request that the options of a run and of its dataset describe."""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from grasp_factory.cli.base_settings import (
    check_named_code,
    folder_settings,
    note,
    run_settings,
    stated_out,
    stored_settings,
)
from grasp_factory.cli.plugin_options import trust_store
from grasp_factory.cli.printing import say
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
    continues: bool = False,
    quiet: bool = False,
    **flags: Any,
) -> Request:
    """Return the checked request that the options describe; import its folders and its model.

    A line on stderr names where other settings come from: ``grasp-factory.yaml`` of the current
    folder, unless ``file`` is given, and a store.

    Args:
        file: a YAML file with settings.
        assignments: ``KEY=VALUE`` texts.
        model: file of a trained model.
        plugins: files of the user that may be run, which the settings do not name by their paths.
        trust: whether the source files of a store at ``out`` may be run.
        continues: whether a store that is at ``out`` decides the config and the number of episodes.
        quiet: leave the line out.
        flags: settings by key.

    Raises:
        PluginError: for a file of the user that cannot be used.
        UsageError: for a folder without a usable object, or a file that is not a model.
        ConfigError: naming the key, what it got and what is valid.
    """
    from grasp_factory.factory.plugins import with_plugins

    for plugin in plugins:
        allow_file(plugin)
    settings = _settings(flags)
    found = None if file else folder_settings()
    if found is not None:
        found = {key: value for key, value in found.items() if key not in settings}
        check_named_code(found, [*assignments, *map(str, flags.values())], plugins)
    written = read_yaml(file) if file else found or {}
    out = stated_out((written, settings), assignments)
    stored = stored_settings(out) if continues else None
    base = None
    if stored:
        known = written if file else run_settings(written)
        base, written = stored.config, {"n": stored.rows} | known
    folders = [name for name in settings.get("object_sets", {}) if _is_folder(name)]
    if folders:
        weights = settings.pop("object_sets")
        asked = resolve_request(written, settings, assignments, base=base)
        digests = _import(folders, with_plugins(asked.config).robot)
        names = {text: name for text, (name, _) in digests.items()}
        settings["object_sets"] = {names.get(t, t): weight for t, weight in weights.items()}
        settings["object_folders"] = dict(digests.values())
    request = resolve_request(written, settings, assignments, base=base)
    config = with_plugins(request.config)
    if not quiet and base in (None, config) and (line := note(found, stored)):
        say(line, err=True)
    if trust:
        trust_store(request.out, config)
    request = replace(request, config=config)
    return request if model is None else _with_model(request, model)


def _settings(flags: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the flags that are given."""
    settings = {key: value for key, value in flags.items() if value not in (None, ())}
    for key, name in (("policies", "--policy"), ("object_sets", "--objects")):
        if key in settings:
            settings[key] = _once_each(name, settings[key])
    for key in ("cameras", "object_splits", "sensors"):
        if key in settings:
            settings[key] = list(settings[key])
    return settings


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
