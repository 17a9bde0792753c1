"""Writes what is made from the code: pages and a picture. Run it after changing a declaration."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from api_page import PARTS, api_index, api_page, file_of
from command_line_page import command_line_page
from diagrams_page import diagrams_page
from floors import architecture_svg
from inverters_page import inverters_page
from modules_page import modules_page

from ibrid.cli import parser
from ibrid.modules.vocabulary import VOCABULARY

FOLDER = Path(__file__).resolve().parents[1]


#: File name -> what makes its text.
PAGES: dict[str, Callable[[], str]] = {
    "modules.md": lambda: modules_page(VOCABULARY),
    "diagrams.md": diagrams_page,
    "command_line.md": lambda: command_line_page(parser()),
    "api.md": api_index,
    **{f"api/{file_of(part)}": partial(api_page, part) for part in PARTS},
    "inverters.md": inverters_page,
    "images/architecture.svg": architecture_svg,
}


if __name__ == "__main__":
    for name, made in PAGES.items():
        (FOLDER / name).write_text(made().rstrip() + "\n", encoding="utf-8")
