"""Queries: how they are read, and that the database finds what a plain filter finds."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grasp_factory.dataset.annotations import Annotation
from grasp_factory.dataset.index import (
    COLUMNS,
    OPERATORS,
    Condition,
    Index,
    IndexColumn,
    NumberBins,
    Query,
    Sort,
    WordBars,
)
from grasp_factory.dataset.index.building import add_blocks, add_store, set_annotation
from grasp_factory.dataset.index.choosing import FEW
from grasp_factory.dataset.index.columns import OF_ROWS, OF_STORES
from grasp_factory.dataset.index.database import built_aside, row_id
from grasp_factory.errors import UnknownNameError, UsageError

BY_NAME = {column.name: column for column in COLUMNS}
Row = dict[str, Any]

HOSTILE = (
    "'; DROP TABLE episodes; --",
    '"',
    "%",
    "_",
    "\\",
    "NULL",
    "*",
    "null",
    "<script>",
    "a,b",
)
WORDS = st.sampled_from(
    [*HOSTILE, "uniform", "Uniform", "top_down", "Größe", "GRÖSSE", "Ünlü", "İx"]
)
TAGS = st.sampled_from(["odd", "ODD", "straße", "x", "null", "'--"])
NUMBERS = st.sampled_from([0.0, -0.0, 0.1, -3.5, 1e300, 1e-300, 5.0, math.nan, 7.25])
WHOLE = st.sampled_from([0, 1, -1, 5, 2**53 + 1, -(2**62)])
DATES = st.sampled_from(
    ["2025-12-31T23:59:59Z", "2026-01-01T00:00:00Z", "2026-01-31T12:00:00Z", "2026-11-02T08:00:00Z"]
)
OF_KIND: Mapping[str, st.SearchStrategy[Any]] = {
    "word": WORDS,
    "text": WORDS,
    "number": NUMBERS,
    "whole": WHOLE,
    "bool": st.booleans(),
    "time": DATES,
}
PREFIXES = st.sampled_from(["2025", "2026-01", "2026-01-01", "2026-01-31T12:00", "2026", "2027"])
CHOSEN = (
    *("outcome", "policy", "object_id", "error", "lift_height", "seed", "success", "created_at"),
    *("tags", "store", "extracted_path", "sensor_setup", "scenario"),
)
"""Columns of each kind and of each place that the database has for one."""
STORES: list[dict[str, str]] = [
    {
        "scenario": scenario,
        "task_type": "grasp",
        "extracted_path": f"/data/{scenario}.zarr",
        "sensor_setup": json.dumps({"cameras": {camera: {}}}),
    }
    for scenario, camera in (("one", "front"), ("Two", "wrist"))
]


def values_of(column: IndexColumn) -> st.SearchStrategy[Any]:
    if column.words:
        return st.sampled_from(column.words)
    return OF_KIND[column.kind]


@st.composite
def rows(draw: st.DrawFn) -> Row:
    """Draw a row as people see it, with only some of its columns set."""
    row: Row = dict.fromkeys(BY_NAME)
    row["store"] = draw(st.integers(0, len(STORES) - 1))
    row["tags"] = sorted(draw(st.sets(TAGS, max_size=3)))
    for name in CHOSEN:
        if name in OF_ROWS and name not in ("store", "tags"):
            row[name] = draw(st.none() | values_of(BY_NAME[name]))
    return row


@st.composite
def conditions(draw: st.DrawFn) -> Condition:
    column = BY_NAME[draw(st.sampled_from(CHOSEN))]
    if draw(st.integers(0, 9)) == 0:
        return Condition(column.name, draw(st.sampled_from(["=", "!="])), (None,))
    operator = draw(st.sampled_from(OPERATORS[column.kind]))
    if operator == "~":
        parts = ["n", "E", "ö", "ss", "grö", "'", "%", "_", "two", "FRONT", "od", "STRASSE", "i̇"]
        return Condition(column.name, operator, (draw(st.sampled_from(parts)),))
    if column.name == "extracted_path":
        values: st.SearchStrategy[Any] = st.sampled_from(["/data/one.zarr", "/data/Two.zarr", "/"])
    elif column.name == "scenario":
        values = st.sampled_from(["one", "Two", "two"])
    elif column.kind == "time":
        values = PREFIXES | DATES
    elif column.kind in ("number", "whole"):
        values = (NUMBERS | WHOLE).filter(math.isfinite)
    else:
        values = TAGS if column.kind == "tags" else values_of(column)
    if operator in ("=", "!="):
        several = st.lists(st.none() | values, min_size=1, max_size=3)
        return Condition(column.name, operator, tuple(draw(several)))
    return Condition(column.name, operator, (draw(values),))


@st.composite
def sorts(draw: st.DrawFn) -> tuple[Sort, ...]:
    names = draw(st.lists(st.sampled_from(CHOSEN), unique=True, max_size=2))
    return tuple(Sort(name, draw(st.booleans())) for name in names)


def seen(row: Row, name: str) -> Any:
    """Return a row's value as the database holds it: None where there is none."""
    if name in OF_STORES:
        return STORES[row["store"]][name]
    value = row[name]
    if name == "tags":
        return json.dumps(value, ensure_ascii=False) if value else None
    return None if isinstance(value, float) and math.isnan(value) else value


