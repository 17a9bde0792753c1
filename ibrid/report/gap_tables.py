"""Tables of a gap: what is missing, where it shows, which ports explain it, what moved, what else was tried or unseen."""

from ibrid.gap.result import Candidate, Gap, Moved, NamedEffect
from ibrid.gap.verdict import FAR
from ibrid.measurement.quantities import span
from ibrid.report.gap_curves import repaired
from ibrid.report.gap_words import (
    UNKNOWN,
    change_words,
    declared,
    evidence_words,
    far,
    moved_interval,
    p_value,
    parameter_words,
)
from ibrid.report.markup import bullets, cell, data, escape, folded, head, paragraph, row, sentence, table, value_cell
from ibrid.report.numbers import number, percent

#: Rows of a table at most.
ROWS = 20
#: Cells for a model that is stable, is not, or was not asked.
STABLE = {True: '<td class="good">yes</td>', False: '<td class="bad">NO</td>', None: "<td>not asked</td>"}


def effect_html(gap: Gap, effect: NamedEffect) -> str:
    """One effect: what and where, its parameters, what it cannot be told from, what the answer rests on."""
    known = declared(effect.id)
    facts = [f"{change_words(effect)}."]
    facts += [f"Law: {known.law}.", f"It shows: {known.signature}."] if known else []
    parameters = "".join(
        f'<tr><th scope="row"><code>{escape(name)}</code></th>{"".join(cell(one.replace("+-", "±")) for one in words)}</tr>'
        for name, *words in parameter_words(gap, effect)
    )
    shown = f"<h3><code>{escape(effect.id)}</code></h3>" + bullets(map(sentence, facts))
    if parameters:
        inner = head(["parameter", "estimate", "", "95 % interval"]) + f"<tbody>{parameters}</tbody>"
        shown += table(f"Parameters of {effect.id}", "What was found.", inner)
    shown += paragraph(_alike(effect))
    evidence = "".join(row(words, [cell(value, numeric=True)]) for words, value in evidence_words(effect.evidence))
    if not evidence:
        return shown
    caption = "Before: the given model, refitted; after: the repaired one."
    return shown + folded("What it rests on", table(f"Evidence for {effect.id}", caption, f"<tbody>{evidence}</tbody>"))


def _alike(effect: NamedEffect) -> str:
    if not effect.indistinguishable_from:
        return "No other effect that was tried explains these data as well."
    apart = [
        f"{name}: {known.told_apart_by}"
        for name in (effect.id, *effect.indistinguishable_from)
        if (known := declared(name))
    ]
    words = f"These data cannot tell it from {', '.join(effect.indistinguishable_from)}."
    return words + (f" What would: {'; '.join(apart)}." if apart else "")


def located_table(gap: Gap) -> str:
    """Where the refitted model misses the data; a sentence where it does not."""
    if not gap.located:
        return paragraph("Nowhere: in no band, entry and operating point is the misfit larger than noise.")
    rows = [
        row(one.op, [
            cell(span(*one.band)),
            cell(one.entry),
            cell(percent(one.share), numeric=True),
            cell(number(one.z, 3), numeric=True),
        ])
        for one in gap.located
    ]  # fmt: skip
    caption = "Parts beyond noise, the largest share of the misfit first; z counts standard deviations."
    names = ["operating point", "band", "entry", "share of the misfit", "z"]
    return table("Located misfit", caption, head(names, numeric=(3, 4)) + f"<tbody>{''.join(rows)}</tbody>")


def port_table(gap: Gap) -> str:
    """Every port with its fit."""
    rows = [
        f'<tr><th scope="row">{escape(one.port.words)}</th><td><code>{escape(one.port.name)}</code></td>'
        f'{value_cell(one.chi2_per_dof)}<td class="n">{data(one.p_value, p_value(one.p_value))}</td>{_yes(one.adequate)}</tr>'
        for one in gap.ports
    ]
    names = ["place", "in the program", "chi2 / dof", "p value", "adequate"]
    return table(
        "Port map", "All ports, the best first.", head(names, numeric=(2, 3)) + f"<tbody>{''.join(rows)}</tbody>"
    )


