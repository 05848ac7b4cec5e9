"""The dataset card: what it says is what is in the store, and nothing in the data breaks it."""

from __future__ import annotations

import csv
import dataclasses
import errno
import html
import json
import math
import re
import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import mlcroissant
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_rows, make_spec, small_config
from support.helpers import assert_same_tree, tree
from support.hostile.table import configured
from support.hostile.texts import MARKUP, every_text, labelled
from support.places import TINY

from grasp_factory.apps.card import FILES, Publication, figures, making, write_card
from grasp_factory.apps.card.licences import LICENCES, licence_url
from grasp_factory.apps.card.limits import known_limits
from grasp_factory.apps.card.markdown import escape, fenced, table, word
from grasp_factory.apps.card.meanings import MEANINGS, label_conditions
from grasp_factory.apps.card.readme import size_category
from grasp_factory.apps.pictures.painting import bgr, outcome_color
from grasp_factory.core import palette, schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.text_format import escaped
from grasp_factory.curation.merge import merge
from grasp_factory.curation.relabel import relabel
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import StoreError, UnknownNameError, UsageError
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.store import prepare_store

Run = Callable[..., tuple[int, str, str]]

CONFIG = small_config()
N = 22
BAD = (5, 13, 14)
"""Quarantined episodes."""
NASTY = (
    "a|b",
    "a\\|b",
    "`tick`",
    "<b>bold</b> & <!-- -->",
    'quotes", comma',
    "new\nline",
    "return\rhere",
    "![i](x) [l](y)",
    "- key: value #c",
    "=1+1",
    "ünï çödé 物",
    "---",
    "$x^2$ @me ~no~ *yes* _no_",
)
"""What object names of users' files may look like."""
SAID = Publication(
    name="Grasps: a | <b>", licence="cc-by-4.0", url="https://example.org/a",
    date_published="2026-01-31", version="2.0.1", description="Some *grasps*.",
)  # fmt: skip


