"""Rows as lines of a terminal and as the page docs/inverters_results.md."""

from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

from ibrid_bench.markdown import markdown_table
from ibrid_bench.reference.rows import FROM_TEXTBOOK, Task
from ibrid_bench.search.tables import error_words, verdict_words

Row = Mapping[str, Any]
#: By the keys of their tasks.
Rows = Mapping[str, Row]

NOT_YET = "not measured yet"
_ANSWER = ("NRMSE", "held out", "F1 modules / connections", "found", "evaluations", "to 1e-3", "s")
HEADERS: Mapping[str, tuple[str, ...]] = {
    "sweeps": ("inverter", "states", "injected sweep", "textbook program", "CPU s"),
    "fit": ("inverter", "NRMSE", "held out", "parameters right", "CPU s"),
    "gap": (
        "inverter",
        "hidden",
        "verdict",
        "named",
        "alike",
        "right",
        "NRMSE before",
        "after",
        "held out",
        "CPU s",
    ),
    "search": ("inverter", *_ANSWER),
    **dict.fromkeys(FROM_TEXTBOOK, ("inverter", "start", "its NRMSE", *_ANSWER)),
}
_WIDTHS = {
    "inverter": 18,
    "start": 18,
    "hidden": 46,
    "verdict": 17,
    "named": 30,
    "alike": 30,
    "F1 modules / connections": 26,
}

_TOP = """# Results on every reference inverter

Made by `make bench-inverters` from the rows of its ledger. The inverters and their sources:
`docs/inverters.md`. All data are clean: 16 frequencies from 5 Hz to 5 kHz at p = 1, q = +-0.3; a
further operating point, p = 0.5, q = 0 or the nearest where the inverter is stable, is held out
from everything. CPU s: seconds of one core.

"""
_TEXTS: Mapping[str, tuple[str, str]] = {
    "sweeps": (
        "Sweeps and textbook programs",
        """Largest relative difference of Y over all frequencies and operating points. **Injected
sweep**: sinusoids in the nonlinear simulation against its linearisation (target 1e-3). **Textbook
program**: with true parameters against the linearisation, at the held-out point too (target 1e-8).
""",
    ),
    "fit": (
        "The textbook program fitted",
        """`ibrid evaluate` of the known diagram, from default initial guesses. **Parameters right**:
within 5 % of the true value; with a feedforward of the measured voltage the scale of the inner loop
is not identifiable at the terminals, so not all can be.
""",
    ),
    "gap": (
        "The gap workflow",
        """`ibrid gap` of a model and a device. **Nothing** hidden: the textbook program against its
own device, without nominal values. Otherwise the device has the named effect, the model does not,
and the model's nominal values are 15 % off (one standard deviation). **Alike**: other effects that
these data cannot distinguish from the first. **Right**: no-gap where nothing is hidden; otherwise
named first, and nothing else.
""",
    ),
    "search": (
        "The search",
        """From the naive diagram, proposer `rules`, seed 0, one run each; the answer is refitted.
**Found**: NRMSE at most 1e-3, stable, and F1 of modules and of connections against the truth at
least 0.9. **To 1e-3**: evaluations until some candidate had that error; the answer may have a
larger one (`docs/searching.md`: which answer is chosen). **s**: seconds of the run, one core of a
shared machine. More seeds, noise and other inverters: `docs/search_results.md`.
""",
    ),
    "nearest": (
        "The search from the nearest textbook diagram",
        """The same, starting as an engineer with a library that lacks this device would: from the
textbook program of another single inverter that fits the sweep best (**its NRMSE**);
`ibrid search DATA --start gfm_droop`.
""",
    ),
    "second": (
        "The search from the second nearest textbook diagram",
        """The same from the one that fits second best: the best fit is not always the most similar
diagram, since more parameters fit more.
""",
    ),
}


def heading(kind: str) -> str:
    """The columns of `line`."""
    return _aligned(HEADERS[kind], HEADERS[kind])


def line(row: Row) -> str:
    """A row for the terminal."""
    return _aligned(HEADERS[row["task"]], cells_of(row))


def cells_of(row: Row) -> tuple[str, ...]:
    """The cells of a row, in the order of its header."""
    return (row["inverter"], *_CELLS[row["task"]](row), f"{row['seconds']:.1f}")


def page(tasks: Sequence[Task], rows: Rows) -> str:
    """Markdown: what all of it comes to, and a table for each kind of rows; rows that are missing
    say so.
    """
    parts = [_TOP]
    for kind, (title, text) in _TEXTS.items():
        of_kind = [task for task in tasks if task.task == kind]
        parts.append(
            f"## {title}\n\n{text}\n{_summary(kind, of_kind, rows)}\n\n{_table(kind, of_kind, rows)}\n"
        )
    return "".join(parts).rstrip() + "\n"


