"""Structures that the measurements leave open: found by a search, fitted again when data come in,
and ruled out.

Law: a structure is ruled out where the Bayesian information criterion gives odds of
`EQUALLY_GOOD.odds` against it. The noise is that of the measurements; where even the best structure
leaves more, deviations are scaled up to what it leaves, so that an error that all share decides
nothing. What is implausible counts as further free parameters, as in a search. Of those that are
left the answer is the one with the fewest implausible values and missing control layers: a current
controller that cancels the filter's pole is input-output equivalent to none, and no measurement
says that it is there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log
from pathlib import Path

from ibrid.analysis.new_data.experiments import short_name
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.frozen import Frozen
from ibrid.gap.recordings.event_evaluation import fit_and_score
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.quantities import counted
from ibrid.measurement.sweeps.sweep import Sweep, measured_numbers
from ibrid.writing import inside
from ibrid_search.recursion.progress import Progress, Snapshot
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.run.trajectory import eligible
from ibrid_search.running import search
from ibrid_search.screening.plausibility import count_issues, find_impossible_values
from ibrid_search.screening.settings import SCREENING
from ibrid_search.selection.rivals import MOST

#: Odds beyond which a number says no more.
_CERTAIN = 1e6


@dataclass(frozen=True, eq=False)
class Structures(Frozen):
    """The answer and its rivals, by hash, and what was ruled out on the way, in sentences."""

    names: tuple[str, ...]
    records: tuple[Record, ...]
    ruled_out: tuple[str, ...] = ()

    @property
    def answer(self) -> Record:
        """Return the record of the best structure."""
        return self.records[0]


@dataclass(frozen=True, eq=False)
class _Fit:
    """A structure fitted to data.

    `information` : the Bayesian information criterion. `issues` : of plausibility.
    """

    name: str
    record: Record
    information: float
    issues: int


class _SearchProgress(Progress):
    """Progress of a search, told in words and a share."""

    def __init__(self, evaluations: int, said: Callable[[str, float], None]) -> None:
        super().__init__("silent")
        self._evaluations = evaluations
        self._said = said

    def update(self, snapshot: Snapshot) -> None:
        """Tell where the search stands."""
        done = f"{snapshot.evaluations} of {self._evaluations} evaluations at most"
        best = "" if snapshot.best is None else f", NRMSE {snapshot.best:.2g}"
        self._said(done + best, min(snapshot.evaluations / self._evaluations, 1.0))


def search_structures(
    sweep: Sweep,
    folder: Path,
    evaluations: int,
    seed: int,
    said: Callable[[str, float], None] = lambda words, share: None,
) -> Structures:
    """Search for the structure; a search that was stopped goes on.

    said : is told where it stands.

    Raises IbridError where no candidate is valid.
    """
    resume = (folder / "run.toml").exists()
    progress = _SearchProgress(evaluations, said)
    run = search(sweep, folder, budget=evaluations, seed=seed, resume=resume, progress=progress)
    if not run.finished:
        raise KeyboardInterrupt
    fits = {}
    shipped = {}
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        for step in filter(eligible, store.steps()):
            record = store.record(step.number)
            name = str(step.hash)
            if find_impossible_values(record):
                continue
            fits[name] = _fit_to_sweep(name, record, sweep)
            if step.proposer == "shipped":
                shipped[name] = record.diagram.name.removeprefix("build_")
    if not fits:
        raise IbridError(
            f"{folder}: no diagram is valid for these measurements; look at them with ibrid inspect"
        )
    left, lost = _weigh(list(fits.values()))
    ruled_out = [
        f"{shipped[fit.name]}: {fit.record.grade}, NRMSE {fit.record.nrmse:.2g}"
        for fit in lost
        if fit.name in shipped
    ]
    others = len(lost) - len(ruled_out)
    if others:
        sentence = f"odds of more than {EQUALLY_GOOD.odds:g} to 1 against each"
        ruled_out.append(f"{counted(others, 'other structure')} of the search: {sentence}")
    return _structures(left[: MOST + 1], ruled_out)


def refit_structures(
    known: Structures, sweep: Sweep, events: Events | None, said: Callable[[str], None]
) -> Structures:
    """Fit every open structure to all data, and leave out what they now rule out."""
    fits = []
    restless = []
    for name, record in zip(known.names, known.records, strict=True):
        said(short_name(name))
        try:
            fits.append(_fit_to_all(name, record, sweep, events))
        except IbridError as error:
            restless.append(f"{short_name(name)} has no rest in the data ({error})")
    if not fits:
        return known
    left, lost = _weigh(fits)
    best = min(left, key=lambda fit: fit.information)
    return _structures(left, [*restless, *(_odds_against(fit, best) for fit in lost)])


def names_gone(before: Sequence[str], after: Sequence[str]) -> tuple[str, ...]:
    """Return hashes that are in the first and no more in the second."""
    return tuple(short_name(name) for name in before if name not in after)


def _fit_to_all(name: str, record: Record, sweep: Sweep, events: Events | None) -> _Fit:
    """A structure fitted to all data; IbridError where it has no fit."""
    if events is not None:
        fitted, information = fit_and_score(
            build_event_problem(record.diagram, sweep, None, events, {})
        )
        return _Fit(name, fitted, information, _count_issues(fitted))
    fitted = evaluate(record.diagram, sweep)
    if fitted.nrmse is None:
        raise IbridError("; ".join(fitted.reasons) or "it has no fit")
    return _fit_to_sweep(name, fitted, sweep)


def _fit_to_sweep(name: str, record: Record, sweep: Sweep) -> _Fit:
    """A fit with its Bayesian information criterion."""
    count = measured_numbers(sweep.points)
    issues = _count_issues(record)
    free = record.free_parameters + SCREENING.implausibility_cost * issues
    if record.over_noise is not None:
        misfit = count * record.over_noise**2
    else:
        misfit = 2 * count * log(max(record.nrmse or 0.0, SCREENING.exact_error))
    return _Fit(name, record, misfit + log(count) * free, issues)


def _count_issues(record: Record) -> int:
    return count_issues(record.diagram, record, record.vocabulary).total


def _weigh(fits: Sequence[_Fit]) -> tuple[list[_Fit], list[_Fit]]:
    """Those that are left, the answer first, and those that are ruled out."""
    best = min(fits, key=lambda fit: fit.information)
    left = [fit for fit in fits if _log_odds(fit, best) <= log(EQUALLY_GOOD.odds)]
    lost = [fit for fit in fits if fit not in left]
    left.sort(key=lambda fit: (fit.issues, fit.information))
    lost.sort(key=lambda fit: fit.information)
    return left, lost


def _log_odds(fit: _Fit, best: _Fit) -> float:
    """Logarithm of the odds against a fit."""
    scale = max(best.record.over_noise or 1.0, 1.0) ** 2
    return (fit.information - best.information) / scale / 2


def _odds_against(fit: _Fit, best: _Fit) -> str:
    """The odds against a fit, a sentence."""
    against = _log_odds(fit, best)
    odds = f"more than {_CERTAIN:.0e}" if against > log(_CERTAIN) else f"{exp(against):.0f}"
    return f"{short_name(fit.name)}: odds of {odds} to 1 against it"


def _structures(fits: Sequence[_Fit], ruled_out: Sequence[str]) -> Structures:
    return Structures(
        tuple(fit.name for fit in fits), tuple(fit.record for fit in fits), tuple(ruled_out)
    )
