"""A gap as text for the terminal: at most 40 lines of 96 columns; the page has the rest."""

import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path

from ibrid.foreign_text import controls_shown
from ibrid.gap.results.files import DIFF, FILES
from ibrid.gap.results.gap import Gap, NamedEffect
from ibrid.gap.results.verdict import FAR
from ibrid.measurement.quality.sequence_view import sequence_view
from ibrid.measurement.sweeps.quantities import span
from ibrid.report.facts.gap_words import change_words, far, moved_interval, parameter_words
from ibrid.report.facts.left_over import left_by_gap
from ibrid.report.figures.gap_curves import closed, repaired
from ibrid.report.look.numbers import error, number, percent
from ibrid.report.texts.text import table

WIDTH, INDENT = 96, 12
#: Lines that effects take at most, and how many are listed of everything else.
EFFECT_LINES, PARTS, PORTS, MOVED, MEASURED = 12, 3, 3, 3, 3


@controls_shown
def gap_text(gap: Gap, folder: str | Path | None = None) -> str:
    """What `ibrid gap` prints.

    folder : where the files of the answer lie; they are named when it is given.
    """
    effects = [line for one in gap.effects for line in _effect(gap, one)]
    if len(effects) > EFFECT_LINES:
        effects = [*effects[: EFFECT_LINES - 1], " " * INDENT + "more on the page"]
    model = "repaired" if repaired(gap) else "refitted"
    unseen = ", ".join(dict.fromkeys(one.id for one in gap.could_not_have_seen))
    parts = [
        _wrapped(f"{gap.verdict}: {gap.sentence}", "", "", 5),
        effects,
        _errors(gap),
        [
            *_amplitudes(gap),
            *_located(gap),
            *_ports(gap),
            *_entry("sequences", " ".join(sequence_view(gap.sweep).sentences), 4),
            *_suggested(gap),
            *_moved(gap),
            *_entry("invisible", "; ".join(gap.null_space), 2),
            *_entry(
                "unseen", unseen and f"too weak for these data at their usual strength: {unseen}", 2
            ),
            *_entry("noise", gap.noise),
            *_entry(
                "grade", f"{gap.repaired.grade}, of the {model} model" if gap.repaired.grade else ""
            ),
            *_entry("to do", gap.convention.remedy, 3),
            *_measure(gap),
        ],
    ]
    if folder is not None:
        files = [name for name in FILES if name != DIFF or gap.program != gap.given]
        parts.append(list(_entry("files", f"{Path(folder)}: {', '.join(files)}", 2)))
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


def _effect(gap: Gap, effect: NamedEffect) -> Iterator[str]:
    yield from _entry("effect", f"{effect.id}, {change_words(effect)}", 2)
    for name, value, readable, ends in parameter_words(gap, effect):
        same = f" ({readable})" if readable else ""
        yield from _entry("", f"{name} = {value}{same}, 95 %: {ends}")
    if effect.indistinguishable_from:
        yield from _entry(
            "", f"these data cannot tell it from {', '.join(effect.indistinguishable_from)}", 2
        )


def _errors(gap: Gap) -> list[str]:
    nonlinear = gap.amplitude is not None and gap.amplitude.after is not None and not repaired(gap)
    changed = repaired(gap) or nonlinear
    name, before, after = (
        "all amplitudes" if nonlinear else "fitted points",
        gap.before,
        gap.after.get("refit"),
    )
    rows = [_row(name, before.get("nominal"), before.get("refit"), after, gap.noise_floor)]
    if gap.held_out:
        rows.append(
            _row(
                "held out",
                None,
                gap.before.get("holdout"),
                gap.after.get("holdout"),
                gap.noise_floor,
            )
        )
    head = ["NRMSE, mean", "as given", "refitted", "repaired", "noise alone", "gap closed"]
    kept = [0, 1, 2, *([3] if changed else []), 4, *([5] if changed else [])]
    return table(
        [head[k] for k in kept],
        [[line[k] for k in kept] for line in rows],
        right=range(1, len(kept)),
    )


