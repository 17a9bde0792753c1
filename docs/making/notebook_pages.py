"""Notebooks that carry what they print and draw, and their pages in the site.

    python docs/making/notebook_pages.py [NAME ...]

runs those that changed since their last run, or those named, some minutes each, and keeps the
outputs in the notebooks themselves. Pages of docs link to the notebooks, as readers on a forge need
it; while the site is built these links lead to its pages.
"""

import json
import re
import sys
import tempfile
from base64 import b64decode, b64encode
from collections.abc import Iterator
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "notebooks"
PAGES = ROOT / "docs" / "notebooks"
#: Key of a notebook's metadata: what `digest` of its cells was when it was run.
RAN = "ibrid_ran"
_LINK = re.compile(r"\]\((?:\.\./)?notebooks/(\w+)\.ipynb\)")
_FOLDERS = re.compile(rf"{re.escape(str(ROOT))}/|{re.escape(tempfile.gettempdir())}/tmp\w+/")
_COLOURS = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


def setup(app: Any) -> dict[str, bool]:
    """What Sphinx calls."""
    app.connect("builder-inited", lambda app: write_pages())
    app.connect("source-read", _link)
    return {"parallel_read_safe": True}


def _link(app: Any, page: str, source: list[str]) -> None:
    source[0] = _LINK.sub(r"](notebooks/\1.md)", source[0])


def write_pages() -> None:
    """A page for each notebook into docs/notebooks; pages that stay the same keep their time."""
    PAGES.mkdir(exist_ok=True)
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        text = notebook_page(nbformat.read(path, as_version=4), path.stem)
        target = PAGES / f"{path.stem}.md"
        if not target.is_file() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")


def notebook_page(notebook: nbformat.NotebookNode, name: str) -> str:
    """Markdown of a notebook; its pictures lie in the page."""
    first, *others = notebook.cells
    title, _, rest = first.source.partition("\n")
    changed = "" if is_current(notebook) else ", not run since it changed"
    parts = [
        title,
        f"*This page is [notebooks/{name}.ipynb](../../notebooks/{name}.ipynb){changed}.*",
        rest.strip(),
    ]
    for cell in others:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
        elif cell.cell_type == "code":
            parts += [f"```python\n{cell.source}\n```", *_outputs(cell.outputs)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _outputs(outputs: list[Any]) -> Iterator[str]:
    """What a cell printed and showed, in its order."""
    for output in outputs:
        shown = output.get("data", {})
        if output.output_type == "stream":
            yield f"````text\n{_COLOURS.sub('', output.text).rstrip()}\n````"
        elif "image/png" in shown:
            yield _html(
                '<img alt="Drawn by the cell above" '
                f'src="data:image/png;base64,{shown["image/png"].strip()}">'
            )
        elif "text/markdown" in shown:
            yield shown["text/markdown"]
        elif "text/html" in shown:
            yield _html(shown["text/html"])
        elif "text/plain" in shown:
            yield f"````text\n{shown['text/plain']}\n````"


def _html(text: str) -> str:
    return f'````{{raw}} html\n<div class="output">{text}</div>\n````'


def digest(notebook: nbformat.NotebookNode) -> str:
    """SHA-256 of the code of a notebook, by which a later change is noticed."""
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return sha256("\0".join(code).encode()).hexdigest()[:16]


def is_current(notebook: nbformat.NotebookNode) -> bool:
    """Whether the outputs are those of the code that stands in it."""
    return notebook.metadata.get(RAN) == digest(notebook)


def run(path: Path) -> nbformat.NotebookNode:
    """Run a notebook in its folder."""
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": path.parent}}
    NotebookClient(notebook, timeout=900, kernel_name="python3", resources=where).execute()
    return notebook


def keep(notebook: nbformat.NotebookNode, path: Path) -> None:
    """Write a notebook with what it showed, without warnings and without the folders and the times
    of this run.
    """
    for number, cell in enumerate(notebook.cells):
        cell.metadata.clear()
        cell["id"] = f"cell-{number}"
        if cell.cell_type == "code":
            cell.outputs = [shown for shown in cell.outputs if shown.get("name") != "stderr"]
            for shown in cell.outputs:
                if "image/png" in shown.get("data", {}):
                    shown["data"]["image/png"] = _with_palette(shown["data"]["image/png"])
    notebook.metadata[RAN] = digest(notebook)
    text = json.dumps(notebook, ensure_ascii=False, indent=1)
    path.write_text(_FOLDERS.sub("", text) + "\n", encoding="utf-8")


def _with_palette(png: str) -> str:
    """A figure in base64 with 64 colours: a quarter of the bytes."""
    from PIL import Image

    image = Image.open(BytesIO(b64decode(png))).convert("RGB").quantize(64)
    smaller = BytesIO()
    image.save(smaller, "PNG", optimize=True)
    return b64encode(smaller.getvalue()).decode()


def main(names: list[str]) -> None:
    """Run the notebooks that are named, or those that changed."""
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        wanted = path.stem in names if names else not is_current(nbformat.read(path, as_version=4))
        if wanted:
            print(path.stem, flush=True)
            keep(run(path), path)


if __name__ == "__main__":
    main(sys.argv[1:])
