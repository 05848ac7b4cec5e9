"""JSON documents: what is nested too deep is refused, wherever the depth is."""

from __future__ import annotations

import json
from typing import Any

import pytest

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.json_text import DEEPEST, check_depth, parsed
from grasp_factory.errors import ConfigError


def nested(levels: int) -> Any:
    value: Any = 7
    for k in range(levels):
        value = [value] if k % 2 else {"a": value}
    return value


@pytest.mark.parametrize("data", [7, "[[[", [], {"a": [1, {"b": None}]}, nested(DEEPEST)])
def test_a_document_reads_as_its_data(data: Any) -> None:
    text = json.dumps(data)
    assert parsed(text) == parsed(text.encode()) == data


@pytest.mark.parametrize("levels", [DEEPEST + 1, 900])
def test_a_document_that_is_nested_too_deep_is_refused(levels: int) -> None:
    wide = [[1]] * 1000
    for text in (json.dumps(nested(levels)), json.dumps([wide, nested(levels - 1), wide])):
        with pytest.raises(ValueError, match="nested too deep; valid: up to 64 levels"):
            parsed(text)
        with pytest.raises(ValueError, match="nested too deep"):
            parsed(text.encode())


def test_a_depth_that_no_parser_reaches_is_refused_likewise() -> None:
    with pytest.raises(ValueError, match="nested too deep"):
        parsed("[" * 200_000 + "]" * 200_000)


def test_a_list_of_many_lists_is_not_deep() -> None:
    check_depth("it", [[[]]] * 100_000)


def test_configs_and_recipes_have_the_same_limit() -> None:
    deep = {"uniform": {"a": nested(450)}}
    with pytest.raises(ConfigError, match="config is nested too deep; valid: up to 64 levels"):
        FactoryConfig.from_plain({"policy_parameters": deep})
    with pytest.raises(ConfigError, match="nested too deep"):
        EpisodeSpec.from_json(json.dumps(deep))