def write_store(path: Path, config: FactoryConfig = CONFIG, n: int = N, blocks: int = 99) -> Path:
    """Write the first blocks of a store with random episodes of objects with nasty names."""
    prepare_store(path, config, JOINTS, n, {})
    for block in range(min(blocks, -(-n // config.block_size))):
        rows = make_rows(config, block, n)
        ZarrWriter(path).write_block(
            block, [_nasty(row, config, block, i) for i, row in enumerate(rows)]
        )
    return path


def _nasty(row: Any, config: FactoryConfig, block: int, place: int) -> Any:
    index = block * config.block_size + place
    if index in BAD:
        return Quarantined(make_spec(config, index), f"no | luck\nwith <{index > 5}>")
    name = NASTY[index % len(NASTY)]
    named = {"object_id": f"mine/{name}", "object_family": name}
    return dataclasses.replace(row, columns={**row.columns, **named})


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_store(tmp_path_factory.mktemp("card") / "s.zarr")


@pytest.fixture(scope="module")
def card(store: Path) -> Path:
    """A card of the store with everything said that can be."""
    return Path(write_card(store, publication=SAID).path)


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    return Path(shutil.copytree(TINY, tmp_path / "tiny.zarr"))


def text_of(card: Path) -> str:
    return (card / "README.md").read_text(encoding="utf-8")


def tables(text: str) -> Iterator[list[list[str]]]:
    """Give the cells of each table of a text as they read, the rule left out."""
    for block in re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE):
        rows = [line.strip()[1:-1].split("|") for line in block.splitlines()]
        assert {len(row) for row in rows} == {len(rows[0])}, block
        assert all(set(cell.strip()) <= set("-:") for cell in rows[1])
        yield [[read(cell.strip()) for cell in row] for row in (rows[0], *rows[2:])]


def read(cell: str) -> str:
    """Return what a reader sees of ``word``, or of a plain cell."""
    code = re.fullmatch(r"`([^`]*)`", cell)
    return code[1] if code else html.unescape(re.sub(r"</?code>", "", cell))


def in_a_line(text: str) -> str:
    return " ".join(text.split())


# Markdown ---------------------------------------------------------------------------------------


@given(st.text(max_size=40))
def test_a_word_reads_as_its_text_and_is_one_cell_of_one_line(text: str) -> None:
    made = word(text)
    assert not set(made) & set("|\n\r\\*[]!")
    assert re.sub("</?code>", "", made).count("<") == 0
    assert read(made) == in_a_line_visible(text)


@given(st.text(max_size=40))
def test_an_escaped_text_has_no_markup_left(text: str) -> None:
    made = escape(text)
    assert not set(re.sub(r"&#\d+;", "", made)) & set("\\`*_[]<>|~$\n\r")
    assert html.unescape(made) == html.unescape(html.escape(in_a_line_visible(text)))


def in_a_line_visible(text: str) -> str:
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode()
        for c in in_a_line(text)
    )


@given(st.text(alphabet="`~a\n ", max_size=30))
def test_nothing_in_a_block_of_code_ends_it(text: str) -> None:
    first, *inner, last = fenced(text, "yaml").split("\n")
    assert first == f"{last}yaml"
    assert all(last not in line for line in inner)


@given(st.lists(st.tuples(st.text(max_size=9), st.text(max_size=9)), max_size=5))
def test_a_table_of_any_words_has_all_its_cells(rows: list[tuple[str, str]]) -> None:
    made = table(("a", "b"), [tuple(map(word, row)) for row in rows], right=(1,))
    (found,) = tables(made)
    assert found[1:] == [list(map(in_a_line_visible, row)) for row in rows]


def test_descriptions_of_the_schema_may_stand_in_a_table() -> None:
    for field in schema.FIELDS:
        assert not set(field.description) & set("|\n<`"), field.path


# What the README says ---------------------------------------------------------------------------


def test_the_front_matter_is_what_the_hub_wants(card: Path) -> None:
    _, front, rest = text_of(card).split("---\n", 2)
    metadata = yaml.safe_load(front)
    assert metadata["license"] == "cc-by-4.0"
    assert metadata["pretty_name"] == SAID.name
    assert metadata["task_categories"] == ["robotics"]
    assert metadata["size_categories"] == ["n<1K"]
    (config,) = metadata["configs"]
    assert (card / config["data_files"][0]["path"]).is_file()
    assert {"robotics", "grasping", CONFIG.robot} <= set(metadata["tags"])
    assert html.unescape(rest.strip().splitlines()[0]) == f"# {SAID.name}"
    assert "Some *grasps*." in rest


def test_every_table_is_well_formed_and_names_stay_what_they_are(card: Path) -> None:
    found = {rows[0][0]: rows for rows in tables(text_of(card))}
    families = {row[0] for row in found["object family"][1:]}
    assert families == {in_a_line(name) for name in NASTY}
    reasons = {row[1]: row[0] for row in found["rows"][1:]}
    assert reasons == {"no | luck with <True>": "2", "no | luck with <False>": "1"}


def test_the_counts_are_those_of_info(store: Path, card: Path) -> None:
    counted = summarise(Dataset(store))
    found = {rows[0][0]: rows[1:] for rows in tables(text_of(card))}
    for title, tallies in (
        ("policy", counted.policies),
        ("object set", counted.object_sets),
        ("split", counted.splits),
    ):
        said = {row[0]: (int(row[2]), int(row[3])) for row in found[title]}
        assert said == {key: (t.episodes, t.successes) for key, t in tallies.items()}
    assert {row[0]: int(row[1]) for row in found["outcome"]} == counted.outcomes
    assert {row[0]: int(row[1]) for row in found["score"]} == counted.quality
    assert f"{counted.quarantined} rows of {counted.episodes} hold no episode" in text_of(card)
    general = dict(row for row in found[""])
    assert general["episodes"] == str(counted.committed)
    assert general["success"].startswith(f"{counted.successes} (")


def test_the_objects_of_a_split_are_counted_once(store: Path, card: Path) -> None:
    dataset = Dataset(store)
    splits, ids = dataset.column("split"), dataset.column("object_id")
    found = next(rows for rows in tables(text_of(card)) if rows[0][0] == "split")
    for name, objects, *_ in found[1:]:
        rows = dataset.where(split=name).indices
        assert int(objects) == len(set(ids[rows].tolist()))
    assert [row[0] for row in found[1:]] == [s for s in ("train", "val", "test") if s in splits]


def test_missing_rows_are_told(tmp_path: Path, run: Run) -> None:
    path = write_store(tmp_path / "s.zarr", n=12, blocks=1)
    code, out, _ = run("card", path)
    assert code == 0
    assert "8 episodes of" in out
    assert "**8 of 12 rows are missing**" in text_of(Path(f"{path}.card"))


def test_every_outcome_has_a_meaning() -> None:
    assert set(MEANINGS) == set(Outcome)


def test_the_label_is_told_with_its_own_thresholds() -> None:
    label = {"min_lift": 0.07, "min_shake": 0.0, "min_grip_force": 2.5, "max_slip_angle": 0.3}
    told = " ".join(label_conditions(small_config(label=label)))
    for words in ("0.07 m above", "need not be survived", "less than 2.5 N", "at most 0.3 rad"):
        assert words in told
    assert "shake of 1 g" in " ".join(label_conditions(CONFIG))
    assert "N during" not in " ".join(label_conditions(CONFIG))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"clutter": {"count": 3}}, "lies alone"),
        ({"policies": {"antipodal": 1.0}}, "straight down"),
        ({"randomize": {"surroundings": 5}}, "same in every episode"),
        ({"renderer": "egl"}, "without shadows"),
        ({"object_sets": {"procedural": 1.0}}, "bounding box"),
    ],
)
def test_limits_follow_from_the_config(change: dict[str, Any], words: str) -> None:
    assert any(words in limit for limit in known_limits(CONFIG))
    assert not any(words in limit for limit in known_limits(small_config(**change)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"quality": {"min_score": 4}}, "below 4"),
        ({"object_splits": ["test", "val"]}, "Only objects of val and test"),
        ({"physics": {"free_hz": 240, "contact_hz": 240}}, "coarser"),
    ],
)
def test_settings_that_bias_a_dataset_are_limits(change: dict[str, Any], words: str) -> None:
    assert not any(words in limit for limit in known_limits(CONFIG))
    assert any(words in limit for limit in known_limits(small_config(**change)))


