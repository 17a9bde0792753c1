"""One search of the comparison made, and the row that is kept of it."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Protocol

from ibrid_bench.learning.arms import ALL_ARMS, Case
from ibrid_bench.learning.course import course_of
from ibrid_bench.learning.drawn import FAMILIES, drawn_inverter
from ibrid_bench.learning.updates import told
from ibrid_bench.search.hidden import Hidden
from ibrid_bench.search.inverters import inverter
from ibrid_bench.search.scoring import Answer, Row
from ibrid_bench.search.trials import EXACT_MODE
from ibrid_policy.asking import NOTHING_NEW
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.updates import META, read_updates
from ibrid_policy.proposer import PolicyProposer
from ibrid_search.proposers.choose import Proposers
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.run.tally import Tally, counts
from ibrid_search.step import REFUSED, Step

from ibrid.structure.comparison.compare import compare
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program


class Ended(Answer, Protocol):
    """An answer that says why the search ended."""

    @property
    def ending(self) -> str: ...


#: `ibrid.search`, or what stands for it in tests: (sweep, folder, options) -> answer; the store of
#: the run is in the folder.
Search = Callable[..., Ended]


def measured(case: Case, folder: Path, search: Search) -> Row:
    """Make the search in `folder`, with one worker, on clean data; the row is plain data.

    `curve` : see `ibrid_bench.learning.course`. `proposed` : of each proposer how its proposals
    ended, see `endings`. `modules_f1`, `connections_f1` : of the answer against the truth, 0
    without an answer. `updates` : see `told`.
    `seconds` : of the wall clock, the page of the run included. Raises KeyboardInterrupt when the
    search was stopped by one.
    """
    arm, hidden = ALL_ARMS[case.arm], hidden_of(case)
    run = search(
        hidden.sweep,
        folder,
        start=textbook("naive"),
        proposer=Proposers(
            ((PolicyProposer(looked_at=0.0, informed=False), 1.0),) if arm.blind else arm.proposer,
            informed=arm.informed,
            learn=_settings(case) if arm.learns else False,
        ),
        budget=case.budget,
        seed=case.seed,
        **EXACT_MODE,
    )
    if (
        not run.finished
    ):  # a search lets the first Ctrl-C end it softly, but a part of one is no result
        raise KeyboardInterrupt
    with Store.open(folder / ARCHIVE, read_only=True) as store:
        steps, updates = list(store.steps()), read_updates(store.meta.get(META, ""))
    return {
        "key": case.key,
        "inverter": case.inverter,
        "arm": case.label,
        "seed": case.seed,
        "budget": case.budget,
        "weights": case.weights if arm.asks_policy else "",
        "curve": course_of(run.trajectory),
        "evaluations": run.evaluations,
        "ending": run.ending,
        **_overlap(run.answer_program, hidden),
        "proposed": endings(steps),
        "updates": told(updates),
        "seconds": round(run.seconds, 2),
    }


def hidden_of(case: Case) -> Hidden:
    """What is to be found; of a family the inverter of the seed."""
    if case.inverter in FAMILIES:
        return drawn_inverter(case.inverter, case.seed)
    return inverter(case.inverter)


def endings(steps: Iterable[Step]) -> dict[str, dict[str, int]]:
    """For each proposer how many of its proposals ended in which way
    (`ibrid_search.run.tally.Tally`).

    `answers` : those behind the proposals, several to a question where the policy is asked. Of
    these `known` led to a known structure or to the parent's, `refused` were no legal edit,
    `failed` had no fit, and the rest is `valid`.
    """
    by_name: dict[str, list[Step]] = {}
    for step in steps:
        if step.number > 0:
            by_name.setdefault(step.proposer, []).append(step)
    found = {}
    for name, own in sorted(by_name.items()):
        tally = Tally.of(counts(own))
        answers = sum(_number(step, "samples", 1) for step in own)
        known = sum(_number(step, "known", int(step.status in NOTHING_NEW)) for step in own)
        refused = sum(_number(step, "refused", int(step.status in REFUSED)) for step in own)
        valid = answers - known - refused - tally.failed
        found[name] = asdict(tally) | {
            "answers": answers,
            "known": known,
            "refused": refused,
            "valid": valid,
        }
    return found


def _number(step: Step, name: str, otherwise: int) -> int:
    value = step.usage.get(name)
    return value if isinstance(value, int) else otherwise


def _settings(case: Case) -> LearningSettings:
    rate = ALL_ARMS[case.arm].rate
    return case.settings if rate is None else replace(case.settings, rate=rate)


def _overlap(program: str, hidden: Hidden) -> dict[str, float]:
    truth = hidden.truth
    if truth is None or not program:
        return {"modules_f1": 0.0, "connections_f1": 0.0}
    found = compare(parse_program(program, "the answer"), truth)
    return {
        "modules_f1": round(found.modules.f1, 4),
        "connections_f1": round(found.connections.f1, 4),
    }
