"""Executes the notebooks and renders them into the book: ``python render_notebooks.py [--check] [NAME …]``.

A notebook is a ``.py`` file in cells, which jupytext reads. With ``--check`` they are executed, and no page is
written. A notebook that wants a package which is not installed is skipped, and says so.
"""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

HERE = Path(__file__).resolve().parents[1] / "notebooks"
PAGES = HERE.parents[1] / "docs" / "src" / "python"
NAMES = {
    "demo": [],
    "own_data": [],
    "missing_physics": [],
    "sensitivity_posterior": ["emcee", "scipy"],
    "beside_opensim": ["opensim"],
}


def rendered(name: str, notebook) -> None:
    """Writes a page and its figures."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            # The book's pages are text: tables as text, figures as files. Warnings of other packages are no part of
            # the story.
            data = output.get("data", {})
            data.pop("text/html", None)
        cell["outputs"] = [o for o in cell.get("outputs", []) if o.get("name") != "stderr"] if "outputs" in cell else []
        if cell.cell_type != "code":
            cell.pop("outputs", None)
    text, resources = MarkdownExporter().from_notebook_node(notebook)
    for old in (PAGES / "images").glob(f"{name}_output_*"):
        old.unlink()
    for file, data in resources["outputs"].items():
        (PAGES / "images").mkdir(parents=True, exist_ok=True)
        (PAGES / "images" / f"{name}_{file}").write_bytes(data)
        text = text.replace(f"]({file})", f"](images/{name}_{file})")
    text = text.replace("![png]", "![Figure]")
    text = re.sub(r"[ \t]+\n", "\n", re.sub(r"\n{3,}", "\n\n", text)).strip() + "\n"
    head, _, rest = text.partition("\n")
    source = f"This page is the notebook `python/notebooks/{name}.py`, executed."
    (PAGES / f"{name}.md").write_text(f"{head}\n\n{source}\n{rest}")


def main() -> int:
    check = "--check" in sys.argv
    chosen = [a for a in sys.argv[1:] if not a.startswith("--")] or list(NAMES)
    # Tables are as wide as the book's pages.
    wide = nbformat.v4.new_code_cell("__import__('pandas').set_option('display.width', 120)")
    for name in chosen:
        missing = [p for p in NAMES[name] if importlib.util.find_spec(p) is None]
        if missing:
            print(f"SKIPPED notebook {name}: {', '.join(missing)} is not installed")
            continue
        notebook = jupytext.read(HERE / f"{name}.py")
        notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
        notebook.cells.insert(0, wide)
        NotebookClient(
            notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(HERE)}}
        ).execute()
        notebook.cells.pop(0)
        if not check:
            rendered(name, notebook)
        print(f"ok {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