@pytest.mark.parametrize(
    ("episodes", "category"),
    [(1, "n<1K"), (999, "n<1K"), (1000, "1K<n<10K"), (98_312, "10K<n<100K"),
     (100_000, "100K<n<1M"), (10_000_000, "10M<n<100M")],
)  # fmt: skip
def test_sizes_have_the_hubs_names(episodes: int, category: str) -> None:
    assert size_category(episodes) == category


def test_the_examples_in_it_run(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = text_of(Path(write_card(tiny).path))
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tiny.parent)
    scope: dict[str, Any] = {}
    for code in examples:
        exec(code, scope)
    assert len(examples) == 2
    dataset = Dataset(tiny)
    train = dataset.where(split="train", success=True)
    assert scope["train"].indices.tolist() == train.indices.tolist()
    assert scope["word"] == dataset[0].outcome.name.lower()
    assert np.array_equal(scope["before"], dataset.image(0, "front", "rgb", 0))


def test_the_config_beside_it_is_that_of_the_store(tiny: Path, run: Run) -> None:
    file = Path(write_card(tiny).path, "config.yaml")
    code, out, _ = run("generate", "--config", file, "--print-config")
    assert code == 0
    printed, config = yaml.safe_load(out), Dataset(tiny).config
    assert {key: printed[key] for key in config.to_plain()} == config.to_plain()
    assert file.read_text() in text_of(file.parent)


