"""Settings that apply without an option: of ``grasp-factory.yaml``, and of the store at ``--out``.

A folder may come from a stranger. Its ``grasp-factory.yaml`` decides what a config decides, in this
folder. It runs no file, and gives no consent: the user does that at the command line.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.yaml_loader import MAX_BYTES, parse_yaml, yaml_mapping
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.plugins.file_loading import file_reference
from grasp_factory.core.regular_file import open_regular, read_part
from grasp_factory.errors import (
    ConfigError,
    IrregularFileError,
    PluginError,
    StoreMismatchError,
    shown,
)
from grasp_factory.factory.run_request import (
    CONFIG_KEYS,
    DEFAULT_RUN,
    EXECUTOR,
    RUN_KEYS,
    resolve_request,
)

FOLDER_FILE = "grasp-factory.yaml"
_CODE_KEYS = ("policies", "policy_parameters", "object_sets", "robot", "sensors")


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredSettings:
    """What a store decides for a run that continues it."""

    path: Path
    config: FactoryConfig
    rows: int


def folder_settings() -> dict[str, Any] | None:
    """Return the settings of ``grasp-factory.yaml`` in the current folder; None without the file.

    Its number of workers is at most that of this machine's processors.

    Raises:
        ConfigError: if it is no regular file, no YAML, or says what only an option may say.
    """
    try:
        descriptor = open_regular(Path(FOLDER_FILE), os.O_RDONLY)
    except FileNotFoundError:
        return None
    except IrregularFileError:
        raise ConfigError(
            f"{FOLDER_FILE} is a link, or no regular file: valid: a file of settings; name any"
            " other file with --config"
        ) from None
    except OSError as error:
        raise ConfigError(f"{FOLDER_FILE} cannot be read: {error.strerror}") from None
    try:
        content = read_part(descriptor, MAX_BYTES + 1)
    finally:
        os.close(descriptor)
    settings = yaml_mapping(content, FOLDER_FILE)
    if settings.get("accept_other_platform"):
        raise ConfigError(
            f"{FOLDER_FILE}: accept_other_platform: got true, valid: false; this is an option"
        )
    if settings.get("executor", EXECUTOR) != EXECUTOR:
        raise ConfigError(
            f"{FOLDER_FILE}: executor: got {shown(settings['executor'])}, valid: {EXECUTOR}; a"
            " cluster is named by an option"
        )
    _check_out(settings.get("out", ""))
    workers = settings.get("workers")
    if isinstance(workers, int) and not isinstance(workers, bool):
        most = max(DEFAULT_RUN.workers, len(os.sched_getaffinity(0)))
        settings["workers"] = min(workers, most)
    return settings


def _check_out(out: Any) -> None:
    """Check that a store is to be in the current folder; other mistakes are found later."""
    if not isinstance(out, str) or not out or "\0" in out:
        return
    here, there = os.path.realpath("."), os.path.realpath(out)
    if "://" in out or os.path.commonpath([here, there]) != here:
        raise ConfigError(
            f"{FOLDER_FILE}: out: got {shown(out)}, valid: a path in this folder; name any other"
            " with --out"
        )


def check_named_code(
    found: Mapping[str, Any], given: Iterable[str], plugins: Iterable[Path]
) -> None:
    """Check that the user names the files of code that ``grasp-factory.yaml`` names.

    Args:
        found: its settings that no option replaces.
        given: texts of the options, in which the user may have named the same object.
        plugins: files of ``--plugin``.

    Raises:
        PluginError: naming a file that the user did not name.
    """
    files, texts = {os.path.realpath(file) for file in plugins}, tuple(given)
    for key in _CODE_KEYS:
        value = found.get(key, ())
        for name in [value] if isinstance(value, str) else value:
            reference = file_reference(name) if isinstance(name, str) else None
            if reference is None or any(name in text for text in texts):
                continue
            if os.path.realpath(reference.path) not in files:
                raise PluginError(
                    f"{FOLDER_FILE}: {key}: {shown(name)} is code, which is run only if you name"
                    f" it: add --plugin {reference.path}"
                )


def stated_out(sources: Iterable[Mapping[str, Any]], assignments: Iterable[str]) -> Path:
    """Return the path of the store that settings state, or the default.

    Args:
        sources: settings, each of which overrides the one before.
        assignments: ``KEY=VALUE`` texts, which override all of them.
    """
    out: Any = DEFAULT_RUN.out
    for source in sources:
        out = source.get("out", out)
    for text in assignments:
        key, _, value = text.partition("=")
        if key.strip() == "out":
            out = parse_yaml(value, f"--set {shown(text)}")
    is_path = isinstance(out, str | Path) and "\0" not in str(out)
    return store_path(out) if is_path else DEFAULT_RUN.out


def stored_settings(path: Path) -> StoredSettings | None:
    """Return the settings of the store at a path; None if none is there that a run can continue.

    Raises:
        StoreError: if the store is damaged.
    """
    from grasp_factory.dataset.dataset import Dataset
    from grasp_factory.writers.zarr.header import SOURCES

    try:
        store = Dataset(path)
    except StoreMismatchError:  # `check_place` says what is there
        return None
    if SOURCES in store.attributes:
        return None
    return StoredSettings(path=path, config=store.config, rows=len(store))


def run_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that decide how a run is made, not what."""
    return {key: value for key, value in settings.items() if key not in CONFIG_KEYS}


def note(found: Mapping[str, Any] | None, stored: StoredSettings | None) -> str:
    """Return a line that names where settings come from; empty if all are options or defaults.

    Args:
        found: the settings of ``grasp-factory.yaml``, if it is there.
        stored: those of the store, if it is there.

    Raises:
        ConfigError: if the file's settings are invalid.
    """
    from grasp_factory.factory.plugins import with_plugins

    if stored is None:
        return "" if found is None else f"Using {FOLDER_FILE} of this folder."
    text = f"Using the config of {stored.path}"
    if found is None:
        return f"{text}."
    own = {key: value for key, value in found.items() if key not in RUN_KEYS}
    asked = with_plugins(resolve_request(own, {}, base=stored.config).config)
    other = first_difference(asked.to_plain(), stored.config.to_plain())
    if other is None:
        return f"{text}, and {FOLDER_FILE} of this folder."
    return f"{text}, and not that of {FOLDER_FILE} ({other})."
