"""Structures that the data cannot tell from the answer: which measurement would, and which of them
explains records of events.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import exp, inf, log
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.analysis.models.prediction import predict
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record, read_record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.gap.recordings.event_evaluation import fit_and_score
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules.kind import ModuleKind
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.study import Study
from ibrid.writing import inside
from ibrid_search.run.run_folder import ARCHIVE, BEST_RECORD, SELECTION
from ibrid_search.run.selection import read_selection
from ibrid_search.run.store import Store
from ibrid_search.run.trajectory import eligible
from ibrid_search.screening.selection_criterion import NoiseFloor
from ibrid_search.step import Step

#: Rivals that are compared with the answer.
MOST = 3
#: Where they are compared: p and q, per unit, at the voltage of the data.
P, Q = (0.0, 0.5, 1.0), (-0.3, 0.0, 0.3)
#: Least difference, relative to Y, that a measurement without stated noise would see.
VISIBLE = 1e-2


@dataclass(frozen=True)
class Rival:
    """`odds` : of the answer against it, by the evidence of the data.

    `op`, `hz`, `differs` : where a sweep would tell them apart best, and by how much of Y there;
    None where neither can be predicted.
    """

    step: int
    free: int
    odds: float
    note: str
    op: str | None = None
    hz: float | None = None
    differs: float | None = None

    def words(self, noise: float) -> str:
        """A sentence; `noise` : of a measurement, relative to Y."""
        said = f"step {self.step} ({self.note or 'no note'}) explains the data as well"
        if self.differs is None:
            return f"{said}; what would tell them apart is not known"
        if self.differs < noise:
            where = f"from p = {P[0]:g} to {P[-1]:g} and q = {Q[0]:g} to {Q[-1]:g}"
            return (
                f"{said}, and no sweep {where} tells them apart: they differ by at most "
                f"{self.differs:.1g} of Y"
            )
        return (
            f"{said}; a sweep at {self.op} would tell: at {self.hz:.3g} Hz they differ by "
            f"{100 * self.differs:.2g} % of Y"
        )


def rivals_of(
    answer: Step, steps: Sequence[Step], record_of: Callable[[int], Record], floor: NoiseFloor
) -> tuple[Rival, ...]:
    """Other structures with no more free numbers, within `EQUALLY_GOOD.odds` of the answer; the
    likeliest first, `MOST` at most.

    Law: with known noise the odds are exp(difference of the Bayesian information criterion / 2);
    else a rival fits exactly.
    """
    own, most = _information(record_of(answer.number), floor), int(answer.free or 0)
    rivals: list[Rival] = []
    for step in steps:
        if (
            step.number != answer.number
            and eligible(step)
            and step.hash != answer.hash
            and int(step.free or 0) <= most
        ):
            difference = _information(record_of(step.number), floor) - own
            if difference <= 2 * log(EQUALLY_GOOD.odds):
                rivals.append(
                    Rival(step.number, int(step.free or 0), exp(difference / 2), step.note)
                )
    likely = sorted(rivals, key=lambda rival: (rival.odds, rival.free, rival.step))[:MOST]
    return tuple(
        told_apart(rival, record_of(answer.number), record_of(rival.step)) for rival in likely
    )


def _information(record: Record, floor: NoiseFloor) -> float:
    """-2 ln(evidence), up to what all structures share; without a known noise 0 for an exact fit
    and infinite for others.
    """
    if not floor.known:
        return 0.0 if floor.explains(floor.error_of(record)) else inf
    misfit = inf if record.over_noise is None else record.over_noise
    return floor.number_count * misfit**2 + log(floor.number_count) * record.free_parameters


def told_apart(rival: Rival, answer: Record, other: Record) -> Rival:
    """With the operating point and frequency at which two fitted models differ most."""
    low, high = answer.settings["frequency_hz"]
    frequency = np.geomspace(low, high, 60)
    points: Mapping[str, Any] = answer.settings["operating_points"]
    v = float(np.mean([point["v"] for point in points.values()]))
    best = rival
    for p, q in product(P, Q):
        op = OperatingPoint(f"p = {p:g}, q = {q:g}", p, q, v)
        try:
            with np.errstate(
                divide="ignore", invalid="ignore"
            ):  # a device that answers nothing has nothing to compare
                one, two = (predict(record, op, frequency).admittance for record in (answer, other))
                apart = np.linalg.norm(one - two, axis=(1, 2)) / np.linalg.norm(one, axis=(1, 2))
        except IbridError:
            continue
        k = int(np.argmax(apart))
        if np.isfinite(apart[k]) and (best.differs is None or apart[k] > best.differs):
            best = replace(rival, op=op.name, hz=float(frequency[k]), differs=float(apart[k]))
    return best


@dataclass(frozen=True, eq=False)
class Judged:
    """A step fitted to sweep and records together.

    `bic` : the Bayesian information criterion on all of them.
    """

    step: int
    record: Record
    bic: float

    def against(self, best: "Judged") -> dict[str, object]:
        """What selection.json says of it. odds : of the best against it."""
        odds = exp(min((self.bic - best.bic) / 2, 300.0))
        return {
            "step": self.step,
            "odds": odds,
            "nrmse_by_record": dict(self.record.nrmse_by_record),
        }


def judged_by_events(
    steps: Iterable[int],
    record_of: Callable[[int], Record],
    allowed: Callable[[Record], bool],
    events: Events,
    study: Study,
) -> list[Judged]:
    """The steps that have a rest in every record and are allowed as they are fitted to both, the
    most likely first.
    """
    judged = []
    for step in steps:
        try:
            record, bic = fit_and_score(
                build_event_problem(record_of(step), study, None, events, {})
            )
        except IbridError:
            continue
        if allowed(record):
            judged.append(Judged(step, record, bic))
    return sorted(judged, key=lambda one: one.bic)


def rivals_beside(judged: Sequence[Judged], steps: Sequence[Step]) -> tuple[Rival, ...]:
    """Those that sweep and records together leave within `EQUALLY_GOOD.odds` of the best, and the
    sweep that would tell.
    """
    best, *others = judged
    close = [one for one in others if one.bic - best.bic <= 2 * log(EQUALLY_GOOD.odds)][:MOST]
    return tuple(
        told_apart(
            Rival(
                one.step,
                one.record.free_parameters,
                exp((one.bic - best.bic) / 2),
                steps[one.step].note,
            ),
            best.record,
            one.record,
        )
        for one in close
    )


def open_structures(
    folder: Path, vocabulary: str | Sequence[ModuleKind] = "extended"
) -> tuple[tuple[str, ...], tuple[Record, ...]]:
    """Hashes of structures and their records, the answer first; of a run that was stopped its best
    so far. IbridError where there is neither or the run is damaged.
    """
    selection = read_selection(inside(folder, SELECTION))
    if selection is None or selection.answer is None:
        best = inside(folder, BEST_RECORD)
        if not best.is_file():
            raise IbridError(
                f"{folder}: the search has no answer yet; finish it with ibrid search ... --resume"
            )
        record = read_record(best, vocabulary)
        return (structure_hash(record.diagram, record.vocabulary),), (record,)
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        steps = [store.step(number) for number in (selection.answer, *selection.rival_steps)]
        records = tuple(store.record(step.number, vocabulary) for step in steps)
    return tuple(str(step.hash) for step in steps), records
