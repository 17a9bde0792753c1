"""Structures that the measurements leave open: found by a search, fitted again when data come in,
and ruled out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path

from ibrid.analysis.new_data.experiments import short_name
from ibrid.errors import IbridError
from ibrid.evaluation.adequacy import EQUALLY_GOOD
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.gap.recordings.event_question import asked
from ibrid.gap.recordings.joint_fit import weighed_by_events
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid_search.running import search
from ibrid_search.selection.rivals import open_structures


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


def searched(sweep: Sweep, folder: Path, evaluations: int, seed: int) -> Structures:
    """Search for the structure; a search that was stopped goes on.

    Raises IbridError where no candidate is valid.
    """
    resume = (folder / "run.toml").exists()
    run = search(sweep, folder, budget=evaluations, seed=seed, resume=resume, progress="silent")
    if not run.finished:
        raise KeyboardInterrupt
    if run.best is None:
        raise IbridError(
            f"{folder}: no diagram is valid for these measurements; look at them with ibrid inspect"
        )
    return Structures(*open_structures(folder))


def refitted(
    known: Structures, sweep: Sweep, events: Events | None, said: Callable[[str], None]
) -> Structures:
    """Fit every open structure to all data, and leave out what they now exclude.

    Law: a structure is excluded where the Bayesian information criterion gives odds of
    `EQUALLY_GOOD.odds` against it; deviations are scaled up to the misfit of the best one, so that
    an error that all share decides nothing.
    """
    fits: list[tuple[float, str, Record]] = []
    lost = []
    for name, record in zip(known.names, known.records, strict=True):
        said(short_name(name))
        try:
            fitted, information = _fitted(record, sweep, events)
        except IbridError as error:
            lost.append(f"{short_name(name)} has no rest in the data ({error})")
            continue
        fits.append((information, name, fitted))
    if not fits:
        return known
    fits.sort(key=lambda one: one[0])
    scale = max(fits[0][2].over_noise or 1.0, 1.0) ** 2
    kept = []
    for information, name, record in fits:
        against = (information - fits[0][0]) / scale / 2
        if against > log(EQUALLY_GOOD.odds):
            odds = "more than 1e6" if against > log(1e6) else f"{2.718281828**against:.0f}"
            lost.append(f"{short_name(name)}: odds of {odds} to 1 against it")
        else:
            kept.append((name, record))
    return Structures(
        tuple(name for name, _ in kept), tuple(record for _, record in kept), tuple(lost)
    )


def _fitted(record: Record, sweep: Sweep, events: Events | None) -> tuple[Record, float]:
    """A structure fitted to all data, and its Bayesian information criterion."""
    if events is not None:
        return weighed_by_events(asked(record.diagram, sweep, None, events, {}))
    fitted = evaluate(record.diagram, sweep)
    if fitted.nrmse is None:
        raise IbridError("; ".join(fitted.reasons) or "it has no fit")
    count = sum(8 * len(point.frequency) for point in sweep.points)
    misfit = (
        count * fitted.over_noise**2
        if fitted.over_noise is not None
        else 2 * count * log(max(fitted.nrmse, 1e-12))
    )
    return fitted, misfit + log(count) * fitted.free_parameters


def differences(before: Sequence[str], after: Sequence[str]) -> tuple[str, ...]:
    """Hashes that are in the first and no more in the second."""
    return tuple(short_name(name) for name in before if name not in after)
