"""Notebooks as pages of the site: their text, their code, and what was printed and drawn where they have been run.

    python docs/making/notebook_pages.py

runs those whose outcome does not lie in out/notebooks yet, some minutes each. Pages link to the notebooks themselves, which is
what a reader on a forge needs; while the site is built these links lead to its pages.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat

ROOT = Path(__file__).resolve().parents[2]
SOURCES, PAGES, RUN = ROOT / "notebooks", ROOT / "docs" / "notebooks", ROOT / "out" / "notebooks"
_LINK = re.compile(r"\]\((?:\.\./)?notebooks/(\w+)\.ipynb\)")
_COLOURS = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


def setup(app: Any) -> dict[str, bool]:
    """What Sphinx calls."""
    app.connect("builder-inited", lambda app: write_pages())
    app.connect(
        "source-read", lambda app, page, source: source.__setitem__(0, _LINK.sub(r"](notebooks/\1.md)", source[0]))
    )
    return {"parallel_read_safe": True}


def write_pages() -> None:
    """A page for each notebook into docs/notebooks; pages that stay the same keep their time."""
    PAGES.mkdir(exist_ok=True)
    for path in sorted(SOURCES.glob("*.ipynb")):
        text = notebook_page(nbformat.read(outcome(path) or path, as_version=4), path.stem)
        target = PAGES / f"{path.stem}.md"
        if not target.is_file() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")


def outcome(path: Path) -> Path | None:
    """Where the notebook lies with its outputs; None if it changed since it was run."""
    found = RUN / path.name
    if not found.is_file():
        return None
    ran, now = (nbformat.read(one, as_version=4) for one in (found, path))
    return found if [cell.source for cell in ran.cells] == [cell.source for cell in now.cells] else None


def notebook_page(notebook: nbformat.NotebookNode, name: str) -> str:
    """Markdown of a notebook; its pictures lie in the page."""
    first, *others = notebook.cells
    title, _, rest = first.source.partition("\n")
    where = f"*`notebooks/{name}.ipynb`: [download](../../notebooks/{name}.ipynb).*"
    parts = [title, where, rest.strip()]
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
        if output.output_type == "stream" and output.name == "stdout":
            yield f"````text\n{_COLOURS.sub('', output.text).rstrip()}\n````"
        elif "image/png" in shown:
            yield _html(
                f'<img alt="Output of the cell above" src="data:image/png;base64,{shown["image/png"].strip()}">'
            )
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
    NotebookClient(
        notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": path.parent}}
    ).execute()
    RUN.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, RUN / path.name)


if __name__ == "__main__":
    for path in sorted(SOURCES.glob("*.ipynb")):
        if outcome(path) is None:
            print(path.stem, flush=True)
            run(path)
