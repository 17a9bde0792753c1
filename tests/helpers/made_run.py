"""Runs of a search put together by hand from real records: what their pages must cope with."""

import dataclasses
from collections.abc import Collection, Mapping
from pathlib import Path

from fitted import evaluated
from ibrid_search.run.store import Store
from ibrid_search.step import Status, Step

from ibrid.evaluation.record import Record
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.library import textbook_text

#: Step -> (parent, textbook program, note); the last is the benchmark's own structure.
WAY = {
    0: (None, "naive", ""),
    1: (0, "gfl_exact", "an LCL filter, a PLL and both loops"),
    3: (1, "gfl", "decoupling by the nominal frequency"),
    5: (3, "gfl_pll_filter_exact", "low-pass before the PLL"),
}
REFUSALS = {2: Status.NO_MATCH, 4: Status.DUPLICATE, 6: Status.ILLEGAL}
SETTINGS = '[run]\nbudget = 40\nvocabulary = "extended"\nproposer = "rules"\n'


def meta(**more: str) -> dict[str, str]:
    """The texts of a run on the benchmark."""
    data = Path(benchmarks()["paper_like"]).read_text(encoding="utf-8")
    return {
        "data": data,
        "start": textbook_text("naive"),
        "truth": "",
        "settings": SETTINGS,
        **more,
    }


def put(store: Store, step: Step, record: Record | None = None) -> None:
    """Write a step, and its evaluation where there is one."""
    if record is None:
        store.propose(step)
        return
    store.propose(dataclasses.replace(step, status=Status.PENDING))
    store.conclude(step.number, status=step.status, reason=step.reason, record=record)


def a_run(
    folder: Path,
    texts: Mapping[str, str],
    until: int = 99,
    shipped: Collection[int] = (),
    **changes: str,
) -> Path:
    """A folder with a run of a few steps; `changes` : fields of every proposal; `shipped` : steps
    that are further starts.
    """
    folder.mkdir()
    with Store.create(folder / "archive.sqlite", texts) as store:
        for number in sorted({*WAY, *REFUSALS}):
            if number > until:
                break
            if number in REFUSALS:
                given = {
                    "note": "an edit",
                    "reason": f"reason {number}",
                    "proposer": "random",
                    **changes,
                }
                put(
                    store,
                    Step(number, parent=0, status=REFUSALS[number], program="def b(g):\n", **given),
                )
                continue
            parent, name, note = WAY[number]
            given = {
                "note": note,
                "proposer": "rules",
                "scale": "module",
                **(changes if number else {}),
            }
            given |= (
                {"proposer": "shipped", "note": f"the shipped diagram {name}"}
                if number in shipped
                else {}
            )
            step = Step(
                number,
                parent=parent,
                status=Status.OK,
                program=textbook_text(name),
                island=number,
                **given,
            )
            put(store, step, evaluated(name, restarts=0))
    return folder