def test_added_labels_are_told_and_in_the_table(tiny: Path) -> None:
    relabel(tiny, "gentle", LabelConfig(min_shake=0.5, max_slip_distance=0.001))
    card, dataset = Path(write_card(tiny).path), Dataset(tiny)
    label = dataset.label("gentle")
    found = next(rows for rows in tables(text_of(card)) if rows[0][0] == "label")
    share = f"{100 * np.mean(label == Outcome.SUCCESS):.1f} %"
    assert found[1][:3] == ["gentle", str(len(label)), share]
    assert "max_slip_distance 0.001" in found[1][3]
    words = [row["labels/gentle"] for row in records(card)]
    assert words == [names(Outcome)[code] for code in label]


@pytest.mark.parametrize("values", [(), (7,), (None,), ([1],), ({"a": "x"},), ({"a": 10**400},)])
def test_a_label_whose_thresholds_are_no_numbers_is_refused(
    values: tuple[Any, ...], tiny: Path, tmp_path: Path
) -> None:
    relabel(tiny, "gentle", LabelConfig())
    labelled(*values)(tiny, tmp_path)
    message = "labels/gentle is damaged: thresholds: got .*, valid: finite numbers by name"
    with pytest.raises(StoreError, match=message):
        write_card(tiny)
    with pytest.raises(StoreError, match=message):
        merge([tiny], tmp_path / "merged.zarr")


@pytest.mark.slow
def test_a_store_that_was_put_together_says_so(tmp_path: Path) -> None:
    parts = [
        write_store(tmp_path / f"{seed}.zarr", dataclasses.replace(CONFIG, seed=seed), 4)
        for seed in (3, 8)
    ]
    merge(parts, tmp_path / "all.zarr")
    text = text_of(Path(write_card(tmp_path / "all.zarr").path))
    found = next(rows for rows in tables(text) if rows[0][0] == "seed")
    assert [row[:2] for row in found[1:]] == [["3", "4"], ["8", "4"]]
    assert "grasp-factory generate" not in text


# The table and Croissant ------------------------------------------------------------------------


