"""A record as text for the terminal, at most 110 columns wide."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import Any

from ibrid.analysis.models.loop_modes import loops_told
from ibrid.border import takes_kinds
from ibrid.evaluation.record import Record
from ibrid.foreign_text import controls_shown
from ibrid.measurement.sweeps.quantities import counted, hertz
from ibrid.measurement.sweeps.sweep import ENTRIES
from ibrid.report.facts.bands import band_in_hz
from ibrid.report.facts.left_over import LeftOver, left_by_record
from ibrid.report.facts.modes import ROUNDING, measured_up_to, modes, slowest
from ibrid.report.facts.parameter_rows import SHARED, ParameterRow, parameter_rows
from ibrid.report.facts.validation_rows import rows_of, validation_sentence
from ibrid.report.facts.verdict import graded, stability, verdict, work_of
from ibrid.report.look.numbers import error, number, percent

WIDTH = 110
_LONGEST = 34


@takes_kinds
@controls_shown
def format_record(record: Record) -> str:
    """What `ibrid evaluate` prints: outcome, errors, parameters, stability, what the data cannot
    see, warnings.
    """
    parts = [list(_head(record))]
    if record.reasons:
        parts.append(listed("why", record.reasons))
    parts.append(
        listed("labels of the data that are wrong", [one["sentence"] for one in record.labels])
    )
    if record.nrmse_by_part:
        parts += [_errors(record), *_parts(record)]
    if (left := left_by_record(record)) is not None:
        parts.append(left_over_lines(left))
    if record.nrmse_by_record:
        parts.append([*_events(record), *validation_lines(record.validation)])
    if record.parameters:
        parts.append(_parameters(parameter_rows(record)))
    if record.poles:
        parts += [_loops(record), _modes(record)]
    parts.append(listed("what the data say about the parameters", record.identifiability))
    parts.append(listed("warnings", record.warnings))
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


#: Places that are listed in a text; a page has more.
LEFT = 5


def left_over_lines(left: LeftOver) -> list[str]:
    """What a model leaves, where, what could explain it and what to measure."""
    more = len(left.places) - LEFT
    places = [place.words for place in left.places[:LEFT]]
    return [
        *wrapped(left.amount, ""),
        *listed("where it is left", [*places, *([f"{more} more places"] if more > 0 else [])]),
        *listed("what could explain it", left.causes),
        *listed("what to measure", left.measure),
    ]


def _head(record: Record) -> Iterator[str]:
    yield from wrapped(f"{graded(record) or record.outcome}: {verdict(record)}", "")
    settings = record.settings
    if settings.get("data"):
        yield from wrapped(f"data       {settings['data']}", " " * 11)
    if record.modules:
        yield (
            f"model      {counted(record.modules, 'module')}, {counted(record.sums, 'sum')}, order "
            f"{record.order}, "
            f"{counted(record.free_parameters, 'free parameter')}"
        )
    made = [
        f"{settings[name]} {word}"
        for name, word in (
            ("parameters", "parameters"),
            ("equilibrium", "equilibrium"),
            ("vocabulary", "vocabulary"),
        )
        if name in settings
    ]
    made += [f"effort {settings['effort']}"] if "effort" in settings else []
    made += [work] if (work := work_of(record)) else []
    yield from wrapped(f"made with  {', '.join(made)}", " " * 11)
    if record.stable:
        yield from wrapped(f"stability  {stability(record)}", " " * 11)


def _events(record: Record) -> list[str]:
    rows = [[name, number(error, 3)] for name, error in record.nrmse_by_record.items()]
    windows = "; ".join(
        f"{name} {number(error, 3)}" for name, error in record.nrmse_by_window.items()
    )
    return [
        *table(["record of an event", "NRMSE"], rows, right=(1,)),
        *wrapped(f"by window  {windows}", " " * 11),
    ]


def validation_lines(validation: Mapping[str, Any] | None) -> list[str]:
    """The measures of a standard as a table, and whether all pass; nothing without any."""
    if not validation:
        return []
    head = ["record", "window", "beside", "signal", "MXE", "ME", "MAE", ""]
    rows = [
        [
            one.record,
            one.window,
            one.reference,
            one.signal,
            *(number(value, 3) for value in one.values),
            one.word,
        ]
        for one in rows_of(validation)
    ]
    return ["", validation_sentence(validation), *table(head, rows)]


def _errors(record: Record) -> list[str]:
    rows = [[_cut(op), error(value), ""] for op, value in record.nrmse_by_op.items()]
    rows += [
        [_cut(op), error(value), "held out: predicted, not fitted"]
        for op, value in record.holdout.items()
    ]
    if len(record.nrmse_by_op) > 1:
        rows.append(["mean of the fitted", error(record.nrmse), ""])
    return table(["operating point", "NRMSE", ""], rows, right=(1,))


def _parts(record: Record) -> Iterator[list[str]]:
    """Error by band and entry, two operating points beside each other."""
    names = list(record.nrmse_by_part)
    for left, right in zip_longest(names[::2], names[1::2]):
        blocks = [_part(record, name) for name in (left, right) if name is not None]
        if len(blocks) == 1:
            yield blocks[0]
            continue
        width = max(map(len, blocks[0]))
        yield [
            f"{one:<{width}}    {other}".rstrip()
            for one, other in zip_longest(*blocks, fillvalue="")
        ]


def _part(record: Record, op: str) -> list[str]:
    rows = [
        [f"{band_in_hz(record, band)} Hz", *(error(found.get(entry)) for entry in ENTRIES)]
        for band, found in record.nrmse_by_part[op].items()
    ]
    return [_cut(f"error at {op}", 48), *table(["band", *ENTRIES], rows, right=(1, 2, 3, 4))]


def _parameters(rows: Sequence[ParameterRow]) -> list[str]:
    head = ["parameter", "value", "unit", "", "95 % interval", "", "at"]
    cells = [
        [
            _cut(row.name),
            number(row.value),
            row.unit,
            f"({row.readable})" if row.readable else "",
            row.interval,
            f"AT BOUND of {row.box_words}" if row.at_bound else "",
            _cut(row.where, 18),
        ]
        for row in rows
    ]
    if all(row.where == SHARED for row in rows):
        head, cells = head[:-1], [line[:-1] for line in cells]
    return table(head, cells, right=(1,))


def _modes(record: Record) -> list[str]:
    highest = measured_up_to(record)
    rows = []
    for op, poles in record.poles.items():
        least = modes(poles, highest)[:3]
        words = [f"{hertz(mode.frequency)} at {percent(mode.damping)}" for mode in least] or [
            "no oscillating mode"
        ]
        if real := [one for one in poles if abs(one[1]) <= ROUNDING * abs(one[0])]:
            words.append(f"slowest real pole {number(slowest(real), 3)} 1/s")
        rows.append([_cut(op), "stable" if record.stable.get(op) else "UNSTABLE", "; ".join(words)])
    return table(["operating point", "", "least damped modes (frequency at damping ratio)"], rows)


def _loops(record: Record) -> list[str]:
    rows = [
        [
            one.loop,
            one.regulator,
            *(
                "-" if value is None else words(value)
                for value, words in (
                    (one.bandwidth, hertz),
                    (one.phase_margin, lambda x: f"{number(x, 3)} deg"),
                    (one.damping, percent),
                )
            ),
        ]
        for one in loops_told(record)
    ]
    return (
        table(["loop", "regulator", "bandwidth", "phase margin", "damping"], rows, right=(2, 3, 4))
        if rows
        else []
    )


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()
) -> list[str]:
    """Aligned columns two spaces apart under a ruled head."""
    widths = [max(len(line[index]) for line in [head, *rows]) for index in range(len(head))]
    kept = [index for index, width in enumerate(widths) if width]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(
            cells[index].rjust(widths[index])
            if index in right
            else cells[index].ljust(widths[index])
            for index in kept
        ).rstrip()

    return [line(head), "  ".join("-" * widths[index] for index in kept), *map(line, rows)]


def listed(title: str, sentences: Sequence[str]) -> list[str]:
    """Sentences under their heading; nothing without any."""
    if not sentences:
        return []
    return [f"{title}:", *(line for one in sentences for line in wrapped(f"  - {one}", "    "))]


def wrapped(text: str, indent: str) -> list[str]:
    """Lines of a sentence, all but the first indented."""
    return textwrap.wrap(text, WIDTH, subsequent_indent=indent, break_on_hyphens=False)


def _cut(text: str, longest: int = _LONGEST) -> str:
    return text if len(text) <= longest else text[: longest - 3] + "..."
