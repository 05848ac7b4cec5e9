"""Whatever stands in a config, on the command line or beside a store: one line, and no harm."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.helpers import tree
from support.scale import scaled

from grasp_factory.__main__ import main
from grasp_factory.apps.pictures import preview
from grasp_factory.cli.main import generate as generate_command
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.executors import ProcessExecutor
from grasp_factory.curation import relabel
from grasp_factory.errors import StoreError, StoreMismatchError, UsageError
from grasp_factory.factory import generate
from grasp_factory.factory.run_log import RunLog
from grasp_factory.factory.run_request import Request, resolve_request
from grasp_factory.writers.zarr.lock import StoreLock

TINY = ("--resolution", "32x24", "--set", "block_size=2", "--workers", "1", "--n", "2")
FAR_ENOUGH = "every check was passed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    code: int
    out: str
    err: str


def run(*args: str) -> Result:
    """Run the command in this process; a traceback fails the test."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(sys, "argv", ["grasp-factory", *args]))
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        left = stack.enter_context(pytest.raises(SystemExit))
        main()
    assert isinstance(left.value.code, int)
    return Result(code=left.value.code, out=out.getvalue(), err=err.getvalue())


def check_refusal(result: Result) -> None:
    """Check that a failed command said why in one line of its own."""
    lines = result.err.splitlines()
    assert lines, "it said nothing"
    *before, last = lines
    assert last.startswith("Error: ")
    assert last.isprintable()
    assert len(last) < 1200
    assert all(line.startswith("Warning: ") for line in before)


@contextlib.contextmanager
def unharmed(folder: Path) -> Iterator[None]:
    """Fail if anything below a folder is not what it was, once the block has ended."""
    before, names = tree(folder), sorted(folder.rglob("*"))
    yield
    assert tree(folder) == before
    assert sorted(folder.rglob("*")) == names


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """An own folder to work in, with a store of two episodes."""
    path = tmp_path_factory.mktemp("bad")
    generate.generate(CONFIG, 2, path / "ds.zarr", workers=1)
    with contextlib.chdir(path):
        yield path


CONFIG = FactoryConfig(resolution=(32, 24), block_size=2)
VALID = Request(config=CONFIG, n=2, workers=1, out=Path("ds.zarr")).to_yaml()

# --- config files -------------------------------------------------------------------------------

SEEDS = (
    VALID,
    "policies: {uniform: 2, top_down: 1}\n",
    "cameras: {a: &c {eye: [1, 0, 1], target: [0, 0, 0]}, b: *c}\n",
    "randomize: strong\nclutter: 3\nresolution: 64x48\nshard: 1/4\n",
)
PIECES = (
    "!!python/object/apply:os.system ['touch harm']", "!!python/name:os.system",
    "!!python/object/new:os.system ['touch harm']", "!!map", "!!binary /w==", "!!set {a, b}",
    "!!omap [a: 1]", "!!pairs [a: 1]", "!!timestamp 2001-02-03", "!foo bar", "%YAML 9.9\n---\n",
    "---\n", "...\n", "&a ", "*a", "<<: *a", "<<: [1]", "? ", ": ", "- ", "[", "]", "{", "}",
    "|\n ", ">\n ", "'", "\"", "#", "\t", "\u0000", "\u0085", "\u2028", "\ufeff", "9" * 400,
    "9" * 5000, "-1", "1e400", "-1e-400", ".nan", ".inf", "0x" + "f" * 300, "1:2:3", "0o17",
    "true", "null", "~", "''", "[1, 2, 3]", "{a: {b: c}}", "k" * 3000, "../..", "/dev/zero",
    "[" * 60, "2001-99-99", "=", "<<", "__class__", "__init__", "\\x00", "${HOME}", "`id`",
    "%s%s%n", "{0.__class__}",
)  # fmt: skip


@st.composite
def mutants(draw: st.DrawFn) -> str:
    """Texts near a valid config: pieces put in, cut out, and doubled."""
    text = draw(st.sampled_from(SEEDS))
    for _ in range(draw(st.integers(1, 4))):
        # Near a word's edge, where a value begins, most of the time.
        edges = [m.end() for m in re.finditer(r": |\n|- ", text)] or [0]
        start = draw(st.sampled_from(edges) | st.integers(0, len(text)))
        stop = draw(st.just(text.find("\n", start) % (len(text) + 1)) | st.integers(0, len(text)))
        piece = draw(st.sampled_from(PIECES) | st.text(max_size=8) | st.just(text[start:stop]))
        text = text[:start] + piece + text[max(start, stop) :]
    return text


def refuse_all(*_: Any, **__: Any) -> None:
    raise StoreError(FAR_ENOUGH)


