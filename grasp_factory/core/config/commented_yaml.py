"""Settings as YAML in which a comment says what each key means and which values are valid."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
import typing
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from itertools import pairwise
from typing import Any, cast

import yaml

from grasp_factory.core.config.within import valid_values

WIDEST = 100
_NO_BREAK = "\N{NO-BREAK SPACE}"


def commented_yaml(cls: type[Any], plain: Mapping[str, Any]) -> str:
    """Return the fields of a record as YAML, each below a comment.

    The comments are made of the docstrings of the record's fields and of the valid values in their
    annotations. Without the source of the package, the docstrings are left out.

    Args:
        cls: the type of the record.
        plain: its fields, or some of them, as plain data.
    """
    return "".join(f"{line}\n" for line in _lines(cls, plain))


def _lines(cls: type[Any], plain: Mapping[str, Any]) -> Iterator[str]:
    hints = typing.get_type_hints(cls)
    for key, value in plain.items():
        hint = _without_none(hints[key])
        yield from _comment(" ".join(filter(None, [_meaning(cls, key), _valid(cls, key, hint)])))
        if is_dataclass(hint) and isinstance(value, Mapping):
            yield _heading(key)
            yield from _indented(_lines(cast(Any, hint), value))
        elif _is_table_of_records(hint) and value:
            yield _heading(key)
            for name, record in value.items():
                yield f"  {_heading(name)}"
                yield from _indented(_indented(_lines(typing.get_args(hint)[1], record)))
        else:
            yield from _dumped(key, value)


def _dumped(key: str, value: Any) -> Iterator[str]:
    """Yield the lines of a key with its value; the inner levels of a table stand in one line."""
    style = None if isinstance(value, dict | list) else False
    text = yaml.safe_dump({key: value}, sort_keys=False, default_flow_style=style, width=math.inf)
    yield from text.splitlines()


def _heading(key: str) -> str:
    """Return the line of a key whose value stands in the lines below."""
    (line,) = _dumped(key, None)
    return line.removesuffix(" null")


def _indented(lines: Iterator[str]) -> Iterator[str]:
    return (f"  {line}" for line in lines)


def _comment(text: str) -> list[str]:
    lines = textwrap.wrap(text, WIDEST - 8, break_long_words=False, break_on_hyphens=False)
    return [f"# {line.replace(_NO_BREAK, ' ')}" for line in lines]


def _meaning(cls: Any, key: str) -> str:
    """Return what a field means: its docstring, or the condition in its metadata."""
    condition = next(f.metadata.get("condition", "") for f in fields(cls) if f.name == key)
    if condition:
        return f"Success needs that {condition.format('X')}; X:"
    return _field_docstrings(cls).get(key, "")


def _valid(cls: Any, key: str, hint: Any) -> str:
    """Return which values a field may have, in brackets; empty if nothing more is to be said."""
    valid: Any = valid_values(cls).get(key)
    if valid is None and isinstance(hint, type) and issubclass(hint, Enum):
        valid = ", ".join(member.name.lower() for member in hint)
    elif hint is bool:
        valid = "true, false"
    return "" if valid is None else f"[{valid}]".replace(" ", _NO_BREAK)


@cache
def _field_docstrings(cls: Any) -> Mapping[str, str]:
    """Return the docstrings of a record's fields in one line each, by field name."""
    try:
        source = textwrap.dedent(inspect.getsource(cls))
    except OSError:
        return {}
    (definition,) = ast.parse(source).body
    assert isinstance(definition, ast.ClassDef)
    return {
        here.target.id: " ".join(after.value.value.replace("``", "").split())
        for here, after in pairwise(definition.body)
        if isinstance(here, ast.AnnAssign)
        and isinstance(here.target, ast.Name)
        and isinstance(after, ast.Expr)
        and isinstance(after.value, ast.Constant)
        and isinstance(after.value.value, str)
    }


def _without_none(hint: Any) -> Any:
    """Return the type of a value that may also be None."""
    kinds = [kind for kind in typing.get_args(hint) if kind is not type(None)]
    return kinds[0] if type(None) in typing.get_args(hint) else hint


def _is_table_of_records(hint: Any) -> bool:
    args = typing.get_args(hint)
    return typing.get_origin(hint) is Mapping and is_dataclass(args[1])
