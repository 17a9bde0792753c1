"""Writes what is made from the code: four pages and the picture of the floors. Run it after changing a declaration."""

from collections.abc import Callable
from pathlib import Path

from api_page import api_page
from command_line_page import command_line_page
from floors import architecture_svg
from inverters_page import inverters_page
from modules_page import modules_page

from ibrid.cli import parser
from ibrid.modules.vocabulary import VOCABULARY

FOLDER = Path(__file__).resolve().parents[1]


#: File name -> what makes its text.
PAGES: dict[str, Callable[[], str]] = {
    "modules.md": lambda: modules_page(VOCABULARY),
    "command_line.md": lambda: command_line_page(parser()),
    "api.md": api_page,
    "inverters.md": inverters_page,
    "images/architecture.svg": architecture_svg,
}


if __name__ == "__main__":
    for name, made in PAGES.items():
        (FOLDER / name).write_text(made().rstrip() + "\n", encoding="utf-8")
