"""Figures, pages and text of a record; the only place that uses matplotlib, and only once a figure is drawn."""

from typing import TYPE_CHECKING

from ibrid.report.text import format_record

if TYPE_CHECKING:
    from ibrid.report.page import write_report

__all__ = ["format_record", "write_report"]


def __getattr__(name: str):
    if name == "write_report":
        from ibrid.report.page import write_report  # pages are not needed where only text is printed

        return write_report
    raise AttributeError(f"ibrid.report has no {name}")