def records(card: Path) -> list[dict[str, str]]:
    with (card / "episodes.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def expected(dataset: Dataset) -> dict[str, list[Any]]:
    """Return the values of each column of the table; texts as they are in a cell."""
    rows = dataset.committed
    fields = {f.path.removeprefix("episodes/"): f for f in schema.expand(dataset.config)}
    out: dict[str, list[Any]] = {"row": rows.tolist()}
    for name in dataset.columns:
        if fields[name].dims or name in ("status", "checksum", "fingerprint", "spec", "error"):
            continue
        values = dataset.column(name)[rows].tolist()
        words = fields[name].names
        out[name] = [words[value] for value in values] if words else values
        if fields[name].dtype == "string":
            out[name] = [in_a_cell(text) for text in values]
    return out


def in_a_cell(text: str) -> str:
    """Return a text so that no spreadsheet computes it."""
    plain = text.replace("\r", "\\r")
    return f"'{plain}" if plain[:1] in tuple("=+-@\t\n") else plain


def same(a: Any, b: Any) -> bool:
    """Say whether two values are equal, NaN and the sign of zero included."""
    if isinstance(a, float) and isinstance(b, float):
        are_nan = math.isnan(a) and math.isnan(b)
        return are_nan or (a == b and math.copysign(1, a) == math.copysign(1, b))
    return type(a) is type(b) and a == b


def test_the_table_has_every_value_of_the_dataset_bit_for_bit(store: Path, card: Path) -> None:
    want, found = expected(Dataset(store)), records(card)
    assert list(found[0]) == list(want)
    for name, values in want.items():
        kind: Callable[[str], Any] = type(values[0])
        if kind is bool:
            kind = {"True": True, "False": False}.__getitem__
        assert all(same(kind(r[name]), v) for r, v in zip(found, values, strict=True)), name


def load(card: Path) -> mlcroissant.Dataset:
    with warnings.catch_warnings():
        # rdflib's JSON-LD parser uses a class that rdflib itself deprecates.
        warnings.filterwarnings("ignore", "ConjunctiveGraph is deprecated", DeprecationWarning)
        return mlcroissant.Dataset(card / "croissant.json")


@pytest.fixture(scope="module")
def described(card: Path) -> mlcroissant.Dataset:
    return load(card)


def test_croissant_has_neither_errors_nor_warnings(described: mlcroissant.Dataset) -> None:
    issues = described.metadata.ctx.issues
    assert (issues.errors, issues.warnings) == (set(), set())
    assert described.metadata.name == SAID.name
    assert described.metadata.license == ["https://spdx.org/licenses/CC-BY-4.0.html"]


def test_croissant_alone_misses_only_the_date(store: Path, tmp_path: Path) -> None:
    card = Path(write_card(store, tmp_path / "c").path)
    issues = load(card).metadata.ctx.issues
    assert issues.errors == set()
    (missed,) = issues.warnings
    assert "datePublished" in missed


def test_croissants_records_are_the_datasets(store: Path, described: mlcroissant.Dataset) -> None:
    want, found = expected(Dataset(store)), list(described.records("episodes"))
    assert len(found) == len(want["row"])
    for name, values in want.items():
        for record, value in zip(found, values, strict=True):
            got = record[f"episodes/{name}"]
            got = got.decode() if isinstance(got, bytes) else got
            is_empty = value == "" or (isinstance(value, float) and math.isnan(value))
            assert got is None if is_empty else same(got, value), (name, got, value)


def test_croissant_says_where_the_stores_files_are(tiny: Path, tmp_path: Path) -> None:
    for out in (tmp_path / "c", tiny.parent):  # elsewhere, and in the folder that has the store
        write_card(tiny, out)
        document = json.loads((out / "croissant.json").read_text())
        (files,) = [d for d in document["distribution"] if d["@type"] == "cr:FileSet"]
        assert files["includes"] == "tiny.zarr/**"
    inner = tmp_path / "data" / "a[b].zarr"
    shutil.copytree(tiny, inner)
    write_card(inner, tmp_path, force=True)
    text = (tmp_path / "croissant.json").read_text()
    assert '"data/a[[]b].zarr/**"' in text
    assert 'Dataset("data/a[b].zarr")' in text_of(tmp_path)


# Figures ----------------------------------------------------------------------------------------


def test_every_figure_is_an_image_that_the_readme_shows(card: Path) -> None:
    shown = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text_of(card))
    assert sorted(shown) == sorted(name for name in FILES if name.endswith(".png"))
    for name in shown:
        image = cv2.imread(str(card / name))
        assert image is not None
        assert image.std() > 1.0


