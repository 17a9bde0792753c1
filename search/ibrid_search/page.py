"""report.html of a search: one self-contained page, during the run and after it, in the look of `ibrid report`."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from ibrid.measurement.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.report.error_table import error_tables
from ibrid.report.markup import Section, bullets, data, escape, page, page_header, paragraph, program, stable_or_not
from ibrid.report.numbers import error
from ibrid.report.parameter_table import parameter_html, twins_table
from ibrid.report.verdict import verdict
from ibrid.writing import inside, write_whole
from ibrid_search.report.course import lineage_html, trajectory_html
from ibrid_search.report.learning import learning_html
from ibrid_search.report.models import comparison_html, diagrams_html, response_html
from ibrid_search.report.run_data import RunData, Stored, read_run
from ibrid_search.report.statistics import speed, statistics_html
from ibrid_search.report.structures import not_explained, structures_html
from ibrid_search.run_folder import ARCHIVE, PAGE
from ibrid_search.step import EVALUATED
from ibrid_search.store import Store


def write_run_page(
    run: Stored | str | Path,
    path: str | Path | None = None,
    *,
    sweep: Sweep | None = None,
    vocabulary: Sequence[ModuleKind] | None = None,
) -> Path:
    """Write the page of a run, replacing the file atomically.

    Parameters
    ----------
    run : the run's folder, or its open store; another process may be writing it.
    path : where to write; report.html in the run's folder when not given.
    sweep : the measurement to show in place of the data in the store.
    vocabulary : the kinds of the run, when they are not a shipped vocabulary.

    Returns the path. Raises IbridError when there is no run, or the page cannot be written.
    """
    if isinstance(run, str | Path):
        with Store.open(inside(run, ARCHIVE), read_only=True) as store:
            return write_run_page(store, path, sweep=sweep, vocabulary=vocabulary)
    target = inside(run.path.parent, PAGE) if path is None else Path(path)
    write_whole(target, run_html(read_run(run, sweep, vocabulary)))
    return target


def run_html(run: RunData) -> str:
    """The page as text."""
    title = "Search" if run.answer is None else f"Search: NRMSE {error(run.answer.nrmse)}"
    return page(title, _header(run), _sections(run))


def _header(run: RunData) -> str:
    answer, start = run.answer, run.start
    evaluations = run.points[-1].evaluation if run.points else 0
    budget = run.settings.get("budget")
    known = f" of {budget}" if isinstance(budget, int) else ""
    if isinstance(budget, int) and evaluations > budget:  # a smaller one was given when the run went on
        known = f", budget {budget}"
    facts = [("evaluations", f"{evaluations}{known}")]
    facts.append(("proposals", str(sum(number > 0 for number in run.steps))))
    if start is not None and start.nrmse is not None:
        facts.append(("NRMSE of the start", data(start.nrmse, error(start.nrmse))))
    if answer is not None:
        facts.append(("NRMSE found", data(answer.nrmse, error(answer.nrmse))))
        facts.append(("stability", stable_or_not(bool(answer.stable))))
        facts += [("order", str(answer.order)), ("free parameters", str(answer.free))]
    if run.comparison is not None:
        both = f"{run.comparison.modules.f1:.2f} / {run.comparison.connections.f1:.2f}"
        facts.append(("F1 of modules / connections", both))
    facts += [(name, escape(words)) for name, words in speed(run).items()]
    if ending := run.meta.get("ending"):
        facts.append(("ended since", escape(ending)))
    started = _when(run.meta.get("started", ""))
    above = "Search for the block diagram behind a measured admittance" + (f", started {started}" if started else "")
    title = "What was found" if answer is not None else "Nothing found yet"
    return page_header(above, title, _verdict(run), facts)


def _when(text: str) -> str:
    """A moment in words, from a date of ISO 8601; anything else as it stands."""
    try:
        return datetime.fromisoformat(text).strftime("%Y-%m-%d %H:%M %Z").strip()
    except ValueError:
        return " ".join(text.split())


def _verdict(run: RunData) -> str:
    """The sentence on top: how good, how it was reached, whether it is the truth, what else fits."""
    answer = run.answer
    if answer is None:
        tried = sum(step.status in EVALUATED for step in run.steps.values())
        return f"No stable candidate has been fitted yet; {tried} were tried, and the reasons are below."
    record = run.record
    words = [f"NRMSE {error(answer.nrmse)}."] if record is None else [verdict(record)]
    if answer.number == 0:
        words.append("It is the start itself: nothing better has been found.")
    else:
        at = next((one.evaluation for one in run.points if one.step == answer.number), None)
        words.append(f"Found as step {answer.number}" + (f", evaluation {at}." if at is not None else "."))
    if not answer.stable:
        words.append("The model is unstable, and the device is not.")
    if run.comparison is not None:
        words.append(
            "It is the structure that was given as the truth."
            if run.comparison.same
            else "It is not the structure that was given as the truth."
        )
    others = [step for step in run.selection.equally_good if step != answer.number]
    if not run.explained:
        near = f"; {len(others)} {'others are' if len(others) > 1 else 'other is'} about equally near" if others else ""
        words.append(f"{not_explained(run)}{near}.")
    elif others:
        words.append(f"{len(others)} other structure{'s fit' if len(others) > 1 else ' fits'} equally well.")
    return " ".join(words)


def _sections(run: RunData) -> Iterator[Section]:
    if run.notes:
        yield "notes", "What is missing on this page", bullets(run.notes)
    yield "trajectory", "How the search went", trajectory_html(run)
    yield "diagram", "Block diagrams", diagrams_html(run)
    if run.comparison is not None:
        yield "comparison", "Comparison with the given truth", comparison_html(run.comparison)
    record = run.record
    if record is not None:
        yield "response", "Frequency response", response_html(run)
        yield "error", "Where the error lies", error_tables(record)
        yield "parameters", "Parameters", parameter_html(record)
        if record.identifiability:
            seen = bullets(record.identifiability) + twins_table(record)
            yield "visible", "What the data can and cannot see", seen
        if record.warnings:
            yield "warnings", "Warnings", bullets(record.warnings)
    yield "structures", "Which structures fit", structures_html(run)
    yield "lineage", "How it came about", lineage_html(run)
    yield "statistics", "What was proposed", statistics_html(run)
    if lessons := learning_html(run):
        yield "learning", "What the proposer learnt", lessons
    if run.answer is not None:
        yield "program", "Program", program(run.answer.program)
    elif run.start is not None and run.start.reason:
        yield "start", "Why the start has no fit", paragraph(run.start.reason)
