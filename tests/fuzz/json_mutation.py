"""Change one value of a JSON document, so that most inputs are JSON and reach what reads it."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

import atheris

VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 2**31, 2**32, 2**63, 10**30, 0.5, 1e308, 1e999),
    *(
        float("nan"),
        "",
        "0",
        "a",
        "\x00",
        "\x1b[2J",
        "../..",
        "/",
        "é",
        "\ud800",
        "NaN",
        "9" * 5000,
    ),
    *([], {}, [0], [[]], [1, 2, 3], [-1, 2**40], {"": None}, {"name": "zstd"}, [None, None]),
    json.loads("[" * 200 + "]" * 200),
)
"""Values that take the place of another."""


def mutate_json(data: bytes, most: int, seed: int) -> bytes:
    """Return a changed input; see ``atheris.Setup(custom_mutator=...)``."""
    rng = random.Random(seed)
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        document = None
    if document is None or rng.random() < 0.2:
        return bytes(atheris.Mutate(data, most))
    try:
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            document = _changed(document, rng)
        changed = json.dumps(document).encode()
    except RecursionError:  # values in each other, as an input of many changes has them
        return bytes(atheris.Mutate(data, most))
    return changed if len(changed) <= most else bytes(atheris.Mutate(data, most))


def _changed(document: Any, rng: random.Random) -> Any:
    """Return a document in which one value is another, is gone, or is there twice."""
    places = [(inner, key) for inner in _containers(document) for key in _keys(inner)]
    if not places:
        return copy.deepcopy(rng.choice(VALUES))
    inner, key = rng.choice(places)
    match rng.randrange(4):
        case 0:
            del inner[key]
        case 1:
            other, its = rng.choice(places)
            inner[key] = copy.deepcopy(other[its])
        case 2 if isinstance(inner, dict):
            inner[f"{key}{rng.choice(('', ' ', '2'))}"] = inner.pop(key)
        case _:
            inner[key] = copy.deepcopy(rng.choice(VALUES))
    return document


def _containers(value: Any) -> list[Any]:
    """Return all objects and lists in a document."""
    found, todo = [], [value]
    while todo:
        inner = todo.pop()
        if isinstance(inner, (dict, list)):
            found.append(inner)
            todo += inner.values() if isinstance(inner, dict) else inner
    return found


def _keys(inner: Any) -> list[Any]:
    return list(inner) if isinstance(inner, dict) else list(range(len(inner)))
