"""report.html of a search: one self-contained page, during the run and after it, in the look of
`ibrid report`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from ibrid.analysis.models.loop_modes import loops_told
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagrams.block_diagram import readable
from ibrid.report.facts.bases import admittance_base
from ibrid.report.facts.left_over import left_by_record
from ibrid.report.facts.parameter_rows import parameter_groups, twin_rows
from ibrid.report.facts.verdict import graded, verdict
from ibrid.report.pages.playback_page import facts_of_record
from ibrid.report.pages.template import page
from ibrid.structure.comparison.compare import difference
from ibrid.writing import inside, write_whole
from ibrid_search.report.course import front_svg, learning_of, trajectory_svg
from ibrid_search.report.final_number import (
    explain_final_number,
    number_evaluations,
    rival_words,
)
from ibrid_search.report.fleet_summary import fleet_html, summary_of
from ibrid_search.report.models import drawn_models, front_rows, response_facts
from ibrid_search.report.run_data import RunData, read_run
from ibrid_search.report.statistics import statistics_facts
from ibrid_search.run.run_folder import ARCHIVE, PAGE
from ibrid_search.run.store import Store
from ibrid_search.step import EVALUATED, Status, Step, line

#: What the error is drawn against: a number of a step, and its name.
FRONTS = (("free", "free parameters"), ("order", "order"))


def write_run_page(
    run: Store | str | Path,
    path: str | Path | None = None,
    *,
    sweep: Sweep | None = None,
    vocabulary: Sequence[ModuleKind] | None = None,
) -> Path:
    """Write the page of a run or of a fleet, replacing the file atomically.

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
    if isinstance(run, Store) and "fleet" in run.meta:
        write_whole(target, fleet_html(summary_of(run)))
    else:
        write_whole(target, run_html(read_run(run, sweep, vocabulary)))
    return target


def run_html(run: RunData) -> str:
    """The page as text."""
    evaluations, budget, record = (
        run.points[-1].evaluation if run.points else 0,
        run.settings.get("budget"),
        run.record,
    )
    start = None if run.start is None else readable(run.start.program)
    budget = budget if isinstance(budget, int) else 0
    facts = {
        "run": run,
        "grade": None if record is None else graded(record),
        "record_verdict": "" if record is None else verdict(record),
        "tried": sum(step.status in EVALUATED for step in run.steps.values()),
        "evaluations": evaluations,
        "budget": budget,
        "over_budget": evaluations > budget,  # a smaller one was given when the run went on
        "evaluation_of": number_evaluations(run),
        "final": explain_final_number(run),
        "rivals": rival_words(run),
        "trajectory": trajectory_svg(run),
        "drawn": drawn_models(run),
        "responses": response_facts(run),
        "events": facts_of_record(record, run.events),
        "parameters": None if record is None else parameter_groups(record),
        "twins": () if record is None else twin_rows(record),
        "loops": () if record is None else loops_told(record),
        "left": None if record is None else left_by_record(record),
        "y_base": None if record is None else admittance_base(record),
        "fronts": [
            (name, front_svg(run, count, name)) for count, name in FRONTS if run.selection.front
        ],
        "front": front_rows(run),
        "more": dict.fromkeys(
            name for one in run.selection.front for name, x in one.more.items() if x is not None
        ),
        "origin": "the start" if start is None else start.name.removeprefix("build_"),
        "lineage": [] if run.answer is None else lineage(run.steps, run.answer.number),
        "learning": learning_of(run),
    }
    return page("run.html", facts | statistics_facts(run), "ibrid_search")


@dataclass(frozen=True)
class Ancestor:
    """A step on the way to a candidate.

    `difference` : lines of its program that differ from its parent's, " ", "+" or "-" first.
    `others` : the parent's other children that were fitted, the lowest error first.
    """

    step: Step
    difference: tuple[str, ...] = ()
    others: tuple[Step, ...] = ()


def lineage(steps: Mapping[int, Step], number: int) -> tuple[Ancestor, ...]:
    """The way from the start or shipped diagram to a step, oldest first; later where a parent is
    not among the steps.
    """
    path = line(steps, number)
    edited = (
        Ancestor(step, difference(parent.program, step.program), _others(steps, parent, step))
        for parent, step in pairwise(path)
    )
    return (*map(Ancestor, path[:1]), *edited)


def _others(steps: Mapping[int, Step], parent: Step, child: Step) -> tuple[Step, ...]:
    children = (
        step for step in steps.values() if step.edited == parent.number and step.status is Status.OK
    )
    siblings = (step for step in children if step.number != child.number)
    return tuple(sorted(siblings, key=lambda step: (step.nrmse is None, step.nrmse, step.number)))
