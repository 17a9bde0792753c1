"""What the live page of a run asks for: how far it is, every candidate with its parent, one candidate in full. Only reads."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.page import record_facts
from ibrid.report.template import page
from ibrid.structure.compare import difference
from ibrid.writing import inside
from ibrid_search.report.run_data import measured, settings_of
from ibrid_search.run_folder import ARCHIVE
from ibrid_search.step import line
from ibrid_search.store import Store
from ibrid_search.trajectory import trajectory

#: Candidates that a page draws; of more, the best and their ancestors.
DRAWN = 400


def run_state(folder: Path) -> dict[str, Any]:
    """How a run stands: `name`, `ending` ("" while it runs), `budget`, `best` (a step or None), `points` (evaluation, NRMSE, best
    NRMSE) and `nodes`, the evaluated candidates with their parents.

    Raises IbridError where there is no run.
    """
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        meta = dict(store.meta)
        steps = {step.number: step for step in store.steps()}
    points = trajectory(steps.values())
    known = {one.number for one in steps.values() if one.nrmse is not None}
    ranked = sorted(known, key=lambda number: steps[number].nrmse or 0.0)[:DRAWN]
    shown = dict.fromkeys(ranked)
    for number in ranked:
        shown |= {one.number: None for one in line(steps, number) if one.number in known}
    best = meta.get("best", "")
    return {
        "name": folder.resolve().name,
        "started": meta.get("started", ""),
        "ending": meta.get("ending", ""),
        "budget": settings_of(meta.get("settings", "")).get("budget"),
        "proposals": len(steps),
        "best": int(best) if best.isdigit() and int(best) in known else (ranked[0] if ranked else None),
        "points": [[one.evaluation, one.nrmse, one.best, one.step] for one in points],
        "nodes": [
            {
                "step": number,
                "parent": steps[number].edited if steps[number].edited in known else None,
                "nrmse": steps[number].nrmse,
                "stable": steps[number].stable,
                "note": steps[number].note[:200],
                "proposer": steps[number].proposer,
            }
            for number in sorted(shown)
        ],
    }


def step_page(folder: Path, number: int, kinds: Sequence[ModuleKind] = VOCABULARY) -> str:
    """A candidate as the page of a record, after what differs from its parent.

    Raises IbridError where there is no such step, or no fit of it.
    """
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        step = store.step(number)
        record = store.record(number, kinds)
        sweep, _ = measured(store.meta.get("data", ""))
        try:
            parent = None if step.edited is None else store.step(step.edited)
        except IbridError:
            parent = None
    changed = () if parent is None else difference(parent.program, step.program)
    facts = record_facts(record, sweep, "bode", title=f"Step {number}")
    return page("watched.html", facts | {"step": step, "changed": changed}, "ibrid_search")
