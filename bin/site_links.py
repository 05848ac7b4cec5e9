"""For mkdocs: links to files outside of docs/ become their names, because the site lacks them.

Links of notebooks to other pages lead to the pages of the site.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1] / "docs"
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
PAGE = re.compile(r'(href="(?!\w+:)[^"#]+)\.(?:md|ipynb)(?=["#])')


def on_page_content(html: str, *, page: Any, **_: Any) -> str:
    """Return a page's content; of a notebook, with links to pages as the site names them."""
    return PAGE.sub(r"\1.html", html) if page.file.src_uri.endswith(".ipynb") else html


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return a page's text with no link that leads out of the site."""
    folder = (DOCS / page.file.src_uri).parent

    def inside(link: re.Match[str]) -> str:
        target = link[2]
        if "://" in target or (folder / target).resolve().is_relative_to(DOCS):
            return link[0]
        return link[1]

    return LINK.sub(inside, markdown)