def test_bars_are_as_long_as_there_are_episodes() -> None:
    outcomes = {"success": 30, "collision": 60, "no_contact": 15}
    image = figures.outcomes_chart(outcomes)
    lengths = []
    for i, name in enumerate(outcomes):
        color = outcome_color(Outcome[name.upper()])
        line = image[figures.MARGIN + figures.ROW * i + figures.ROW // 2]
        lengths.append(int((line == color).all(axis=1).sum()))
    assert lengths[1] == pytest.approx(2 * lengths[0], abs=2)
    assert lengths[0] == pytest.approx(2 * lengths[2], abs=2)


VALUES = st.lists(
    st.tuples(st.floats(allow_nan=True, allow_infinity=False, width=32), st.booleans()),
    min_size=1, max_size=50,
)  # fmt: skip


@given(VALUES)
def test_a_histogram_counts_every_value_once(drawn: list[tuple[float, bool]]) -> None:
    values = np.array([value for value, _ in drawn])
    success = np.array([good for _, good in drawn])
    seen = ~np.isnan(values)
    if not seen.any():
        return
    edges = figures.bin_edges(values)
    assert (np.diff(edges) > 0).all()
    good, bad = figures.stacked_counts(values[seen], success[seen], edges)
    assert (good.sum(), bad.sum()) == ((success & seen).sum(), (~success & seen).sum())


def test_a_measurement_that_nothing_has_is_drawn_as_such() -> None:
    nothing = {m.column: np.full(3, np.nan) for m in figures.measures(LabelConfig())}
    image = figures.measures_chart(nothing | {"success": np.zeros(3, bool)}, LabelConfig())
    below = image[40:]
    assert not (below == bgr(palette.FAILURES.light)).all(axis=2).any()


# The folder -------------------------------------------------------------------------------------


def test_nothing_that_a_store_says_is_markup_in_its_card(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hostile = tiny.rename(tmp_path / "\x9b\u202e<img src=x>`.zarr")
    every_text(hostile, tmp_path)
    configured(robot=MARKUP, policies={MARKUP: 1.0}, object_sets={MARKUP: 1.0})(hostile, tmp_path)
    monkeypatch.setattr(making, "sheet_of", lambda *_: np.zeros((8, 8, 3), np.uint8))
    card = Path(write_card(hostile, tmp_path / "card").path)
    for name in FILES:
        if not name.endswith(".png"):
            text = (card / name).read_text(encoding="utf-8")
            assert all(c == "\n" or c.isprintable() for c in text), name
    _, front, *rest = text_of(card).split("---\n", 2)
    assert yaml.safe_load(front)["tags"][-1] == escaped(MARKUP)
    shown = re.sub(r"^(```+)\w*\n.*?^\1$", "", "".join(rest), flags=re.MULTILINE | re.DOTALL)
    assert "&#60;img" in shown
    assert not re.search(r"<img|\]\(java|javascript:", shown)
    config = FactoryConfig.from_plain(yaml.safe_load((card / "config.yaml").read_text()))
    assert config == Dataset(hostile).config


def test_the_store_is_only_read(store: Path, tmp_path: Path) -> None:
    before = tree(store)
    write_card(store, tmp_path / "c")
    assert tree(store) == before


def test_verify_and_repair_do_not_mind_a_card(tiny: Path, run: Run) -> None:
    write_card(tiny)
    report = verify(tiny)
    assert report.is_whole
    assert report.notes == ()
    assert run("repair", tiny)[0] == 0


def test_the_same_store_gives_the_same_bytes(store: Path, card: Path, tmp_path: Path) -> None:
    again = write_card(store, tmp_path / "elsewhere", SAID)
    assert_same_tree(card, Path(again.path))
    assert sorted(tree(card)) == sorted(again.files)


def test_a_card_is_written_again_as_long_as_nobody_changed_it(tiny: Path) -> None:
    card = Path(write_card(tiny).path)
    relabel(tiny, "gentle", LabelConfig(min_shake=0.5))
    before = text_of(card)
    write_card(tiny)
    assert text_of(card) != before
    write_card(tiny, publication=SAID)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_file_that_somebody_changed_is_kept(name: str, tiny: Path) -> None:
    card = Path(write_card(tiny).path)
    written = (card / name).read_bytes()
    (card / name).write_bytes(written + b"\n")
    with pytest.raises(UsageError, match=rf"card: {re.escape(name)} not written by this"):
        write_card(tiny)
    assert (card / name).read_bytes() == written + b"\n"
    write_card(tiny, force=True)
    assert (card / name).read_bytes() == written


def test_a_readme_that_a_person_wrote_is_kept(tiny: Path, tmp_path: Path, run: Run) -> None:
    mine = tmp_path / "README.md"
    mine.write_text("# Mine\n")
    code, _, said = run("card", tiny, "--out", tmp_path)
    assert (code, mine.read_text()) == (2, "# Mine\n")
    assert "README.md not written by this command, or changed since" in said
    assert run("card", tiny, "--out", tmp_path, "--force")[0] == 0
    assert text_of(tmp_path).startswith("---\n")


def test_a_changed_sentence_is_a_change(tiny: Path) -> None:
    file = Path(write_card(tiny).path, "README.md")
    file.write_text(file.read_text().replace("grasp attempts", "grasps", 1))
    with pytest.raises(UsageError, match="--force replaces them"):
        write_card(tiny)


def test_other_files_of_the_folder_stay(tiny: Path) -> None:
    card = Path(write_card(tiny).path)
    (card / "LICENSE").write_text("mine")
    write_card(tiny)
    assert (card / "LICENSE").read_text() == "mine"


@pytest.mark.parametrize("inside", ["", "episodes", "episodes/new"])
def test_no_card_lies_in_a_store(inside: str, tiny: Path) -> None:
    before = tree(tiny)
    with pytest.raises(UsageError, match=r"lies in the Zarr store .* valid: a folder beside it"):
        write_card(tiny, tiny / inside)
    assert tree(tiny) == before


def test_a_disk_that_is_full_is_one_line(
    tiny: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(making, "write_table", full)
    code, _, said = run("card", tiny)
    assert (code, said.count("\n")) == (1, 1)
    assert "cannot be written: No space left on device" in said
    assert list(Path(f"{tiny}.card").iterdir()) == []


def test_a_damaged_table_of_the_store_is_told(tiny: Path) -> None:
    shutil.rmtree(tiny / "episodes" / "object_id")
    with pytest.raises(StoreError, match="object_id"):
        write_card(tiny)


# The command ------------------------------------------------------------------------------------


def test_the_command_says_what_it_wrote(tiny: Path, run: Run) -> None:
    code, out, _ = run("card", tiny, "--json")
    said = json.loads(out)
    assert code == 0
    assert said["files"] == list(FILES)
    assert all(Path(said["path"], name).is_file() for name in FILES)
    code, out, _ = run("card", tiny)
    assert code == 0
    assert out.splitlines() == [str(Path(said["path"], name)) for name in FILES]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--license", "cc-by"), "unknown licence 'cc-by'; did you mean"),
        (("--date-published", "2026-02-30"), "--date-published: got '2026-02-30', valid: a day"),
        (("--date-published", "20260230"), "valid: a day, as in 2026-01-31"),
        (("--version", "1.0"), "--version: got '1.0', valid: MAJOR.MINOR.PATCH"),
        (("--url", "example.org"), "--url: got 'example.org', valid: an address"),
        (("--url", "https://a.org/<b>"), "valid: an address"),
        (("--name", " "), "--name: got ' ', valid: one line"),
        (("--name", "a\nb"), "valid: one line"),
        (("--description", "\x07"), "--description: got"),
        (("--out", "file"), "is a file, valid: a folder"),
        (("--out", "a/b"), "there is no directory"),
    ],
)
def test_what_cannot_be_said_is_a_usage_error(
    options: tuple[str, str], words: str, complaint: Callable[..., tuple[int, str]]
) -> None:
    Path("file").write_text("")
    code, said = complaint("card", TINY, *options)
    assert (code, said.count("\n")) == (2, 1)
    assert words in said
    assert [path.name for path in Path().iterdir()] == ["file"]


def test_without_a_store_or_episodes_there_is_nothing_to_describe(
    complaint: Callable[..., tuple[int, str]],
) -> None:
    assert complaint("card", "none.zarr") == (2, "Error: there is no store at none.zarr\n")
    prepare_store(Path("empty.zarr"), CONFIG, JOINTS, 4, {})
    code, said = complaint("card", "empty.zarr")
    assert code == 2
    assert "has no episodes to describe" in said
    assert not Path("empty.zarr.card").exists()


# Licences ---------------------------------------------------------------------------------------


def test_the_stores_own_licence_is_the_default_and_a_name_of_the_hubs(tiny: Path) -> None:
    assert write_card(tiny).licence == Dataset(tiny).attributes["license"].lower()
    assert write_card(tiny, publication=Publication(licence="odbl")).licence == "odbl"
    assert licence_url("odbl") == "https://spdx.org/licenses/ODbL-1.0.html"
    assert licence_url("unknown") == "unknown"
    assert list(LICENCES) == sorted(LICENCES)
    with pytest.raises(UnknownNameError):
        Publication(licence="MIT")


def test_of_users_objects_the_licence_is_not_known(tmp_path: Path) -> None:
    folders = {"object_sets": {"mine": 1.0}, "object_folders": {"mine": "0" * 64}}
    path = write_store(tmp_path / "s.zarr", small_config(**folders), 4)
    card = write_card(path)
    assert card.licence == "unknown"
    text = text_of(Path(card.path))
    assert "The objects of `mine` are their makers'" in text
    assert "grasp-factory objects DIR" in text
