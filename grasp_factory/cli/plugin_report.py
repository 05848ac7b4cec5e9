"""The text about the code of users that a store was made with."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.plugin_origin import KINDS, listed
from grasp_factory.core.text_format import escaped, escaped_lines, table
from grasp_factory.errors import StoreError
from grasp_factory.factory.plugins import carried_source


def plugins_text(store: Path, config: FactoryConfig) -> str:
    """Return the origins of a store's plugins, and the source of each file; empty without any.

    The source is shown, not run. It may come from a stranger: what is unprintable is escaped.
    """
    found = list(listed(config.plugins))
    if not found:
        return ""
    rows = [
        (f"{KINDS[kind]} {name}", str(origin), f"SHA-256 {origin.sha256}")
        for kind, name, origin in found
    ]
    files = {origin.sha256: origin for _, _, origin in found if origin.file}
    parts = [table([("code of users", "", ""), *rows])]
    for origin in files.values():
        try:
            text = carried_source(store, origin).content.decode("utf-8", "backslashreplace")
        except StoreError as error:
            text = str(error)
        head = f"{origin.file} (run it only if you trust it: --trust)"
        indented = (f"    {line}".rstrip() for line in escaped_lines(text).splitlines())
        parts.append("\n".join([escaped(head), *indented]))
    return "\n\n".join(parts)
