"""What the documentation says of files, names, commands and rooms is true."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import click
import pytest
from architecture.generated import PAGES as GENERATED
from architecture.generated import PART, PARTS, filled, purpose
from architecture.test_rooms import PACKAGE, ROOMS, modules, type_names
from support.places import DOCS, REPOSITORY

from grasp_factory.cli.main import cli
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.policies import POLICIES

PAGES = (
    REPOSITORY / "README.md",
    REPOSITORY / "CONTRIBUTING.md",
    *sorted(DOCS.rglob("*.md")),
)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:)([^)\s]*)\)")
CODE = re.compile(r"`([^`\n]+)`")
DOTTED = re.compile(r"\bgrasp_factory(?!\.json\b)(?:\.[A-Za-z_]\w*)+")
PATH = re.compile(r"(?<![\w./-])(?:tests|grasp_factory|bin|docs|data_samples)/[\w./<>-]*")
MODULE_RUN = re.compile(r"PYTHONPATH=tests python -m ([\w.]+)")
WIDEST = 120
"""Characters in a line of prose; rows of tables and lines with addresses may be longer."""

RELATIVE = (REPOSITORY / "CONTRIBUTING.md", DOCS / "architecture.md", DOCS / "files.md")
"""Pages that also name files of the package by their place in it."""

every_page = pytest.mark.parametrize(
    "page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY))
)


@cache
def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose(page: Path) -> str:
    """Return a page without its blocks of code."""
    return FENCE.sub("", text_of(page))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """Yield the file and the anchor of every relative link."""
    for target in LINK.findall(prose(page)):
        file, _, anchor = target.partition("#")
        yield (page.parent / file).resolve() if file else page, anchor


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the words of every grasp-factory command in a page's bash blocks and code spans."""
    lines = [code for kind, code in FENCE.findall(text_of(page)) if kind == "bash"]
    lines += [code for code in CODE.findall(prose(page)) if code.startswith("grasp-factory ")]
    for line in "\n".join(lines).replace("\\\n", "").splitlines():
        words = shlex.split(line, comments=True)
        while "grasp-factory" in words:
            words = words[words.index("grasp-factory") + 1 :]
            ends = [place for place, word in enumerate(words) if word in {"|", ">", "&&", ";"}]
            if found := words[: ends[0]] if ends else words:
                yield found


@every_page
def test_a_relative_link_leads_to_a_file_and_its_heading(page: Path) -> None:
    for file, anchor in links(page):
        assert file.exists(), f"{page.name} links to {file}"
        assert not anchor or anchor in anchors(file), f"{page.name} links to {file.name}#{anchor}"


def test_the_index_names_every_page() -> None:
    named = {file for file, _ in links(DOCS / "index.md")} | {DOCS / "index.md"}
    assert set(DOCS.rglob("*.md")) - named == set()


def test_every_file_of_the_documentation_can_be_reached_from_its_index() -> None:
    seen, todo = set[Path](), [DOCS / "index.md"]
    while todo:
        page = todo.pop()
        seen.add(page)
        if page.suffix == ".md":
            todo += [file for file, _ in links(page) if file not in seen and file.is_file()]
    assert {file for file in DOCS.rglob("*") if file.is_file()} - seen == set()


@every_page
def test_a_path_that_is_named_exists(page: Path) -> None:
    named = [code for code in CODE.findall(prose(page)) if re.fullmatch(r"[\w./]+\.py", code)]
    if page not in RELATIVE:
        assert [code for code in named if not PATH.match(code)] == [], "begin at the top folder"
    for path in PATH.findall(text_of(page)):
        known = path.partition("<")[0].rstrip(".")
        assert (REPOSITORY / known).exists(), path
    for name in MODULE_RUN.findall(text_of(page)):
        file = REPOSITORY / "tests" / name.replace(".", "/")
        assert file.with_suffix(".py").is_file(), name


TEST = re.compile(r"(tests/[\w/]+\.py)::(\w+)")


@every_page
def test_a_test_that_is_named_exists(page: Path) -> None:
    for file, name in TEST.findall(text_of(page)):
        assert f"def {name}(" in text_of(REPOSITORY / file), f"{page.name} names {file}::{name}"


def test_a_page_that_the_code_or_the_changelog_names_exists() -> None:
    for file in (*modules(), REPOSITORY / "CHANGELOG.md"):
        for path in re.findall(r"[\w/-]+\.md\b", text_of(file)):
            assert (REPOSITORY / path).is_file(), f"{file.name} names {path}"


ROWS = re.findall(r"^\| (?!---).+", text_of(REPOSITORY / "CONTRIBUTING.md"), re.MULTILINE)
IN_PACKAGE = re.compile(r"(?!grasp_factory/|data_samples/).+\.(?:py|js)")