def holds(row: Row, condition: Condition) -> bool:
    """Say whether a condition holds, in plain Python."""
    column, operator, values = BY_NAME[condition.column], condition.operator, condition.values
    mine = seen(row, column.name)
    here = (row["tags"] or [None]) if column.name == "tags" else [mine]
    if operator == "~":
        return any(x is not None and str(values[0]).casefold() in x.casefold() for x in here)
    if operator in ("=", "!="):
        if column.kind == "time":
            found = any(
                x is None if value is None else x is not None and x.startswith(str(value))
                for x in here
                for value in values
            )
        else:
            found = any(x in values for x in here)
        return found is (operator == "=")
    if mine is None:
        return False
    (value,) = values
    if column.kind == "time":
        mine = mine[: len(str(value))]
    return bool(
        {"<": mine < value, "<=": mine <= value, ">": mine > value, ">=": mine >= value}[operator]
    )


def filtered(rows: Iterable[Row], query: Query) -> list[tuple[int, int]]:
    """Return store and row of what a query finds, in its order, in plain Python."""
    found = [row for row in rows if all(holds(row, c) for c in query.conditions)]
    last = query.sort[-1].descending if query.sort else False
    found.sort(key=lambda row: (row["store"], row["row"]), reverse=last)
    for sort in reversed(query.sort):
        there = [row for row in found if seen(row, sort.column) is not None]
        absent = [row for row in found if seen(row, sort.column) is None]
        there.sort(key=lambda row: seen(row, sort.column), reverse=sort.descending)
        found = there + absent
    return [(row["store"], row["row"]) for row in found]


def index_of(path: Path, drawn: list[Row]) -> Index:
    """Return an index of rows that no store has."""
    for number, row in enumerate(drawn):
        row["row"] = number
    with built_aside(path) as connection:
        for store, facts in enumerate(STORES):
            mine = [row for row in drawn if row["store"] == store]
            plain = [tuple(None if n in ("tags", "store") else r[n] for n in OF_ROWS) for r in mine]
            source: Any = SimpleNamespace(
                path=Path(facts["extracted_path"]),
                root="",
                facts=facts,
                rows=lambda blocks, plain=plain: iter([plain]),
            )
            add_store(connection, store, source, None)
            add_blocks(connection, store, source, {0: "0 0"})
            for row in mine:
                if row["tags"]:
                    said = Annotation(row=row["row"], tags=tuple(row["tags"]))
                    key = row_id(store, row["row"])
                    assert set_annotation(connection, key, said)
    return Index(path)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("index") / "index.sqlite"


