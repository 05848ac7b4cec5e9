"""What a request asks for: numbers, and a query of the index."""

from __future__ import annotations

import re

from flask import request
from werkzeug.routing import BaseConverter

from grasp_factory.dataset.index import Query
from grasp_factory.errors import UsageError, shown

MOST_CONDITIONS = 20
"""Maximum per query: each one costs a search of its own, and many users may ask at once."""
_DIGITS = "[0-9]{1,9}"


class Number(BaseConverter):
    """A whole number in an address, such as a row."""

    regex = _DIGITS

    def to_python(self, value: str) -> int:
        """Return the number."""
        return int(value)


def integer(name: str, default: int, most: int) -> int:
    """Return a whole number of the request, no more than ``most``.

    Raises:
        UsageError: if the value is not such a number.
    """
    text = request.args.get(name, str(default))
    if not re.fullmatch(_DIGITS, text) or int(text) > most:
        raise UsageError(f"{name}: got {shown(text)}, valid: 0 to {most}")
    return int(text)


def asked_query() -> Query:
    """Return the query in the request's parameters ``where`` and ``sort``.

    Raises:
        UsageError: if they are invalid.
    """
    where = request.args.getlist("where")
    if len(where) > MOST_CONDITIONS:
        raise UsageError(f"got {len(where)} conditions, valid: up to {MOST_CONDITIONS} here")
    return Query.parse(where, request.args.get("sort", ""))
