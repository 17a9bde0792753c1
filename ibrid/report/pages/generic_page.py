"""The page of a generic model: parameters beside those of the file it began with, errors by record,
and the curves.
"""

from typing import Any

from ibrid.generic.answer import GenericAnswer
from ibrid.report.pages.playback_page import DRAWN, record_svg, validation_facts
from ibrid.report.pages.template import page
from ibrid.report.texts.generic_text import (
    ERROR_HEAD,
    PARAMETER_HEAD,
    error_cells,
    parameter_cells,
    remarks,
)


def generic_page(answer: GenericAnswer) -> str:
    """The page as text."""
    figures = [
        (
            played.record.name,
            record_svg(f"record-{k}", played, {"model": played.current}, answer.fit.values),
        )
        for k, played in enumerate((*answer.played, *answer.held_out)[:DRAWN])
    ]
    return page("generic.html", generic_facts(answer) | {"figures": figures})


def generic_facts(answer: GenericAnswer) -> dict[str, Any]:
    """What the page and a notebook say."""
    facts = {
        "answer": answer,
        "parameter_head": PARAMETER_HEAD,
        "parameters": parameter_cells(answer),
        "error_head": ERROR_HEAD,
        "errors": error_cells(answer),
        "remarks": [*remarks(answer)],
    }
    return facts | validation_facts(answer.validation)