class TestWhatIsFound:
    """The database against a plain filter."""

    @pytest.mark.slow
    @given(
        st.lists(rows(), max_size=3 * FEW),
        st.lists(st.tuples(st.lists(conditions(), max_size=3), sorts()), min_size=1, max_size=8),
    )
    @settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])
    def test_it_is_what_a_plain_filter_finds_in_its_order(
        self, place: Path, drawn: list[Row], asked: list[tuple[list[Condition], tuple[Sort, ...]]]
    ) -> None:
        with index_of(place, drawn) as index:
            for wanted, order in asked:
                query = Query(tuple(wanted), order)
                expected = filtered(drawn, query)
                page = index.page(query, 0, 100)
                assert [(row["store"], row["row"]) for row in page.rows] == expected
                assert page.total == index.count(query) == len(expected)
                assert index.ids(query) == expected

    @given(st.lists(rows(), min_size=1, max_size=40), st.lists(conditions(), max_size=1), sorts())
    @settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
    def test_pages_and_neighbours_are_parts_of_the_whole_order(
        self, place: Path, drawn: list[Row], wanted: list[Condition], order: tuple[Sort, ...]
    ) -> None:
        query = Query(tuple(wanted), order)
        with index_of(place, drawn) as index:
            pages = [index.page(query, at, 7) for at in range(0, 49, 7)]
            found = [(row["store"], row["row"]) for page in pages for row in page.rows]
            assert found == filtered(drawn, query)
            assert index.page(query, 5, 0).rows == []
            for row in drawn:
                here = (row["store"], row["row"])
                beside = index.neighbours(query, *here)
                assert beside.total == len(found)
                if here not in found:
                    assert (beside.position, beside.previous, beside.next) == (None, None, None)
                    continue
                at = found.index(here)
                assert beside.position == at
                assert beside.previous == (found[at - 1] if at else None)
                assert beside.next == (found[at + 1] if at + 1 < len(found) else None)

    @given(st.lists(rows(), max_size=30), st.lists(conditions(), max_size=1))
    @settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
    def test_histograms_count_every_row_that_is_found(
        self, place: Path, drawn: list[Row], wanted: list[Condition]
    ) -> None:
        query = Query(tuple(wanted))
        with index_of(place, drawn) as index:
            places = set(filtered(drawn, query))
            found = [row for row in drawn if (row["store"], row["row"]) in places]
            good = sum(row["success"] is True for row in found)
            for name in CHOSEN:
                if BY_NAME[name].kind == "json":
                    continue
                spread = index.histogram(name, query, bins=5)
                if isinstance(spread, NumberBins):
                    values = [seen(row, name) for row in found]
                    there = [value for value in values if value is not None]
                    assert sum(spread.counts) == len(there)
                    assert spread.missing == len(values) - len(there)
                    assert bool(spread.edges) is bool(there)
                    if there:
                        assert spread.edges[0] <= min(there)
                        assert max(there) <= spread.edges[-1]
                        assert spread.edges == sorted(spread.edges)
                        assert len(spread.edges) == len(spread.counts) + 1
                elif name == "tags":
                    tagged = sum(max(1, len(row["tags"])) for row in found)
                    assert sum(count for _, count, _ in spread.bars) == tagged
                else:
                    assert sum(count for _, count, _ in spread.bars) == len(found)
                    assert sum(successes for _, _, successes in spread.bars) == good

    @given(st.lists(rows(), max_size=30))
    @settings(max_examples=30)
    def test_words_are_the_different_values_sorted(self, place: Path, drawn: list[Row]) -> None:
        with index_of(place, drawn) as index:
            policies = {row["policy"] for row in drawn} - {None}
            assert index.words("policy") == sorted(policies)
            assert index.words("policy", limit=1) == sorted(policies)[:1]
            assert index.words("tags") == sorted({tag for row in drawn for tag in row["tags"]})
            assert index.words("scenario") == ["Two", "one"]


@pytest.fixture
def some(tmp_path: Path) -> Iterator[Index]:
    drawn: list[Row] = [dict.fromkeys(BY_NAME) for _ in range(6)]
    for number, row in enumerate(drawn):
        row |= {"store": 0, "tags": [], "policy": f"p{number % 2}", "lift_height": number / 8}
        row |= {"quality": number % 5 + 1, "success": number > 3, "status": "committed"}
    with index_of(tmp_path / "index.sqlite", drawn) as index:
        yield index


class TestHistograms:
    """Counts that are known."""

    def test_bars_are_sorted_by_how_many_there_are(self, some: Index) -> None:
        found = some.histogram("policy", Query.parse(["lift_height<0.625"]))
        assert found == WordBars(column="policy", bars=[("p0", 3, 1), ("p1", 2, 0)])

    def test_few_whole_numbers_have_a_bin_each(self, some: Index) -> None:
        found = some.histogram("quality", Query())
        assert isinstance(found, NumberBins)
        assert found.edges == [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]
        assert found.counts == [2, 1, 1, 1, 1]
        assert found.successes == [1, 0, 0, 0, 1]

    def test_the_largest_number_is_in_the_last_bin(self, some: Index) -> None:
        found = some.histogram("lift_height", Query(), bins=5)
        assert isinstance(found, NumberBins)
        assert (found.units, found.missing) == ("m", 0)
        assert found.counts == [1, 1, 1, 1, 2]

    @pytest.mark.parametrize(("column", "bins"), [("sensor_setup", 5), ("lift_height", 0)])
    def test_what_cannot_be_counted_is_refused(self, some: Index, column: str, bins: int) -> None:
        with pytest.raises(UsageError, match="valid: "):
            some.histogram(column, Query(), bins)

    def test_numbers_have_no_words(self, some: Index) -> None:
        with pytest.raises(UsageError, match="lift_height is a number column"):
            some.words("lift_height")


