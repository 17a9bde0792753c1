"""Writes what is made from the code: three pages and the picture of the floors. Run it after changing a declaration."""

from pathlib import Path

from api_page import api_page
from command_line_page import command_line_page
from floors import architecture_svg
from modules_page import modules_page

from ibrid.cli import parser
from ibrid.modules.vocabulary import VOCABULARY

FOLDER = Path(__file__).resolve().parents[1]


def made_pages() -> dict[str, str]:
    """File name -> text."""
    return {
        "modules.md": modules_page(VOCABULARY),
        "command_line.md": command_line_page(parser()),
        "api.md": api_page(),
        "images/architecture.svg": architecture_svg(),
    }


if __name__ == "__main__":
    for name, text in made_pages().items():
        (FOLDER / name).write_text(text.rstrip() + "\n", encoding="utf-8")
