"""How a run stands, read from its archive while a search may be writing it: the facts of its live
page.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.playback_page import facts_of_record
from ibrid.report.pages.template import page
from ibrid.structure.comparison.compare import difference
from ibrid.writing import PlainData, inside
from ibrid_search.recursion.watcher import seconds_of
from ibrid_search.report.run_data import measured, settings_of, whole_number
from ibrid_search.run.database import is_being_written
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.stop_request import is_stop_requested
from ibrid_search.run.store import Store
from ibrid_search.run.trajectory import Point, trajectory
from ibrid_search.step import Step, line

#: Candidates that a page draws; of more, the best and their ancestors.
DRAWN = 400
#: What a summary keeps of the state of a run.
_SUMMED = (
    "name",
    "started",
    "ending",
    "running",
    "stopping",
    "budget",
    "evaluations",
    "seconds",
    "seconds_left",
)


def run_names(folders: Sequence[Path]) -> tuple[str, ...]:
    """Names of runs side by side: that of the folder, with those above it where two would be
    alike.
    """
    places = [folder.resolve() for folder in folders]
    names = []
    for place in places:
        others = [other for other in places if other != place]
        depth = 1
        while any(other.parts[-depth:] == place.parts[-depth:] for other in others):
            depth += 1
        names.append(str(Path(*place.parts[-depth:])))
    return tuple(names)


def run_state(folder: Path) -> PlainData:
    """How a run stands.

    `running` : a live process writes it; `stopping` : it was asked to stop; `ending` : "" before
    its end. `seconds` : that all its sittings took up to the last result; `seconds_left` : until
    the budget is spent at the pace so far, None where nothing is to come or the pace is not known.
    `best` : the step that the search holds for the best, or None; `lowest` : that of the least
    error, which may have more parameters or implausible values. `points` : (evaluation, NRMSE, best
    NRMSE, step). `nodes` : the evaluated candidates with their parents.

    Raises IbridError where there is no run.
    """
    archive = inside(folder, ARCHIVE)
    with Store.open(archive, read_only=True) as store:
        meta = dict(store.meta)
        steps = {step.number: step for step in store.steps()}
    running = is_being_written(archive)
    points = trajectory(steps.values())
    known = {step.number for step in steps.values() if step.nrmse is not None}
    ranked = sorted(known, key=lambda number: steps[number].nrmse or 0.0)[:DRAWN]
    shown = dict.fromkeys(ranked)
    for number in ranked:
        shown |= {step.number: None for step in line(steps, number) if step.number in known}
    best = whole_number(meta.get("best", ""))
    able = [point for point in points if point.stable and point.nrmse is not None]
    lowest = min(able, key=lambda point: (point.nrmse, point.step), default=None)
    leading = next((number for number in ranked if steps[number].stable), None)
    budget = settings_of(meta.get("settings", "")).get("budget")
    return {
        "name": folder.resolve().name,
        "started": meta.get("started", ""),
        "ending": meta.get("ending", ""),
        "running": running,
        "stopping": running and is_stop_requested(folder),
        "budget": budget,
        "proposals": len(steps),
        "evaluations": len(points),
        "seconds": seconds_of(meta),
        "seconds_left": _seconds_left(meta, points, budget) if running else None,
        "best": best if best in known else leading,
        "lowest": None if lowest is None else lowest.step,
        "points": [[one.evaluation, one.nrmse, one.best, one.step] for one in points],
        "nodes": [_node(steps, number, known) for number in sorted(shown)],
    }


def _node(steps: Mapping[int, Step], number: int, known: set[int]) -> PlainData:
    step = steps[number]
    return {
        "step": number,
        "parent": step.edited if step.edited in known else None,
        "nrmse": step.nrmse,
        "stable": step.stable,
        "note": step.note[:200],
        "proposer": step.proposer,
    }


def _seconds_left(meta: Mapping[str, str], points: Sequence[Point], budget: Any) -> float | None:
    """At most, since a search may end before its budget."""
    seconds = seconds_of(meta)
    if not isinstance(budget, int) or not points or not seconds or meta.get("ending"):
        return None
    return max(budget - len(points), 0) * seconds / len(points)


def run_summary(folder: Path) -> PlainData:
    """A run beside others: its state without the candidates, with `best_nrmse` and `curve`.

    `curve` : (evaluation, best NRMSE so far) where that falls. Raises IbridError where there is no
    run.
    """
    state = run_state(folder)
    curve: list[list[float]] = []
    for evaluation, _, best, _ in state["points"]:
        if best is not None and (not curve or best < curve[-1][1]):
            curve.append([evaluation, best])
    best_nrmse = curve[-1][1] if curve else None
    return {name: state[name] for name in _SUMMED} | {"best_nrmse": best_nrmse, "curve": curve}


def step_page(folder: Path, number: int, kinds: Sequence[ModuleKind] = VOCABULARY) -> str:
    """A candidate as the page of a record, after what differs from its parent.

    Raises IbridError where there is no such step, or no fit of it.
    """
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        step = store.step(number)
        record = store.record(number, kinds)
        sweep, _ = measured(store.meta.get("data", ""), read_sweep)
        events, _ = measured(store.meta.get("events", ""), read_events)
        try:
            parent = None if step.edited is None else store.step(step.edited)
        except IbridError:
            parent = None
    changed = () if parent is None else difference(parent.program, step.program)
    facts = record_facts(record, sweep, "bode", title=f"Step {number}")
    facts |= {"events": facts_of_record(record, events), "step": step, "changed": changed}
    return page("watched.html", facts, "ibrid_search")