class TestReading:
    """Conditions and orders as people write them."""

    @pytest.mark.parametrize(
        ("text", "condition"),
        [
            ("policy=uniform", Condition("policy", "=", ("uniform",))),
            (" policy != uniform ", Condition("policy", "!=", ("uniform",))),
            ("lift_height>=0.1", Condition("lift_height", ">=", (0.1,))),
            ("lift_height<-1e-3", Condition("lift_height", "<", (-0.001,))),
            ("seed=12", Condition("seed", "=", (12,))),
            ("success=true", Condition("success", "=", (True,))),
            ("success=No", Condition("success", "=", (False,))),
            ("outcome=[success, unstable]", Condition("outcome", "=", ("success", "unstable"))),
            ("outcome=[success,null]", Condition("outcome", "=", ("success", None))),
            ('object_id=["a,b", "null"]', Condition("object_id", "=", ("a,b", "null"))),
            ("note=null", Condition("note", "=", (None,))),
            ("note!=null", Condition("note", "!=", (None,))),
            ("sensor_setup=null", Condition("sensor_setup", "=", (None,))),
            ("note~a=b", Condition("note", "~", ("a=b",))),
            ("object_id=a<b", Condition("object_id", "=", ("a<b",))),
            ("tags=odd", Condition("tags", "=", ("odd",))),
            ("created_at>=2026-03", Condition("created_at", ">=", ("2026-03",))),
            ("created_at=2026-03-01 08:30", Condition("created_at", "=", ("2026-03-01T08:30",))),
        ],
    )
    def test_a_condition_is_read(self, text: str, condition: Condition) -> None:
        assert Condition.parse(text) == condition

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "condition '': valid: COLUMN=VALUE"),
            ("policy", "condition 'policy': valid: COLUMN=VALUE"),
            ("=3", "condition '=3'"),
            ("polcy=uniform", "unknown column 'polcy'; did you mean 'policy'?"),
            ("rowid=1", "unknown column 'rowid'"),
            ("1=1 OR policy=x", "condition '1=1 OR policy=x'"),
            ("policy;DROP=x", "condition 'policy;DROP=x'"),
            ('"policy"=x', "condition '\"policy\"=x'"),
            ("policy<b", "policy is a word column: got <, valid: = != ~"),
            ("lift_height~1", "lift_height is a number column: got ~, valid: = != < <= > >="),
            ("lift_height=high", "lift_height=: got 'high', valid: a number"),
            ("lift_height>nan", "lift_height>: got 'nan', valid: a number"),
            ("row=1_0", "row=: got '1_0', valid: a number"),
            ("row=\u0661\u0660", "valid: a number"),
            ("lift_height>1e1_0", "valid: a number"),
            ("lift_height>1e", "valid: a number"),
            ("row=", "row=: got '', valid: a number"),
            ("created_at>\u0662\u0660\u0662\u0666", "valid: a date"),
            ("lift_height>inf", "lift_height>: got 'inf', valid: a number"),
            ("lift_height>", "lift_height>: got '', valid: a number"),
            ("lift_height>null", "lift_height>: got 'null', valid: a number"),
            ("lift_height>[1,2]", "lift_height>: got '[1,2]', valid: a number"),
            ("seed=" + 5000 * "9", "seed=: got inf, valid: a number"),
            ("success=maybe", "success=: got 'maybe', valid: true or false"),
            ("outcome=sucess", "unknown outcome 'sucess'; did you mean 'success'?"),
            ("created_at=yesterday", "created_at=: got 'yesterday', valid: a date"),
            ("created_at>=2026-13", "created_at>=: got '2026-13', valid: a date"),
            ("created_at=2026-02-30T10", "created_at=: got '2026-02-30T10', valid: a date"),
            ("policy=[uniform", "list '[uniform': valid: [a,b]"),
            ("policy=[]", "list '[]': valid: [a,b]"),
            ("note~", "note~: got '', valid: at least a character"),
            ("sensor_setup=x", "sensor_setup is a json column: got =, valid: ~; or =null, !=null"),
            ('policy=["a", 3]', "list '[\"a\", 3]': valid: [a,b]"),
            ('policy=["a]', "list '[\"a]': valid: [a,b]"),
            ("policy=\udcff", "policy=: got '\\udcff', valid: text"),
            ("policy=" + 4_001 * "x", "valid: text"),
            ("policy=a\0b", "policy=: got 'a\\x00b', valid: text"),
            ("policy=[" + 501 * "x," + "]", "policy: got 502 values, valid: 1 to 500"),
        ],
    )
    def test_what_is_wrong_is_said(self, text: str, message: str) -> None:
        with pytest.raises(UsageError) as raised:
            Condition.parse(text)
        assert message in str(raised.value)
        assert len(str(raised.value)) < 2000

    def test_an_order_is_read(self) -> None:
        query = Query.parse(["policy=a"], "-lift_height, object_id")
        assert query.sort == (Sort("lift_height", descending=True), Sort("object_id"))
        assert query.conditions == (Condition("policy", "=", ("a",)),)
        assert Query.parse([]) == Query()

    @pytest.mark.parametrize("sort", ["lift", "-", "lift_height,", "lift_height desc", "id; DROP"])
    def test_an_order_by_no_column_is_refused(self, sort: str) -> None:
        with pytest.raises(UnknownNameError, match="unknown column"):
            Query.parse([], sort)

    def test_an_order_has_a_column_once(self) -> None:
        with pytest.raises(UsageError, match="each column once"):
            Query.parse([], "row,-row")

    def test_there_are_bounds(self) -> None:
        with pytest.raises(UsageError, match="got 51 conditions, valid: up to 50"):
            Query.parse(51 * ["row=1"])

    @given(st.text())
    def test_any_text_is_read_or_refused_in_words(self, text: str) -> None:
        for where, sort in (([text], ""), ([f"policy={text}"], ""), ([f"row>{text}"], text)):
            try:
                Query.parse(where, sort)
            except UsageError as error:
                assert str(error)


