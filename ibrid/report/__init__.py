"""Figures, pages and text of a record; the only place that uses matplotlib, and only once a figure
is drawn.
"""

from typing import TYPE_CHECKING

from ibrid.lazy import imported_by_need

if (
    TYPE_CHECKING
):  # the same names for type checkers; pages are not needed where only text is printed
    from ibrid.report.pages.page import write_report
    from ibrid.report.texts.text import format_record

__all__ = ["format_record", "write_report"]

#: Public name -> the module that it is imported from when it is first used.
HOMES = {
    "format_record": "ibrid.report.texts.text",
    "write_report": "ibrid.report.pages.page",
}

if not TYPE_CHECKING:
    __getattr__ = imported_by_need(__name__, HOMES)