def _table(kind: str, tasks: Sequence[Task], rows: Rows) -> str:
    header = HEADERS[kind]
    lines: list[tuple[str, ...]] = []
    for task in tasks:
        known = (f"`{task.inverter}`", *([_hidden(task)] if kind == "gap" else []))
        if task.key in rows:
            lines.append((known[0], *cells_of(rows[task.key])[1:]))
        else:
            lines.append((*known, *["-"] * (len(header) - len(known) - 1), NOT_YET))
    return markdown_table(header, lines)


def _hidden(task: Task) -> str:
    return "nothing" if task.hiding is None else task.hiding.words


def _summary(kind: str, tasks: Sequence[Task], rows: Rows) -> str:
    """One sentence in numbers, of the rows that are there."""
    there = [rows[task.key] for task in tasks if task.key in rows]
    if not there:
        return f"None of {len(tasks)} rows is measured yet."
    of = f"{len(there)} of {len(tasks)} measured"
    return f"{of}: {_SENTENCES[kind](there)}."


def _of_sweeps(rows: Sequence[Row]) -> str:
    injected, program = (max(row[name] for row in rows) for name in ("injected", "program"))
    return (
        f"injected sweeps within {injected:.1e} of the linearisation, textbook programs within "
        f"{program:.1e}"
    )


def _of_fits(rows: Sequence[Row]) -> str:
    worst, held = (max(row[name] for row in rows) for name in ("nrmse", "holdout"))
    return f"the worst fit has an NRMSE of {worst:.1e}, {held:.1e} at the held-out point"


def _of_gaps(rows: Sequence[Row]) -> str:
    nothing, hidden = (
        [row for row in rows if row["hidden"] is None],
        [row for row in rows if row["hidden"] is not None],
    )
    parts = []
    if nothing:
        parts.append(
            f"no-gap where nothing is hidden in {sum(row['right'] for row in nothing)} of "
            f"{len(nothing)}"
        )
    if hidden:
        first = sum(bool(row["first"]) for row in hidden)
        named = [1 + len(row["alike"]) for row in hidden if row["named"]]
        parts.append(f"the hidden effect named first in {first} of {len(hidden)}")
        if named:
            parts.append(
                f"{sum(named) / len(named):.2f} effects in the class of the first on average"
            )
    parts.append(f"{median(row['seconds'] for row in rows):.0f} s of one core in the median")
    return ", ".join(parts)


def _of_searches(rows: Sequence[Row]) -> str:
    errors = [row["answer_nrmse"] for row in rows]
    fitting = sum(one is not None and one <= 1e-3 for one in errors)
    return (
        f"{fitting} of {len(rows)} answers come to 1e-3, "
        f"{sum(bool(row['success']) for row in rows)} are found"
    )


def _sweep_cells(row: Row) -> tuple[str, ...]:
    return str(row["states"]), f"{row['injected']:.1e}", f"{row['program']:.1e}"


def _fit_cells(row: Row) -> tuple[str, ...]:
    return (
        error_words(row["nrmse"]),
        error_words(row["holdout"]),
        f"{row['recovered']} of {row['of']}",
    )


def _gap_cells(row: Row) -> tuple[str, ...]:
    errors = (error_words(row[name]) for name in ("before", "after", "holdout"))
    named, alike = (_ids(row[name]) for name in ("named", "alike"))
    return row["words"], row["verdict"], named, alike, verdict_words(row["right"]), *errors


def _search_cells(row: Row) -> tuple[str, ...]:
    overlap = f"{row['modules_f1']:.2f} / {row['connections_f1']:.2f}"
    first = "-" if row["first"] is None else str(row["first"])
    errors = error_words(row["answer_nrmse"]), error_words(row["holdout"])
    return *errors, overlap, verdict_words(row["success"]), str(row["evaluations"]), first


def _textbook_cells(row: Row) -> tuple[str, ...]:
    return f"`{row['start']}`", error_words(row["start_nrmse"]), *_search_cells(row)


_SENTENCES: Mapping[str, Callable[[Sequence[Row]], str]] = {
    "sweeps": _of_sweeps,
    "fit": _of_fits,
    "gap": _of_gaps,
    "search": _of_searches,
    **dict.fromkeys(FROM_TEXTBOOK, _of_searches),
}
_CELLS: Mapping[str, Callable[[Row], tuple[str, ...]]] = {
    "sweeps": _sweep_cells,
    "fit": _fit_cells,
    "gap": _gap_cells,
    "search": _search_cells,
    **dict.fromkeys(FROM_TEXTBOOK, _textbook_cells),
}


def _aligned(header: Sequence[str], cells: Sequence[str]) -> str:
    widths = [_WIDTHS.get(name, max(len(name), 8)) for name in header]
    return "  ".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def _ids(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "-"
