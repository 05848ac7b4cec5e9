"""The tutorial notebook, executed.

``python -m support.tutorial`` writes its outputs again.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from support.places import DOCS

NOTEBOOK = DOCS / "tutorial.ipynb"
SECONDS = 600
"""Longest time of a cell."""


def executed(folder: Path) -> Any:
    """Execute all cells in a folder; return the notebook with what they gave.

    Progress, which tells how fast this machine is, is left out.

    Raises:
        nbclient.exceptions.CellExecutionError: if a cell raises an error.
    """
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    places = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=SECONDS, resources=places, record_timing=False).execute()
    for cell in notebook.cells:
        if "outputs" in cell:
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
    return notebook


def shown(notebook: Any) -> list[str]:
    """Return the texts that the cells of a notebook show, without figures."""
    texts = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            text = output.get("text") or output.get("data", {}).get("text/plain", "")
            texts.append(re.sub(r"\s+", " ", text))
    return texts


if __name__ == "__main__":
    nbformat.write(executed(DOCS), NOTEBOOK)
