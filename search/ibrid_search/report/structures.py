"""Which structures explain the data, if any does: error against complexity, what fits equally well, what is residual."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.markup import cell, data, error_cell, head, paragraph, table, value_cell
from ibrid.report.numbers import sentence
from ibrid.report.trajectory import Front, draw_front
from ibrid.structure.program import parse_program
from ibrid_search.report.course import shortened
from ibrid_search.report.run_data import RunData
from ibrid_search.report.selection import Choice
from ibrid_search.trajectory import eligible

#: Rows of the table at most.
ROWS = 60


def structures_html(run: RunData) -> str:
    """Figures, table and the sentences about the choice."""
    chosen = run.selection
    if not chosen.front:
        return paragraph("No stable candidate has been fitted yet.")
    words = (
        [sentence(chosen.why)]
        if chosen.why
        else ["The lowest error; among ties the fewest free parameters. The run has not chosen yet."]
    )
    alike = chosen.equally_good
    listed = ", ".join(map(str, alike[:12])) + (" and more" if len(alike) > 12 else "")
    if not run.explained:
        near = f"; {len(alike)} are about equally near, steps {listed}" if len(alike) > 1 else ""
        words.append(f"{not_explained(run)}{near}.")
    elif len(alike) > 1:
        words.append(f"{len(alike)} structures fit equally well, steps {listed}; the data cannot tell them apart.")
    if chosen.residual:
        words.append(f"Residual modules, which stand for no physics: {', '.join(chosen.residual)}.")
    figures = _figure(run, "free", "free parameters") + _figure(run, "order", "order")
    note = "Dots: fitted candidates; crosses: unstable ones; line: nothing simpler is better; ring: the answer."
    return "".join(map(paragraph, words)) + paragraph(note, "note") + f'<div class="four">{figures}</div>' + _table(run)


def not_explained(run: RunData) -> str:
    """The beginning of a sentence about a run whose answer leaves more than noise would."""
    if run.floor is not None and not run.floor.known:
        return "No structure fits the data exactly yet, and their noise is not known"
    return "No structure explains the data yet"


def _figure(run: RunData, count: str, name: str) -> str:
    steps = [one for one in run.steps.values() if one.nrmse is not None and getattr(one, count) is not None]
    spots = [(float(getattr(one, count)), one.nrmse) for one in run.selection.front if getattr(one, count) is not None]
    answer = run.answer
    place = getattr(answer, count) if answer is not None else None
    shown = Front(
        cost=np.array([float(getattr(one, count)) for one in steps]),
        nrmse=np.array([math.nan if one.nrmse is None else one.nrmse for one in steps], dtype=float),
        stable=np.array([eligible(one) for one in steps], dtype=bool),
        front=_undominated([(cost, value) for cost, value in spots if value is not None]),
        answer=None if answer is None or place is None or answer.nrmse is None else (float(place), answer.nrmse),
        name=name,
    )
    label = f"NRMSE on a logarithmic scale over the number of {name}; the table below gives the front."
    svg = inline_svg(lambda axes: draw_front(axes, shown), name=f"front-{count}", label=label, size=(5.2, 3.4))
    return figure_html(svg, f"Error against {name}")


def _undominated(spots: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Those of a front of three merits that are also a front of these two."""
    found: list[tuple[float, float]] = []
    for spot in sorted(set(spots)):
        if not found or spot[1] < found[-1][1]:
            found.append(spot)
    return tuple(found)


def _table(run: RunData) -> str:
    front = sorted(run.selection.front, key=lambda one: (math.inf if one.nrmse is None else one.nrmse, one.step))
    held = any(one.holdout is not None for one in front)
    more = [name for name in dict.fromkeys(key for one in front for key in one.more) if any(
        one.more.get(name) is not None for one in front)]  # fmt: skip
    noted = any(one.note for one in front)
    names = ["step", "", "NRMSE", *(["held out"] if held else []), "order", "free parameters", "stable"]
    names += [name.replace("_", " ") for name in more] + ["made of", *(["note"] if noted else [])]
    numeric = [0, *range(2, 5 + held), *range(6 + held, 6 + held + len(more))]
    rows = "".join(_row(run, one, held, more, noted) for one in front[:ROWS])
    left = f" {len(front) - ROWS} more are not listed." if len(front) > ROWS else ""
    caption = f"Structures that no simpler one beats, the lowest error first.{left}"
    return table("Structures", caption, head(names, numeric=numeric) + f"<tbody>{rows}</tbody>")


def _row(run: RunData, one: Choice, held: bool, more: list[str], noted: bool) -> str:
    marks = ["the answer"] if run.answer is not None and one.step == run.answer.number else []
    alike = "fits equally well" if run.explained else "about equally near"
    marks += [alike] if one.step in run.selection.equally_good and len(run.selection.equally_good) > 1 else []
    stable = "" if one.stable is None else "yes" if one.stable else "NO"
    step = run.steps.get(one.step)
    cells = [
        cell(", ".join(marks), wraps=True),
        error_cell(one.nrmse),
        *([error_cell(one.holdout)] if held else []),
        *(f'<td class="n">{data(value, "-" if value is None else str(value))}</td>' for value in (one.order, one.free)),
        f'<td class="{"bad" if stable == "NO" else "good"}">{stable}</td>',
        *(value_cell(one.more.get(name), 3) for name in more),
        cell("" if step is None else _made_of(step.program, run.kinds), wraps=True),
        *([cell(shortened(one.note, 90), wraps=True)] if noted else []),
    ]
    return f'<tr><th scope="row" class="n">{one.step}</th>{"".join(cells)}</tr>'


def _made_of(program: str, kinds: Sequence[ModuleKind]) -> str:
    """Kinds of a program and their number, without what is static."""
    families = {kind.name: kind.family for kind in kinds}
    try:
        used = Counter(one.kind for one in parse_program(program).instances if families.get(one.kind) != "static")
    except IbridError:
        return ""
    return ", ".join(kind if number == 1 else f"{number} {kind}" for kind, number in used.items())
