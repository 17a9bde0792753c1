"""The archive in numbers: how proposals ended and why, who made them, the islands, the time, the settings."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from ibrid.report.markup import cell, error_cell, folded, head, paragraph, program, row, table
from ibrid.report.numbers import percent, seconds
from ibrid_search.report.course import shortened
from ibrid_search.report.run_data import RunData
from ibrid_search.step import EVALUATED, Status, Step
from ibrid_search.tally import Tally, counts
from ibrid_search.trajectory import eligible

#: Reasons that are shown for each ending.
REASONS = 3

MEANINGS = {
    Status.NO_ANSWER: "the proposer gave nothing usable",
    Status.NO_EDIT: "an answer without an edit",
    Status.NO_MATCH: "the text to replace is not in the program",
    Status.AMBIGUOUS: "the text to replace is there more than once",
    Status.UNREADABLE: "the edited text is no program",
    Status.ILLEGAL: "the grammar refuses the diagram",
    Status.UNCHANGED: "the same structure as its parent",
    Status.DUPLICATE: "a structure met before; its evaluation stands",
    Status.IMPLAUSIBLE: "a cheap physical check refuses it",
    Status.PENDING: "waits for its evaluation",
    Status.OK: "fitted",
    Status.FAILED: "no fit exists",
    Status.TIMEOUT: "stopped by the time limit, twice",
    Status.LOST: "its workers died; not the candidate's fault",
    Status.REQUIRED: "fitted, but not what was required",
}

#: Statistics of the archive that are shown, in words.
_ARCHIVE = {
    "entries": "structures kept",
    "unstable": "unstable among them",
    "elites": "elites",
    "admitted": "admitted in all",
    "evicted": "evicted",
    "migrations": "migrations between islands",
}


def statistics_html(run: RunData) -> str:
    """All tables."""
    proposals = [step for step in run.steps.values() if step.number > 0]
    if not proposals:
        return paragraph("Nothing has been proposed yet.") + settings_html(run)
    parts = [_endings(proposals), _retried(run), _archive(run)]
    parts += [_groups("Proposers", "proposer", proposals, lambda step: step.proposer or "-")]
    parts.append(_groups("Scale of the edit asked for", "scale", proposals, lambda step: step.scale or "-"))
    parts.append(_groups("Islands", "island", proposals, lambda step: str(step.island)))
    return "".join(parts) + _usage(proposals) + settings_html(run)


def _endings(proposals: list[Step]) -> str:
    found = counts(proposals)
    reasons: dict[Status, Counter[str]] = {}
    for step in proposals:
        if step.reason:
            reasons.setdefault(step.status, Counter())[shortened(step.reason)] += 1
    rows = "".join(
        row(str(status), [
            cell(str(found[status]), numeric=True),
            cell(percent(found[status] / len(proposals)), numeric=True),
            cell(MEANINGS[status]),
            cell(_most(reasons.get(status, Counter())), wraps=True),
        ])
        for status in Status if found[status]
    )  # fmt: skip
    names = ["ending", "number", "share", "meaning", "most frequent reasons"]
    return table(
        "Endings", f"How {len(proposals)} proposals ended.", head(names, numeric=(1, 2)) + f"<tbody>{rows}</tbody>"
    )


def _most(reasons: Counter[str]) -> str:
    ordered = sorted(reasons.items(), key=lambda one: (-one[1], one[0]))
    shown = "; ".join(f"{number} × {reason}" for reason, number in ordered[:REASONS])
    return shown + (f"; {len(ordered) - REASONS} other reasons" if len(ordered) > REASONS else "")


def _retried(run: RunData) -> str:
    """How many evaluations did not go through at once; "" when all did."""
    if not run.retried:
        return ""
    number, attempts = len(run.retried), sum(run.retried.values())
    which = "candidate was" if number == 1 else "candidates were"
    return paragraph(
        f"{number} {which} begun {attempts} times in all: the wall limit stopped them, or a worker was lost."
    )


def _archive(run: RunData) -> str:
    """What the search drew its parents from when it ended; "" before."""
    found = [(words, run.archive[name]) for name, words in _ARCHIVE.items() if isinstance(run.archive.get(name), int)]
    if not found:
        return ""
    numbers = "".join(cell(str(number), numeric=True) for _, number in found)
    names = head([words for words, _ in found], numeric=range(len(found)))
    return table(
        "Archive", "What parents were drawn from when the search ended.", f"{names}<tbody><tr>{numbers}</tr></tbody>"
    )


def _groups(title: str, what: str, proposals: Iterable[Step], of: Callable[[Step], str]) -> str:
    groups: dict[str, list[Step]] = {}
    for step in proposals:
        groups.setdefault(of(step), []).append(step)
    rows = "".join(row(name, _group(groups[name])) for name in sorted(groups, key=lambda name: (len(name), name)))
    names = [what, "proposals", "valid", "duplicate", "unchanged", "refused", "failed", "best NRMSE"]
    return table(title, f"{title}.", head(names, numeric=range(1, 8)) + f"<tbody>{rows}</tbody>")


def _group(steps: list[Step]) -> list[str]:
    tally = Tally.of(counts(steps))
    best = min((step.nrmse for step in steps if eligible(step) and step.nrmse is not None), default=None)
    numbers = [len(steps), tally.valid, tally.duplicate, tally.unchanged, tally.refused, tally.failed]
    return [*(cell(str(number), numeric=True) for number in numbers), error_cell(best)]


def _usage(proposals: Iterable[Step]) -> str:
    """What proposers used, added up: tokens and money of language models, first looks of the rules; "" for nothing."""
    total: dict[str, float] = {}
    for step in proposals:
        for name, value in step.usage.items():
            if isinstance(value, int | float) and not isinstance(value, bool) and value:
                total[name] = total.get(name, 0) + value
    if not total:
        return ""
    rows = "".join(row(name.replace("_", " "), [cell(f"{value:,.6g}", numeric=True)]) for name, value in total.items())
    return table("Usage", "What the proposers used, all together.", f"<tbody>{rows}</tbody>")


def speed(run: RunData) -> Mapping[str, str]:
    """Facts about time: name -> words."""
    fitted = [step for step in run.steps.values() if step.status in EVALUATED]
    busy = sum(step.seconds for step in fitted)
    facts = {}
    if fitted and busy > 0:
        facts["time of one evaluation, mean"] = seconds(busy / len(fitted))
    try:
        elapsed = float(run.meta.get("seconds", ""))
    except ValueError:
        return facts
    if elapsed > 0:
        facts["duration"] = seconds(elapsed)
        facts["evaluations per second"] = f"{len(fitted) / elapsed:.3g}"
    return facts


def settings_html(run: RunData) -> str:
    """How the run was made."""
    text = run.meta.get("settings", "").strip()
    if not text:
        return ""
    return folded("Settings", program(text))
