"""Suggested edits on the page of a gap: what might be missing where the catalogue has no name, and how it did."""

from ibrid.gap.result import Gap, Suggested
from ibrid.report.gap_program import changed_lines
from ibrid.report.gap_words import HELD_OUT
from ibrid.report.markup import cell, escape, head, paragraph, table, value_cell
from ibrid.report.numbers import number

#: Rows of the table at most.
ROWS = 12


def suggestions_html(gap: Gap) -> str:
    """All suggestions, and the change of the program that the first one makes when it passes every test."""
    rows = "".join(map(_row, gap.suggested[:ROWS]))
    passed = [one for one in gap.suggested if not one.reason]
    words = (
        "None of these has a physical name in the catalogue, so the verdict stays; each was refitted and put to the tests of "
        "a named effect. "
        + ("What passes is a lead to follow up, not a finding." if passed else "None passes them all.")
    )
    names = ["suggestion", "by", "chi2 per degree of freedom", "before", "adds", "fails because"]
    shown = table("Suggestions", "", head(names, numeric=(2, 3)) + f"<tbody>{rows}</tbody>")
    return paragraph(words) + shown + (_change(gap, passed[0]) if passed else "")


def _row(one: Suggested) -> str:
    adds = ", ".join(f"{name} = {number(value)}" for name, value in one.parameters.items())
    cells = [cell(one.source), value_cell(one.chi2_per_dof), value_cell(one.before), cell(adds, wraps=True)]
    reason = cell(one.reason, wraps=True) if one.reason else '<td class="good">passes all tests</td>'
    return f'<tr><th scope="row">{escape(one.words)}</th>{"".join(cells)}{reason}</tr>'


def _change(gap: Gap, one: Suggested) -> str:
    held = [
        f"{words} {number(before)} before and {number(after)} after"
        for key, words in HELD_OUT.items()
        if (before := one.held_out["before"].get(key)) is not None
        and (after := one.held_out["after"].get(key)) is not None
    ]
    told = f"Error over the noise at data held out, 1 when only noise is left: {'; '.join(held)}." if held else ""
    return (
        paragraph("The first that passes changes the program so:")
        + changed_lines(gap.given, one.program)
        + paragraph(told)
    )
