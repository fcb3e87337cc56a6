"""Pages of the site from notebooks: executed, their outputs in the page; in git they have none."""

import base64
import shutil
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbconvert import MarkdownExporter
from traitlets.config import Config

_LONGEST = 600  # [s] of a cell


def page_of(notebook: Path, root: Path, *, execute: bool) -> str:
    """Markdown of a notebook, with its outputs if it is executed; pictures are in the page.

    Args:
        notebook: File.
        root: Of the checkout, whose docs/examples the notebooks find beside their folder.
        execute: Run it, in an empty folder.
    """
    book = nbformat.read(notebook, as_version=4)
    if execute:
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(root / "docs" / "examples", Path(folder, "examples"))
            place = Path(folder, "notebooks")
            place.mkdir()
            resources = {"metadata": {"path": str(place)}}
            NotebookClient(book, timeout=_LONGEST, resources=resources).execute()

    options = Config()
    options.NbConvertBase.display_data_priority = ["text/html", "image/png", "text/plain"]
    body, resources = MarkdownExporter(config=options).from_notebook_node(book)
    for name, data in resources["outputs"].items():
        body = body.replace(f"({name})", f"({_data_uri(data)})")
    body = body.replace(".ipynb)", ".md)")  # links to other notebooks
    return f"{body}\n[The notebook]({notebook.name}), without outputs.\n"


def _data_uri(data: bytes) -> str:
    """Picture within the page."""
    return f"data:image/png;base64,{base64.b64encode(data).decode()}"