@settings(max_examples=150)
@given(mutants())
def test_a_config_near_a_valid_one_is_a_request_or_an_error_of_one_line(text: str) -> None:
    try:
        request = resolve_request(checked_mapping(text), {})
    except UsageError as error:
        assert len(str(error)) < 2000
        return
    assert resolve_request(parse_yaml(request.to_yaml(), "this"), {}) == request


def checked_mapping(text: str) -> Any:
    data = parse_yaml(text, "this")
    return data if isinstance(data, dict) else {}


@pytest.mark.slow
@settings(max_examples=40)
@given(
    st.binary(max_size=200)
    | st.builds(str.encode, mutants(), st.sampled_from(["utf-8", "utf-16", "utf-32-be"]))
)
def test_a_config_file_of_any_bytes_never_harms(place: Path, content: bytes) -> None:
    Path("c.yaml").write_bytes(content)
    with unharmed(place), mock.patch.object(generate, "prepare_store", refuse_all):
        result = run("generate", "--config", "c.yaml", "--out", "new.zarr", "--workers", "1")
    assert result.code in (1, 2)
    check_refusal(result)


def test_nothing_in_a_config_is_executed(place: Path) -> None:
    tags = ("apply:os.system", "new:os.system", "name:os.system", "module:antigravity")
    for tag in tags:
        Path("c.yaml").write_text(f"seed: !!python/object/{tag} [touch harm]\n")
        with unharmed(place):
            check_refusal(run("generate", "--config", "c.yaml", "--out", "new.zarr"))
            check_refusal(run("generate", "--out", "new.zarr", "--set", Path("c.yaml").read_text()))


# --- the command line ---------------------------------------------------------------------------

WORDS = st.sampled_from(
    ["", " ", "-", "--", "-1", "0", "1e9", "9" * 400, "nan", "inf", "-inf", "0x10", "1_0", "\u0663",
     "true", "None", "1/0", "0/0", "5/4", "1/1/1", "640x480x3", "0x0", "x", "99999x99999",
     "a:b", "uniform:", ":1", "uniform:nan", "uniform:-1", "uniform:1e999", "..", "/", "/dev/null",
     "/dev/full", "/proc/self/mem", "ds.zarr/zarr.json", "~", "*", "$(touch harm)", "`touch harm`",
     "a\nb", "\x1b[2J", "\udcff", "\u202e", "k" * 5000, "seed=", "=1", "seed==1", "a.b.c=1",
     "seed=!!python/name:os.system", "cameras.front.eye=[1]", "motion={}", "policies=[]",
     "randomize.looks=3", "resolution=[0, 0]", "out=3", "n=1e3", "block_size=0", "quality=1"]
)  # fmt: skip
TEXTS = WORDS | st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=12)
OPTIONS = (
    "--n", "--workers", "--shard", "--episode-timeout", "--max-failures", "--seed", "--robot",
    "--policy", "--model", "--objects", "--split", "--clutter", "--camera", "--resolution",
    "--renderer", "--randomize", "--physics", "--record-hz", "--video-hz", "--set", "--config",
    "--live-port", "--plugin", "--executor", "--sensor",
)  # fmt: skip


def test_every_option_of_generate_is_tried_here() -> None:
    valued = {option.opts[0] for option in generate_command.params if not option.is_flag}
    assert valued == {*OPTIONS, "--out"}


@pytest.mark.slow
@settings(max_examples=80)
@given(
    st.lists(st.tuples(st.sampled_from(OPTIONS), TEXTS), min_size=1, max_size=3),
    st.sampled_from([[], ["--live"]]),
)
def test_any_values_of_options_are_taken_or_refused_in_one_line(
    place: Path, pairs: list[tuple[str, str]], flags: list[str]
) -> None:
    words = [*flags, *(word for pair in pairs for word in pair)]
    with unharmed(place), mock.patch.object(generate, "prepare_store", refuse_all):
        check_refusal(run("generate", "--out", "new.zarr", *words))


@pytest.mark.slow
@settings(max_examples=60)
@given(TEXTS.filter(lambda text: not text.startswith("-")))
def test_a_store_is_made_nowhere_but_where_one_can_be(place: Path, text: str) -> None:
    with unharmed(place), mock.patch.object(generate, "prepare_store", refuse_all):
        check_refusal(run("generate", *TINY, "--out", text))