def _row(
    name: str, given: float | None, before: float | None, after: float | None, noise: float | None
) -> list[str]:
    return [
        name,
        error(given),
        error(before),
        error(after),
        error(noise),
        closed(before, after, noise),
    ]


def _located(gap: Gap) -> Iterator[str]:
    for place, one in enumerate(gap.located[:PARTS]):
        where, window, part = one.place
        words = (
            f"{where}, {part}, {window}: {percent(one.share)} of the misfit, z {number(one.z, 3)}"
        )
        yield from _entry("" if place else "misfit", words)


def _ports(gap: Gap) -> Iterator[str]:
    adequate = [one.port.words for one in gap.ports if one.adequate]
    if adequate:
        left = f" and at {len(adequate) - PORTS} more places" if len(adequate) > PORTS else ""
        yield from _entry(
            "place", f"one unknown transfer explains all at {'; '.join(adequate[:PORTS])}{left}", 2
        )
    elif gap.ports and gap.verdict != "data-convention":
        yield from _entry("place", "no single place explains it all")


def _measure(gap: Gap) -> Iterator[str]:
    """What to measure where something has no name; the page says all of it."""
    left = left_by_gap(gap)
    for place, words in enumerate(() if left is None else left.measure[:MEASURED]):
        yield from _entry("" if place else "measure", words, 2)


def _suggested(gap: Gap) -> Iterator[str]:
    if gap.suggested and gap.suggested[0].reason:
        yield from _entry(
            "suggested",
            f"none of {len(gap.suggested)} edits outside the catalogue passes all tests",
        )
    elif gap.suggested:
        suggestion, passed = gap.suggested[0], sum(not other.reason for other in gap.suggested)
        more = f" and {passed - 1} more" if passed > 1 else ""
        yield from _entry(
            "suggested",
            f"{suggestion.words} (by {suggestion.source}){more} would explain it; "
            "a lead, not a finding",
            2,
        )


def _amplitudes(gap: Gap) -> Iterator[str]:
    if gap.amplitude is None:
        return
    linearity, label = gap.amplitude.linearity, "amplitudes"
    worst = [one for one in linearity.bands if not one.products] or list(linearity.bands)
    if not worst:
        yield from _entry(label, f"{len(linearity.amplitudes)} of them, the response is the same")
    for one in worst[:2]:
        place = f"{one.op}, {one.entry}, {span(*one.band)}"
        yield from _entry(
            label, f"{place}: changes by {percent(one.change)} of |Y|, z {number(one.z, 3)}"
        )
        label = ""
    if len(worst) > 2:
        left = f"{len(linearity.refused)} frequencies left out of the small-signal model"
        yield from _entry("", f"and {len(worst) - 2} more bands; {left}")


def _moved(gap: Gap) -> Iterator[str]:
    moved_far = far(gap)
    for place, parameter in enumerate(moved_far[:MOVED]):
        more = (
            f"; {len(moved_far) - MOVED} more"
            if place == MOVED - 1 and len(moved_far) > MOVED
            else ""
        )
        words = (
            f"{parameter.name} {number(parameter.nominal)} -> {number(parameter.refitted)}, 95 %: "
            f"{moved_interval(parameter)}"
        )
        yield from _entry(
            "" if place else "moved", f"{words} ({parameter.sigmas:+.1f} sigma{more})"
        )
    if gap.moved and not moved_far:
        yield from _entry("moved", f"no parameter beyond {FAR:g} sigma of its nominal value")


def _entry(label: str, words: str, most: int = 1) -> Iterable[str]:
    """A label and words beside it, on `most` lines."""
    return _wrapped(words, label.ljust(INDENT), " " * INDENT, most)


def _wrapped(words: str, first: str, then: str, most: int) -> list[str]:
    return textwrap.wrap(
        " ".join(words.split()),
        WIDTH,
        initial_indent=first,
        subsequent_indent=then,
        max_lines=most,
        placeholder=" ...",
        break_on_hyphens=False,
    )
