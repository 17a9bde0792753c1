"""What `ibrid generic` prints: the parameters, what these events do not show, errors by record."""

from collections.abc import Iterator

from ibrid.errors import some
from ibrid.foreign_text import controls_shown
from ibrid.generic.answer import GenericAnswer
from ibrid.report.facts.validation_rows import validation_sentence
from ibrid.report.look.numbers import number
from ibrid.report.texts.text import table


def parameter_cells(answer: GenericAnswer) -> list[list[str]]:
    """A row for each number: block, name, before, now, what the events say."""
    return [
        [block, name, "-" if before is None else number(before, 4), number(value, 4), said]
        for block, name, before, value, said in answer.rows()
    ]


PARAMETER_HEAD = ["block", "parameter", "before", "value", "95 %, or why it was left"]


def error_cells(answer: GenericAnswer) -> list[list[str]]:
    """A row for each record: its error before and now, or held out of the fit."""
    fitted = [
        [
            played.record.name,
            _error(answer.started.get(played.record.name)),
            _error(played.nrmse),
            "-",
        ]
        for played in answer.played
    ]
    held_out = [[one.record.name, "-", "-", _error(one.nrmse)] for one in answer.held_out]
    return fitted + held_out


def bands_not_shown(answer: GenericAnswer) -> Iterator[str]:
    """A sentence for each band in which the generic model is blind, the worst event first."""
    bands = dict.fromkeys((one.low_hz, one.high_hz) for one in answer.cannot_show)
    for low, high in sorted(bands):
        inside = [one for one in answer.cannot_show if one.low_hz == low]
        inside.sort(key=lambda one: -one.left)
        events = some([f"{one.event} ({one.left:.0%} of its answer)" for one in inside], 4)
        yield f"{low:g} to {high:g} Hz is not shown by the generic model in {events}"


ERROR_HEAD = ["record", "before", "fitted", "held out"]


def remarks(answer: GenericAnswer) -> Iterator[str]:
    """Sentences."""
    for first, second, value in answer.fit.correlations:
        yield f"{first} and {second} are correlated by {value:.3f}: only one combination is known"
    yield from answer.warnings
    yield from bands_not_shown(answer)
    yield from (f"left out: {words}" for words in answer.left_out)
    yield validation_sentence(answer.validation)


@controls_shown
def generic_text(answer: GenericAnswer) -> str:
    """Tables of the parameters that were not just left, and of the errors; remarks."""
    rows = [row for row in parameter_cells(answer) if row[4] != "left as it was"]
    lines = table(PARAMETER_HEAD, rows)
    lines += table(["NRMSE of record", *ERROR_HEAD[1:]], error_cells(answer))
    return "\n".join([*lines, *remarks(answer)])


def _error(value: float | None) -> str:
    return "-" if value is None else number(value, 3)