@pytest.mark.parametrize("row", [row for row in ROWS if IN_PACKAGE.search(row)])
def test_a_row_of_contributing_names_files_of_the_package(row: str) -> None:
    paths = [code for code in CODE.findall(row) if IN_PACKAGE.fullmatch(code)]
    assert paths
    for path in paths:
        base = REPOSITORY if path.startswith("tests/") else PACKAGE
        choices = re.search(r"\{(.+)\}", path)
        for choice in choices[1].split(",") if choices else [""]:
            known = base / re.sub(r"\{.+\}", choice, path).partition("<")[0]
            assert known.is_file() or ("<" in path and known.is_dir()), path


def test_both_tables_of_contributing_are_found() -> None:
    assert sum(bool(IN_PACKAGE.search(row)) for row in ROWS) >= 28


@every_page
def test_a_dotted_name_can_be_imported(page: Path) -> None:
    for name in DOTTED.findall(text_of(page)):
        assert resolved(name) is not None, name


def resolved(name: str) -> object:
    """Return the module, or what a module holds, under a dotted name."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if not f"{name}.".startswith(f"{error.name}."):
            raise
        home, _, last = name.rpartition(".")
        return getattr(resolved(home), last)


def test_the_records_on_the_way_of_the_data_are_types_of_the_package() -> None:
    _, _, way = text_of(DOCS / "architecture.md").partition("## The way of the data")
    records = set(re.findall(r"`([A-Z][a-zA-Z]+)`", way.partition("\n## ")[0]))
    defined = {name for file in modules() for name in type_names(ast.parse(text_of(file)))}
    assert len(records) > 5
    assert records <= defined


@every_page
def test_a_command_exists_and_has_its_options(page: Path) -> None:
    for name, *words in commands(page):
        if name.startswith("-") or name.isupper():  # --version, COMMAND
            continue
        command, rest = cli.commands[name], list(words)
        while isinstance(command, click.Group) and rest:
            command = command.commands[rest.pop(0)]
        try:
            command.make_parser(click.Context(command)).parse_args(rest)
        except click.NoSuchOption as error:
            pytest.fail(f"grasp-factory {name} {' '.join(words)}: {error.message}")
        except click.BadOptionUsage:
            pass  # an option that is named in a sentence, without its value


def all_commands(group: click.Group) -> Iterator[click.Command]:
    """Yield the commands of a group, and of the groups in it."""
    for command in group.commands.values():
        yield command
        if isinstance(command, click.Group):
            yield from all_commands(command)


@every_page
def test_an_option_that_is_named_in_a_sentence_exists(page: Path) -> None:
    params = [param for command in all_commands(cli) for param in command.params]
    known = {name for param in params for name in (*param.opts, *param.secondary_opts)}
    named = {code.split()[0].partition("=")[0] for code in CODE.findall(prose(page))}
    found = {name for name in named if re.fullmatch(r"--[a-z][a-z-]*", name)}
    assert found - known - {"--help", "--no-build-isolation", "--fast"} == set()


@every_page
def test_a_setting_that_is_named_exists(page: Path) -> None:
    for assignment in re.findall(r"--set '?([\w.]+)=", text_of(page)):
        first, *further = assignment.split(".")
        if first == "policy_parameters":
            policy, parameter = further
            assert parameter in POLICIES[policy].parameters.__dataclass_fields__
            continue
        value = FactoryConfig().to_plain()[first]
        for part in further:
            value = value[part]


@every_page
def test_a_block_of_code_says_its_language(page: Path) -> None:
    kinds = {kind for kind, _ in FENCE.findall(text_of(page))}
    assert kinds <= {"bash", "python", "yaml", "text", "mermaid"}


@every_page
def test_lines_are_short(page: Path) -> None:
    lines = [line for line in prose(page).splitlines() if "|" not in line and "http" not in line]
    assert [line for line in lines if len(line) > WIDEST] == []


@pytest.mark.parametrize("page", GENERATED, ids=lambda page: page.stem)
def test_what_is_generated_is_what_the_code_says(page: Path) -> None:
    text = text_of(page)
    assert text == filled(text), "run: PYTHONPATH=tests python -m architecture.generated"


def test_every_generated_part_is_on_a_page() -> None:
    found = [name for page in GENERATED for _, name, _ in PART.findall(text_of(page))]
    assert sorted(found) == sorted(PARTS)


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_says_its_purpose_in_one_sentence(name: str) -> None:
    assert re.fullmatch(r"[A-Z][^.]{20,90}\.", purpose(name))
