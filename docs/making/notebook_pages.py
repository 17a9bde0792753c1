"""Notebooks as pages of the site: their text, their code, and what they printed and drew when they
were last run.

    python docs/making/notebook_pages.py

runs those that changed since, some minutes each, and keeps the outcome in docs/measured/notebooks.
Pages link to the notebooks themselves, as readers on a forge need it; while the site is built these
links lead to its pages.
"""

import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat

ROOT = Path(__file__).resolve().parents[2]
SOURCES, PAGES, OUTCOMES = (
    ROOT / "notebooks",
    ROOT / "docs" / "notebooks",
    ROOT / "docs" / "measured" / "notebooks",
)
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
    for path in sorted(SOURCES.glob("*.ipynb")):
        text = notebook_page(nbformat.read(outcome(path) or path, as_version=4), path.stem)
        target = PAGES / f"{path.stem}.md"
        if not target.is_file() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")


def outcome(path: Path) -> Path | None:
    """Where a notebook lies with its outputs; None if it changed since it was run."""
    found = OUTCOMES / f"{path.stem}.json"
    if not found.is_file():
        return None
    ran, now = (nbformat.read(one, as_version=4) for one in (found, path))
    return (
        found
        if [cell.source for cell in ran.cells] == [cell.source for cell in now.cells]
        else None
    )


def notebook_page(notebook: nbformat.NotebookNode, name: str) -> str:
    """Markdown of a notebook; its pictures lie in the page."""
    first, *others = notebook.cells
    title, _, rest = first.source.partition("\n")
    changed = "" if any(cell.get("outputs") for cell in others) else ", not run since it changed"
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


def run(path: Path) -> None:
    """Run a notebook in its folder and keep it with its outputs."""
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": path.parent}}
    NotebookClient(notebook, timeout=900, kernel_name="python3", resources=where).execute()
    keep(notebook, path.stem)


def keep(notebook: nbformat.NotebookNode, name: str) -> None:
    """What was shown, without warnings and without the folders where it was run."""
    for cell in notebook.cells:
        cell.metadata.clear()
        if cell.cell_type == "code":
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    OUTCOMES.mkdir(parents=True, exist_ok=True)
    text = _FOLDERS.sub("", json.dumps(notebook, ensure_ascii=False))
    (OUTCOMES / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    for path in sorted(SOURCES.glob("*.ipynb")):
        if outcome(path) is None:
            print(path.stem, flush=True)
            run(path)
