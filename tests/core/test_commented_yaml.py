"""`--print-config`: YAML with a comment for each key, that loads to the same settings."""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import typing
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp_factory.core.config import commented_yaml
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.within import Within, valid_values
from grasp_factory.errors import ConfigError
from grasp_factory.factory.run_request import Request, resolve_request


def bounded(cls: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Yield the dotted key of each bounded setting below a record, and a strategy of its values."""
    hints = typing.get_type_hints(cls)
    for key, valid in valid_values(cls).items():
        if isinstance(valid, Within):
            kind = st.integers if hints[key] is int else st.floats
            number = kind(valid.low, valid.high)  # type: ignore[operator]
            is_range = typing.get_origin(hints[key]) is tuple
            values = st.tuples(number, number).map(sorted) if is_range else number
            yield ".".join([*above, key]), values
    for key, hint in hints.items():
        if is_dataclass(hint):
            yield from bounded(hint, (*above, key))


BOUNDED = dict(bounded(FactoryConfig))
NAMES = st.text(min_size=1, max_size=20)


@st.composite
def requests(draw: st.DrawFn) -> Request:
    """Return a request with settings of many kinds."""
    plain = {
        "policies": draw(st.dictionaries(NAMES, st.floats(0.1, 9.0), min_size=1, max_size=3)),
        "policy_parameters": draw(st.dictionaries(NAMES, st.dictionaries(NAMES, NAMES))),
        "cameras": list(draw(st.permutations(sorted(CAMERAS))))[:2],
        "out": draw(NAMES.filter(lambda text: "\0" not in text)),
    }
    texts: list[str] = []
    for key in draw(st.lists(st.sampled_from(sorted(BOUNDED)), max_size=12, unique=True)):
        more = [*texts, f"{key}={json.dumps(draw(BOUNDED[key]))}"]
        with contextlib.suppress(ConfigError):  # it does not fit the others
            resolve_request(plain, {}, more)
            texts = more
    return resolve_request(plain, {}, texts)


@given(requests())
@settings(max_examples=12)
def test_what_is_printed_loads_to_the_same_settings(request: Request) -> None:
    text = request.to_yaml()
    assert resolve_request(yaml.safe_load(text), {}) == request
    assert max(map(len, re.findall("^ *#.*", text, re.MULTILINE))) <= 100


def test_each_key_has_a_comment_and_each_number_a_range() -> None:
    config = FactoryConfig(cameras={name: camera.config for name, camera in CAMERAS.items()})
    lines = Request(config=config, out=Path("x.zarr")).to_yaml().splitlines()
    names = {f"  {name}:" for name in CAMERAS}
    for above, line in itertools.pairwise(lines):
        if line and not line.lstrip().startswith("#") and line not in names:
            assert above.lstrip().startswith("# "), line
            if re.search(r": \[?-?[0-9.]+(, |\]|$)", line):
                assert above.endswith("]"), line


def test_a_comment_says_meaning_unit_and_range_of_the_check() -> None:
    text = Request(config=FactoryConfig()).to_yaml()
    assert "  # Force limit of each finger, N. [0.1 to 200.0 N]\n  grip_force: 20.0\n" in text
    with pytest.raises(
        ConfigError, match=re.escape("grip_force: got 201.0, valid: 0.1 to 200.0 N")
    ):
        resolve_request({"motion": {"grip_force": 201.0}}, {})


def test_without_the_source_there_are_ranges_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(cls: object) -> str:
        raise OSError

    monkeypatch.setattr(commented_yaml.inspect, "getsource", nothing)
    commented_yaml._field_docstrings.cache_clear()
    try:
        text = Request(config=FactoryConfig()).to_yaml()
    finally:
        commented_yaml._field_docstrings.cache_clear()
    assert "  # [0.1 to 200.0 N]\n  grip_force: 20.0\n" in text
