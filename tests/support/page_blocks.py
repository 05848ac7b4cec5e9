"""The blocks of code of a page of the documentation, as one shell script."""

from __future__ import annotations

import re
from pathlib import Path

BLOCK = re.compile(r"^```(bash|python)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NAMED = re.compile(r"# (\w+\.py)\n")
"""The first line of a program that the page says to save."""


def script_of(page: Path) -> str:
    """Return a script that runs all blocks of shell and of Python in their order, as they stand.

    A program whose first line is its file's name is saved under that name. The other blocks of
    Python are one program, as on the page; it runs in the place of the last of them.
    """
    script, program = ["set -eo pipefail\n"], ""
    place = 0
    for kind, code in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "bash":
            script.append(code)
        elif saved := NAMED.match(code):
            script.append(_saving(saved[1], code))
        else:
            program += code
            place = len(script)
    if program:
        script.insert(place, _saving("page.py", program) + "python -W error page.py\n")
    return "".join(script)


def _saving(name: str, code: str) -> str:
    return f"cat > {name} <<'END_OF_FILE'\n{code}END_OF_FILE\n"