OTHERS = st.one_of(
    st.tuples(st.just("preview"), TEXTS),
    st.tuples(st.just("preview"), st.just("p.png"), st.just("--n"), TEXTS.filter("1".__ne__)),
    st.tuples(st.just("sheet"), st.just("ds.zarr"), TEXTS),
    st.tuples(
        st.just("sheet"), st.just("ds.zarr"), st.just("p.png"),
        st.sampled_from(["--episodes", "--camera"]), TEXTS,
    ),
    st.tuples(st.sampled_from(["replay", "sheet"]), TEXTS, TEXTS),
    st.tuples(st.just("relabel"), st.just("ds.zarr"), st.just("--name"), TEXTS),
    st.tuples(
        st.just("relabel"), st.just("ds.zarr"), st.just("--name"), st.just("a"),
        st.sampled_from(["--min-lift", "--min-shake", "--min-grip-force", "--max-slip-angle"]),
        WORDS.filter(lambda text: text not in ("0", "1_0")),
    ),
    st.tuples(st.just("objects"), TEXTS.filter(lambda text: text not in ("", "/", "~", ".."))),
    st.tuples(st.just("objects"), st.just("ds.zarr"), st.just("--robot"), TEXTS),
)  # fmt: skip


@pytest.mark.slow
@settings(max_examples=80)
@given(OTHERS)
def test_any_words_after_another_command_are_taken_or_refused(
    place: Path, words: tuple[str, ...]
) -> None:
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(preview, "draw_preview", refuse_all))
        stack.enter_context(mock.patch.object(relabel, "write_label", refuse_all))
        before = tree(place)
        result = run(*words)
        Path("p.png").unlink(missing_ok=True)
        after = tree(place)
    assert {name: after.get(name) for name in before} == before
    assert result.code in (0, 1, 2)
    if result.code and not result.out:
        check_refusal(result)


# --- beside and inside a store ------------------------------------------------------------------


@settings(max_examples=40)
@given(st.binary(max_size=400))
def test_a_lock_file_of_any_content_is_a_lock_or_is_left_alone(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        lock = Path(folder) / ".a.zarr.grasp-factory.lock"
        lock.write_bytes(content)
        try:
            with warnings.catch_warnings(), StoreLock(Path(folder) / "a.zarr"):
                pass
        except StoreMismatchError as error:
            assert "is in the way" in str(error)
            assert lock.read_bytes() == content
        else:
            assert not lock.exists()


@settings(max_examples=20)
@given(st.binary(max_size=200))
def test_a_diary_of_any_content_is_kept_and_gets_a_line_of_its_own(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        diary = Path(folder) / "a.zarr.runs.jsonl"
        diary.write_bytes(content)
        with RunLog(Path(folder) / "a.zarr", Request(config=CONFIG)) as log:
            log.begin()
        after = diary.read_bytes()
        assert after.startswith(content)
        assert json.loads(after.splitlines()[-1])["ended"] == "done"


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner),
    max_leaves=4,
)


@st.composite
def damages(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Functions that damage a JSON document, in its bytes or in its meaning."""
    how, at, junk = draw(st.integers(0, 3)), draw(st.integers(0, 10**6)), draw(JUNK)

    def damage(data: bytes) -> bytes:
        place = at % len(data)
        if how == 0:
            return data[:place]
        if how == 1:
            return data[:place] + bytes([data[place] ^ 1 + at % 255]) + data[place + 1 :]
        document = json.loads(data)
        spots = list(inner_of(document))
        holder, key = spots[at % len(spots)]
        if how == 2:
            del holder[key]
        else:
            holder[key] = junk
        return json.dumps(document).encode()

    return damage


def inner_of(value: Any) -> Iterator[tuple[Any, Any]]:
    keys = list(value) if isinstance(value, dict) else range(len(value))
    for key in keys:
        yield value, key
        if isinstance(value[key], dict | list):
            yield from inner_of(value[key])


NEARBY = ("zarr.json", "episodes/zarr.json", "episodes/status/zarr.json", "episodes/spec/zarr.json",
          "cameras/front/rgb/zarr.json", "streams/phase/zarr.json")  # fmt: skip


@pytest.mark.slow
@settings(max_examples=scaled(20, 60))
@given(st.sampled_from(NEARBY), damages(), st.sampled_from([2, 3]))
def test_generate_on_a_store_of_damaged_metadata_goes_on_or_refuses_it_as_it_is(
    place: Path, name: str, damage: Callable[[bytes], bytes], n: int
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "ds.zarr"
        shutil.copytree("ds.zarr", out)
        (out / name).write_bytes(damage((out / name).read_bytes()))
        before = tree(out)
        with mock.patch.object(ProcessExecutor, "run", refuse_all):
            result = run("generate", *TINY, "--n", str(n), "--out", str(out), "--quiet")
        if result.code == 0:
            assert n == 2
            return
        check_refusal(result)
        after = tree(out)
        if FAR_ENOUGH in result.err:  # it has grown, which is all that it may have done
            assert n == 3
            names = [key for key in before if after.get(key) != before[key]]
            assert all(key.endswith("zarr.json") for key in names)
        else:
            assert after == before
