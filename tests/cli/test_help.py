"""The help of every command: headings, plain sentences, and examples that work."""

from __future__ import annotations

import io
import re
import shlex
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path

import click
import pytest

import grasp_factory
from grasp_factory.cli.main import COMMANDS, cli
from grasp_factory.cli.params import Command, Option

TOP = {command.name: command for group in COMMANDS.values() for command in group}


def leaves(
    commands: Iterable[click.Command], above: str = ""
) -> Iterator[tuple[str, click.Command]]:
    """Yield all commands that do something, by all words of their names."""
    for command in commands:
        name = f"{above}{command.name}"
        if isinstance(command, click.Group):
            yield from leaves(command.commands.values(), f"{name} ")
        else:
            yield name, command


ALL = dict(leaves(TOP.values()))
NAMES = {command: name for name, command in ALL.items()}
PACKAGE = Path(grasp_factory.__file__).parent

LONGEST_SUMMARY, WIDEST = 60, 100
"""Characters of a first line, and columns of a help text."""
WITHOUT_HEADINGS = 12
"""Options that a command may have without a heading for each."""
UNCLEAR = (
    "anew", "is none", "hang on", "put down", "of chance", "as they were told", "is to be had",
    "in few words",
)  # fmt: skip
"""Phrases that readers stumble over; CONTRIBUTING.md asks for plain English."""
UNCLEAR_PATTERN = re.compile(rf"(?<!there )\b({'|'.join(map(re.escape, UNCLEAR))})\b")


@pytest.fixture(params=sorted(ALL))
def command(request: pytest.FixtureRequest) -> Command:
    found = ALL[request.param]
    assert isinstance(found, Command)
    return found


def help_of(command: click.Command, width: int) -> str:
    parent = click.Context(cli, info_name="grasp-factory", terminal_width=width)
    if command is cli:
        return cli.get_help(parent)
    return command.get_help(click.Context(command, info_name=NAMES[command], parent=parent))


def options_of(command: click.Command) -> list[click.Option]:
    return [parameter for parameter in command.params if isinstance(parameter, click.Option)]


def test_every_command_is_in_the_table() -> None:
    assert set(cli.commands) == set(TOP)


def test_the_first_line_says_in_a_short_sentence_what_the_command_does(command: Command) -> None:
    assert command.help
    first = command.help.splitlines()[0]
    assert len(first) <= LONGEST_SUMMARY
    assert re.fullmatch(r"[A-Z][^.]*\.", first)


def test_the_list_of_commands_shows_whole_sentences_in_a_terminal_of_80_columns() -> None:
    lines = help_of(cli, 80).splitlines()
    for command in TOP.values():
        assert command.help
        assert any(line.endswith(f"  {command.help.splitlines()[0]}") for line in lines)


def test_every_option_has_a_help_text(command: Command) -> None:
    assert [option.opts for option in options_of(command) if not option.help] == []


def test_a_help_text_is_a_sentence(command: Command) -> None:
    for option in options_of(command):
        assert option.help
        sentence, _, default = option.help.partition("  [default: ")
        assert sentence[0].isupper() or sentence.startswith("COLUMN"), option.opts
        assert sentence.endswith("."), option.opts
        assert not default or default.endswith("]"), option.opts


def test_a_command_with_many_options_has_a_heading_for_each(command: Command) -> None:
    options = options_of(command)
    bare = [o.opts for o in options if not isinstance(o, Option) or o.heading == "Options"]
    assert len(options) <= WITHOUT_HEADINGS or bare == []


def test_options_stand_under_their_headings() -> None:
    @click.command(cls=Command, examples=("one   two", "three"))
    @click.argument("what")
    @click.option("--a", cls=Option, heading="First", help="Of a.")
    @click.option("--b", help="Of b.")
    @click.option("--c", cls=Option, heading="First", help="Of c.")
    def example(**_: str) -> None:
        """Do something."""

    assert example.get_help(click.Context(example)).splitlines() == [
        "Usage:  [OPTIONS] WHAT", "", "  Do something.", "",
        "First:", "  --a TEXT  Of a.", "  --c TEXT  Of c.", "",
        "Options:", "  --b TEXT  Of b.", "  --help    Show this message and exit.", "",
        "Examples:", "  one   two", "  three",
    ]  # fmt: skip


def test_no_line_of_a_help_is_wider_than_100_columns(command: Command) -> None:
    lines = help_of(command, WIDEST).splitlines()
    assert [line for line in lines if len(line) > WIDEST] == []


def test_a_help_fits_a_terminal_of_80_columns(command: Command) -> None:
    assert [line for line in help_of(command, 80).splitlines() if len(line) > 80] == []


def test_a_help_ends_with_two_examples_or_more(command: Command) -> None:
    assert len(command.examples) >= 2
    lines = help_of(command, WIDEST).splitlines()
    assert lines[-len(command.examples) - 1] == "Examples:"
    assert lines[-len(command.examples) :] == [f"  {line}" for line in command.examples]
    assert any(f"grasp-factory {NAMES[command]}" in line for line in command.examples)


def test_every_example_is_a_valid_command_line(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my_meshes").mkdir()
    for line in command.examples:
        for words, target in commands_of(line):
            assert words[0] == "grasp-factory"
            name = next(name for name in (words[1], " ".join(words[1:3])) if name in ALL)
            with ALL[name].make_context(name, words[1 + len(name.split()) :]):
                pass
            if target is not None:
                target.touch()  # such as a list that the next example reads


def commands_of(line: str) -> Iterator[tuple[list[str], Path | None]]:
    """Yield the commands of a pipe, each with the file that takes its output."""
    parser = shlex.shlex(line, posix=True, punctuation_chars="|>")
    parser.whitespace_split = True
    words: list[str] = []
    target: Path | None = None
    for word in parser:
        if word == "|":
            yield words, None
            words = []
        elif word == ">":
            target = Path(next(parser))
        else:
            words.append(word)
    yield words, target


def test_an_example_may_be_a_pipe_or_write_a_file() -> None:
    assert list(commands_of("a 'b > c' | d --e=f > g")) == [
        (["a", "b > c"], None),
        (["d", "--e=f"], Path("g")),
    ]


def test_an_example_with_a_wrong_option_is_noticed() -> None:
    with pytest.raises(click.UsageError, match="No such option"):
        ALL["info"].make_context("info", ["grasps.zarr", "--jsn"])


def test_a_help_is_in_plain_words(command: Command) -> None:
    assert UNCLEAR_PATTERN.findall(" ".join(help_of(command, WIDEST).split())) == []


def unclear_lines(source: str) -> list[int]:
    """Return the numbers of the lines on which an unclear string or comment begins."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    said = {token.start[0]: token.string for token in tokens
            if token.type in (tokenize.STRING, tokenize.COMMENT)}  # fmt: skip
    return [n for n, text in said.items() if UNCLEAR_PATTERN.search(" ".join(text.split()))]


def test_the_package_speaks_plain_english() -> None:
    paths = sorted(PACKAGE.rglob("*.py"))
    found = {
        str(path.relative_to(PACKAGE)): lines
        for path in paths
        if (lines := unclear_lines(path.read_text(encoding="utf-8")))
    }
    assert found == {}


def test_unclear_words_are_found_in_strings_docstrings_and_comments() -> None:
    source = 'def f():\n    """This is\n    none."""\n    g("made anew", hang_on=1)  # put down\n'
    assert unclear_lines(source) == [2, 4]
