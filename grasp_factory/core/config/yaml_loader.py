"""Safe reading of YAML from files and command lines, with limits on size and depth."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from grasp_factory.errors import ConfigError, shown

MAX_VALUES = 20_000
"""Largest number of values in one text, counted after aliases are expanded.

It protects against small texts that expand to very many values ("billion laughs").
"""
MAX_DEPTH = 40
MAX_BYTES = 1_000_000
"""Largest size of a config file; without it, reading /dev/zero would never end."""
MOST_BITS = 1024
"""Of an integer: those of the largest float. Texts of far larger ones cannot be printed."""
LONGEST_INTEGER = MOST_BITS + 8
"""Characters of an integer; reading one in base 60, such as 1:30:00, takes quadratic time."""
_MERGE = "tag:yaml.org,2002:merge"


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader for YAML 1.1, but 1e-3 is a number as in YAML 1.2, not a string."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._values = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next value; raise an error instead of reading too many."""
        self._values += 1
        if self._values > MAX_VALUES:
            raise _too_many()
        node: yaml.Node | None = super().compose_node(parent, index)
        return node


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def _too_many() -> yaml.MarkedYAMLError:
    problem = f"more than {MAX_VALUES} values, counting what its aliases stand for"
    return yaml.MarkedYAMLError(problem=problem)


def _integer(loader: _Loader, node: yaml.ScalarNode) -> int:
    if len(node.value) > LONGEST_INTEGER:
        raise ValueError(f"an integer of more than {LONGEST_INTEGER} characters")
    found: int = loader.construct_yaml_int(node)
    if found.bit_length() > MOST_BITS:
        raise ValueError(f"an integer of {found.bit_length()} bits, valid: up to {MOST_BITS}")
    return found


_Loader.add_constructor("tag:yaml.org,2002:int", _integer)


def _text(loader: _Loader, node: yaml.ScalarNode) -> str:
    found: str = loader.construct_yaml_str(node)
    try:
        found.encode()
    except UnicodeEncodeError:
        raise ValueError("a text with half of a surrogate pair, such as \\ud800") from None
    return found


_Loader.add_constructor("tag:yaml.org,2002:str", _text)


def parse_yaml(text: str, what: str) -> Any:
    """Return the plain data of a YAML text; None for an empty one.

    Args:
        text: the YAML.
        what: how an error message starts, such as ``config file x.yaml``.

    Raises:
        ConfigError: if the text is invalid; the message is one line.
    """
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _check(node)
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise ConfigError(f"{what} is not valid YAML: {line}{str(error.problem)[:200]}") from None
    except RecursionError:
        raise ConfigError(f"{what} is nested more than {MAX_DEPTH} levels deep") from None
    except Exception as error:  # constructors of values such as 2001-99-99 may raise any type
        first = "a value does not fit its type"
        if isinstance(error, ValueError | yaml.YAMLError):
            first = next(iter(str(error).splitlines()), first)
        raise ConfigError(f"{what} is not valid YAML: {first[:200]}") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping that a YAML file holds.

    Raises:
        ConfigError: if the file cannot be read, is too large, is no YAML, or holds no mapping.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise ConfigError(f"config file {path} cannot be read: {error}") from None
    return yaml_mapping(content, f"config file {path}")


def yaml_mapping(content: bytes, what: str) -> dict[str, Any]:
    """Return the mapping that the content of a YAML file holds.

    Args:
        content: the content, of which only the first ``MAX_BYTES`` + 1 bytes are needed.
        what: how an error message starts, such as ``config file x.yaml``.

    Raises:
        ConfigError: if it is too large, is no YAML, or holds no mapping.
    """
    if len(content) > MAX_BYTES:
        raise ConfigError(f"{what} is no config: it has more than {MAX_BYTES} bytes")
    try:
        text = content.decode("utf-8")
    except ValueError as error:
        raise ConfigError(f"{what} cannot be read: {error}") from None
    data = parse_yaml(text, what)
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ConfigError(f"{what}: expected a mapping of keys, got {shown(data)}")
    return data


def _check(root: yaml.Node) -> None:
    """Raise an error if the text is too large, too deep or recursive, or has a duplicate key."""
    known: dict[int, tuple[int, int]] = {}

    def measure(node: yaml.Node, above: int) -> tuple[int, int]:
        """Return the number of values and of levels of a node after aliases are expanded."""
        if id(node) not in known:
            _check_keys(node)
            children = _children(node) if above < MAX_DEPTH else ()
            inner = [measure(child, above + 1) for child in children]
            levels = 1 + max((levels for _, levels in inner), default=0)
            known[id(node)] = 1 + sum(values for values, _ in inner), levels
        if above + known[id(node)][1] > MAX_DEPTH:
            raise RecursionError
        return known[id(node)]

    if measure(root, 0)[0] > MAX_VALUES:
        raise _too_many()


def _children(node: yaml.Node) -> Iterator[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        for pair in node.value:
            yield from pair
    elif isinstance(node, yaml.SequenceNode):
        yield from node.value


def _check_keys(node: yaml.Node) -> None:
    if not isinstance(node, yaml.MappingNode):
        return
    seen = set[str]()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
            continue
        if key.value in seen:
            problem = f"key {shown(key.value)} is there twice; keep one of them"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
        seen.add(key.value)