def _yes(value: bool) -> str:
    return '<td class="good">yes</td>' if value else "<td>no</td>"


def moved_table(gap: Gap) -> str:
    """Parameters with nominal values: nominal, refitted without and with the repair, interval, distance."""
    if not gap.moved:
        return paragraph("No nominal values were given, so nothing can be said to have moved.")
    before = next(iter(gap.baseline.parameters.values()), {}) if repaired(gap) else {}
    rows = "".join(_moved_row(gap, one, before.get(one.name)) for one in gap.moved)
    names = ["parameter", "meaning", "nominal", *(["before the repair"] if repaired(gap) else []), "fitted", "unit"]
    names += ["95 % interval", "moved (sigma)", ""]
    numeric = [
        index for index, name in enumerate(names) if name in ("nominal", "before the repair", "fitted", "moved (sigma)")
    ]
    count = len(far(gap))
    words = f"{count} moved beyond {FAR:g} sigma" if count else f"None moved beyond {FAR:g} sigma"
    caption = f"{words}; one sigma is the tolerance of the nominal value, on a logarithmic scale."
    return table("Nominal and fitted values", caption, head(names, numeric=numeric) + f"<tbody>{rows}</tbody>")


def _moved_row(gap: Gap, one: Moved, before: float | None) -> str:
    box = gap.repaired.boxes.get(one.name, {})
    away = abs(one.sigmas) > FAR
    cells = [
        cell(str(box.get("meaning", "")), wraps=True),
        value_cell(one.nominal),
        *([value_cell(before)] if repaired(gap) else []),
        value_cell(one.refitted),
        cell(str(box.get("unit", ""))),
        cell(moved_interval(one).replace("+-", "±")),
        f'<td class="n">{data(one.sigmas, f"{one.sigmas:+.1f}")}</td>',
        '<td class="bad">far</td>' if away else "<td></td>",
    ]
    return f'<tr><th scope="row"><code>{escape(one.name)}</code></th>{"".join(cells)}</tr>'


def candidate_table(gap: Gap) -> str:
    """Every edit that was tried and what is wrong with it."""
    if not gap.candidates:
        return paragraph("No edit was tried.")
    best = min(one.bic for one in gap.candidates)
    rows = "".join(_candidate_row(one, best) for one in gap.candidates[:ROWS])
    left = len(gap.candidates) - ROWS
    caption = "One edit of the given model each, refitted. BIC: cost with a price for every free number, over the best."
    caption += f" {left} that fit worse are not listed." if left > 0 else ""
    names = [
        "effect",
        "change",
        "where",
        "cost",
        "fall of the cost",
        "BIC over the best",
        "fits",
        "stable",
        "out because",
    ]
    return table("Candidates", caption, head(names, numeric=(3, 4, 5)) + f"<tbody>{rows}</tbody>")


def _candidate_row(one: Candidate, best: float) -> str:
    cells = [
        cell(one.change),
        cell(one.where, wraps=True),
        value_cell(one.cost),
        value_cell(one.gain),
        value_cell(one.bic - best),
        _yes(one.adequate),
        STABLE[one.stable],
        cell(one.reason, wraps=True),
    ]
    return f'<tr><th scope="row"><code>{escape(one.id)}</code></th>{"".join(cells)}</tr>'


def unseen_table(gap: Gap) -> str:
    """Effects that could be there without a trace, and what would show them."""
    if not gap.could_not_have_seen:
        return paragraph("Every effect of the catalogue that can be added would have shown at its usual strength.")
    rows = "".join(
        f'<tr><th scope="row"><code>{escape(one.id)}</code></th>{cell(one.where, wraps=True)}'
        f"{value_cell(one.detectability, 2)}{cell(one.sweep or UNKNOWN, wraps=True)}</tr>"
        for one in gap.could_not_have_seen
    )
    names = ["effect", "where", "chi2 it would add", "what would show it"]
    caption = "At their usual strength these change the data by less than noise and parameters hide (chi2 below 15)."
    return table("Could not have been seen", caption, head(names, numeric=(2,)) + f"<tbody>{rows}</tbody>")
