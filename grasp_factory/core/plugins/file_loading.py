"""Run the source of a single file, and name objects in it as ``FILE.py:NAME``."""

from __future__ import annotations

import contextlib
import re
import sys
import traceback
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from grasp_factory.core.plugins.plugin_sources import PluginSource
from grasp_factory.errors import PluginError, did_you_mean, shown

_REFERENCE = re.compile(r"(?P<path>.+\.py):(?P<attribute>[^\W\d]\w*)", re.DOTALL)
LONGEST_REASON = 300


@dataclass(frozen=True, slots=True)
class FileReference:
    """An object in a file of the user."""

    path: str
    attribute: str


def file_reference(text: str) -> FileReference | None:
    """Return the parts of ``FILE.py:NAME``; None for any other text."""
    found = _REFERENCE.fullmatch(text)
    return FileReference(found["path"], found["attribute"]) if found else None


def attribute_of(source: PluginSource, name: str) -> Any:
    """Return an object of a file, which is run once in each process.

    What the file prints while it runs goes to stderr, because stdout is the command's result.

    Raises:
        PluginError: if the file raises, or has no such object.
    """
    module = _module(source)
    try:
        return getattr(module, name)
    except AttributeError:
        own = [key for key in vars(module) if not key.startswith("_")]
        valid = ", ".join(own[:20]) or "none"
        hint = did_you_mean(name, own)
        raise PluginError(
            f"{source.path or source.name} has no {shown(name)}{hint} (valid: {valid})"
        ) from None


def _module(source: PluginSource) -> ModuleType:
    name = f"grasp_factory_file_{source.sha256[:32]}"
    if name in sys.modules:
        return sys.modules[name]
    where = source.path or source.name
    module = ModuleType(name)
    module.__file__ = where
    sys.modules[name] = module  # dataclasses look their module up by name
    try:
        with contextlib.redirect_stdout(sys.stderr):
            exec(compile(source.content, where, "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise PluginError(f"{where} cannot be loaded: {_reason(error, where)}") from None
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _reason(error: BaseException, where: str) -> str:
    """Return type, text and the file's line of an error, in one line."""
    frames = traceback.extract_tb(error.__traceback__)
    numbers = [frame.lineno for frame in frames if frame.filename == where]
    line = error.lineno if isinstance(error, SyntaxError) else next(reversed(numbers), None)
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    at = "" if line is None else f" (line {line})"
    return f"{type(error).__name__}: {' '.join(text.split())[:LONGEST_REASON]}{at}"