class TestHostileValues:
    """Nothing in a value is SQL."""

    @given(st.text(max_size=30), st.sampled_from(["object_id", "error", "tags"]))
    @settings(max_examples=60)
    def test_a_value_is_only_ever_a_value(self, place: Path, text: str, name: str) -> None:
        row: Row = dict.fromkeys(BY_NAME) | {"store": 0, "tags": [], "object_id": "there"}
        with index_of(place, [row]) as index:
            try:
                equal, holding = Condition(name, "=", (text,)), Condition(name, "~", (text,))
            except UsageError:
                return
            assert index.count(Query((equal,))) == int(text == "there" and name == "object_id")
            contains = name == "object_id" and text.casefold() in "there"
            assert index.count(Query((holding,))) == int(contains)
            assert index.count(Query()) == 1

    def test_many_long_lists_are_within_the_databases_limits(self, some: Index) -> None:
        many = tuple(map(str, range(500)))
        lists = [
            Condition(name, operator, values)
            for name, values in (
                ("object_id", many),
                ("created_at", 500 * ("2026",)),
                ("tags", many),
            )
            for operator in ("=", "!=")
        ]
        with pytest.raises(UsageError, match="got 6000 values, valid: up to 5000"):
            Query((*lists, *lists))
        query = Query((*lists, *lists[2:]))
        assert some.count(query) == 0
        histogram = some.histogram("policy", query)
        assert isinstance(histogram, WordBars)
        assert histogram.bars == []

    def test_a_connection_that_asks_cannot_write(self, some: Index) -> None:
        with (
            closing(sqlite3.connect(f"{some.path.as_uri()}?mode=ro", uri=True)) as connection,
            pytest.raises(sqlite3.OperationalError, match="readonly"),
        ):
            connection.execute("DELETE FROM episodes")
        with some._reading() as mine, pytest.raises(sqlite3.OperationalError, match="readonly"):
            mine.execute("DELETE FROM episodes")
