"""The parts of the documentation that follow from the code.

``PYTHONPATH=tests python -m architecture.generated`` writes them into the pages.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from pathlib import Path

from architecture.test_rooms import OWNERS, PACKAGE, ROOMS, SIMULATES, WALLS, arrows, reachable
from support.places import DOCS

from grasp_factory.capture.devices import DEVICES
from grasp_factory.core import palette
from grasp_factory.core.schema import markdown_table
from grasp_factory.core.shown_units import SHOWN_UNITS
from grasp_factory.writers.exporters import EXPORTERS

STATIC = PACKAGE / "apps" / "browse" / "static"
SETTINGS = {
    *(PACKAGE / "core" / "config").glob("*.py"),
    *(PACKAGE / name for name in ("core/gripper.py", "robots/base.py", "factory/run_request.py")),
}
"""Modules whose records hold what a user or a robot's file sets."""
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]+")
SCRIPT_NAME = re.compile(r"^(?:export )?const (\w+)", re.MULTILINE)
PART = re.compile(r"(<!-- generated: ([\w ]+) -->\n).*?(\n<!-- end -->)", re.DOTALL)


def purpose(name: str) -> str:
    """Return the first line of a room's docstring."""
    tree = ast.parse((PACKAGE / name / "__init__.py").read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or "").partition("\n")[0]


def direct_arrows() -> list[tuple[str, str]]:
    """Return the imports between rooms, without those that follow from other imports."""
    found = []
    for start in ROOMS:
        ends = [name for name in ROOMS if name in arrows()[start] - {start}]
        found += [
            (start, end)
            for end in ends
            if not any(end in reachable(other) for other in ends if other != end)
        ]
    return found


def picture() -> str:
    lines = [f"    {start} --> {end}" for start, end in direct_arrows()]
    return "\n".join(["```mermaid", "flowchart TD", *lines, "```"])


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def rooms() -> str:
    return table(("room", "purpose"), [(f"`{name}`", purpose(name)) for name in ROOMS])


def simulating() -> str:
    return _list([name for name in ROOMS if name in SIMULATES])


def walls() -> str:
    rows = [(f"`{name}`", _list(sorted(WALLS[name]))) for name in WALLS]
    return table(("room", "never imports, not even through another room"), rows)


def owners() -> str:
    rows = [(f"`{library}`", _list(sorted(OWNERS[library]))) for library in OWNERS]
    return table(("library", "imported only in"), rows)


def files() -> str:
    """Return a table of all Python and JavaScript files of the package."""
    found = sorted([*PACKAGE.rglob("*.py"), *STATIC.glob("*.js")])
    rows = [(_name(file), *(_script if file.suffix == ".js" else _module)(file)) for file in found]
    return table(("file", "purpose", "settings and constants"), [row for row in rows if row[1]])


def _name(file: Path) -> str:
    return f"`{file.relative_to(PACKAGE).as_posix()}`"


def _module(file: Path) -> tuple[str, str]:
    """Return a module's purpose, and its constants and the fields of its settings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    names = [name for node in tree.body for name in _assigned(node) if CONSTANT.fullmatch(name)]
    if file in SETTINGS:
        classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
        names += [name for node in classes for field in node.body for name in _assigned(field)]
    return (ast.get_docstring(tree) or "").partition("\n")[0], _list(names)


def _assigned(node: ast.stmt) -> list[str]:
    """Return the names that an assignment sets; nothing for another statement."""
    match node:
        case ast.Assign():
            targets = node.targets
        case ast.AnnAssign():
            targets = [node.target]
        case _:
            targets = []
    return [name.id for t in targets for name in ast.walk(t) if isinstance(name, ast.Name)]


def _script(file: Path) -> tuple[str, str]:
    """Return a script's purpose, its first comment, and its constants."""
    text = file.read_text(encoding="utf-8")
    names = [name for name in SCRIPT_NAME.findall(text) if CONSTANT.fullmatch(name)]
    return text.partition("\n")[0].removeprefix("// "), _list(names)


def _list(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def export_formats() -> str:
    """Return a table of the formats of ``grasp-factory export``."""
    rows = []
    for exporter in EXPORTERS.values():
        extra = f"`{exporter.extra}`" if exporter.extra else ""
        lacks = _list(list(exporter.contents.shown_left_out())) or "nothing"
        lacks = lacks.replace("`other ", "other `")
        back = "yes" if exporter.read_back else ""
        rows.append((f"`{exporter.name}`", exporter.description, lacks, extra, back))
    return table(("format", "content", "leaves out", "extra", "import"), rows)


def devices() -> str:
    """Return a table of the devices."""
    rows = [
        (f"`{m.name}`", m.kind.name.lower(), m.description, f"`{m.extra}`" if m.extra else "")
        for m in DEVICES.values()
    ]
    return table(("driver", "kind", "device", "extra"), rows)


def outcome_colors() -> str:
    """Return a table of the colours of outcomes."""
    paints = {**palette.OUTCOMES, "quarantined": palette.QUARANTINED}
    rows = [(word, f"`{paint.light}`", f"`{paint.dark}`") for word, paint in paints.items()]
    return table(("outcome", "on white", "on dark"), rows)


def shown_units() -> str:
    """Return a table of the units that people see."""
    rows = [(f"`{name}`", shown.unit) for name, shown in SHOWN_UNITS.items()]
    return table(("quantity", "unit"), rows)


PARTS: Mapping[str, Callable[[], str]] = {
    "picture of the rooms": picture,
    "rooms": rooms,
    "rooms that simulate": simulating,
    "walls": walls,
    "owners of libraries": owners,
    "arrays of the store": markdown_table,
    "files of the package": files,
    "export formats": export_formats,
    "devices": devices,
    "outcome colours": outcome_colors,
    "shown units": shown_units,
}
PAGES = (
    DOCS / "architecture.md",
    DOCS / "files.md",
    DOCS / "reference" / "format.md",
    DOCS / "guides" / "export.md",
    DOCS / "guides" / "devices.md",
    DOCS / "reference" / "visual.md",
)


def filled(text: str) -> str:
    """Return a page with its generated parts as the code has them now."""
    return PART.sub(lambda m: f"{m[1]}{PARTS[m[2]]()}{m[3]}", text)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
