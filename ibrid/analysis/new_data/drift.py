"""Whether new data are of the device that a record describes, and what changed since: nothing,
parameters, structure, labels.

The record knows its parameters as x = x_0 + B z, z standard normal (its covariance and its boxes).
Of the new data, whitened by their noise,

    T(A) = min over z, d of |r(x_0 + B z + E_A d)|^2 + |z|^2

is what is left when the parameters in A have changed freely. T() - T({j}) is chi2 with one degree
of freedom where nothing changed; parameters enter one by one, the best first, while they lower T
beyond what P of them would by chance in a part `FALSE_ALARM` of cases (likelihood ratio,
Bonferroni), a pair where neither of it does alone; those without which the rest does as well leave
again. In a plant of several devices each parameter may change in one of them or in all; where that
does not suffice, the gap is asked of the devices one by one, each as the others, unchanged, leave
it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import chdtri

from ibrid.analysis.several_devices.collector import Collector
from ibrid.analysis.several_devices.freed_fits import FreedFit, FreedFits, PlantFits, fits_of
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.gap.results.gap import Gap
from ibrid.gap.workflow import find_gap
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.network.outside import PORT
from ibrid.writing import PlainData

#: Probability that an unchanged device is said to have changed.
FALSE_ALARM = 0.01
#: Most parameters that change together, candidates of a pair, and devices of which the gap is
#: asked.
MOST, PAIRED, ASKED = 3, 8, 3
#: Size of a usual change of a parameter, of its logarithm: one of d counts (d / USUAL)^2 beside T.
USUAL = 0.3
#: What a gap says, whose tolerances are wide, of data that the record's own values do not answer.
_VERDICTS = {"no-gap": "parameters", "parameters-only": "parameters", "data-convention": "labels"}


@dataclass(frozen=True)
class Change:
    """A parameter that changed, by as much as `after` differs from the record's `before`.

    `interval` : 95 %, of `after`. `z` : signed root of the likelihood ratio; None from the gap.
    `alike` : others whose change would explain the data as well.
    """

    parameter: str
    before: float
    after: float
    interval: tuple[float, float] | None
    z: float | None
    alike: tuple[str, ...] = ()

    def plain(self) -> PlainData:
        """For JSON."""
        interval = None if self.interval is None else list(self.interval)
        return {**vars(self), "interval": interval, "alike": list(self.alike)}


@dataclass(frozen=True)
class Drift:
    """`verdict` : same, parameters, structure or labels.

    `p_value` : of the model with the changes. `gap` : asked where they do not suffice. `device` :
    of a plant, the one that differs, None where it is left open.
    """

    verdict: str
    sentence: str
    changed: tuple[Change, ...]
    p_value: float
    noise: str
    gap: Gap | None = None
    device: str | None = None

    def plain(self) -> PlainData:
        """For JSON."""
        return {
            "schema": "ibrid.drift/1",
            "verdict": self.verdict,
            "sentence": self.sentence,
            "changed": [one.plain() for one in self.changed],
            "p_value": self.p_value,
            "noise": self.noise,
            "false_alarm": FALSE_ALARM,
            "effects": [one.id for one in self.gap.effects] if self.gap else [],
            "device": self.device,
        }


def drift(record: Record, data: Sweep | Events, collector: Collector | None = None) -> Drift:
    """What changed between the data of a record and new ones: a sweep, at the same operating points
    or others, or records of events.

    collector : where the data are a sweep at the PCC of a plant, the network behind it, whose
    devices are as the record. Raises IbridError where the record has no covariance, another nominal
    frequency, or a model without an answer there.
    """
    if (record.settings.get("parameters"), record.settings.get("equilibrium")) != (
        "shared",
        "exact",
    ):
        raise IbridError(
            "drift needs one set of values: fit the record with --parameters shared --equilibrium "
            "exact"
        )
    if abs(float(record.settings["f0_hz"]) - data.f0_hz) > 1e-6:
        raise IbridError(
            f"the record is of {record.settings['f0_hz']:g} Hz, the data of {data.f0_hz:g} Hz; "
            "take data of one"
        )
    fits = fits_of(record, data, collector)
    added, fit = _changed(fits)
    p_value, gap = fits.p_value(fit.cost), None
    if not fits.adequate(fit.cost) or len(added) >= MOST:
        if isinstance(fits, PlantFits):
            return _in_one_device(fits, record, p_value)
        swept, events = (data, None) if isinstance(data, Sweep) else (None, data)
        gap = find_gap(record, swept, events=events, progress="silent")
        verdict = _VERDICTS.get(gap.verdict, "structure")
        changed = tuple(_moved(gap)) if verdict == "parameters" else ()
        if verdict != "parameters" or changed or not added:
            return Drift(verdict, gap.sentence, changed, p_value, fits.source, gap)
    changed = tuple(_change(fits, k, added, fit) for k in range(len(added)))
    named = {
        name.split(".")[0]
        for one in changed
        for name in (one.parameter, *one.alike)
        if f".{PORT}." not in name
    }
    device = named.pop() if collector and len(named) == 1 and "all" not in named else None
    return Drift(
        "parameters" if changed else "same",
        _sentence(changed, fits, gap),
        changed,
        p_value,
        fits.source,
        gap,
        device,
    )


def _in_one_device(fits: PlantFits, record: Record, p_value: float) -> Drift:
    """What the gap says of the first device that it explains, those first whose freest fits leave
    least; else of the nearest.
    """
    plant = fits.plant
    own = [
        range(*(plant.parameters * (k + side) for side in (1, 2)))
        for k in range(len(plant.collector.devices))
    ]
    nearest = sorted(range(len(own)), key=lambda device: fits.fit(tuple(own[device])).cost)[:ASKED]
    asked: list[tuple[Gap, int]] = []
    for device in nearest:
        asked.append((find_gap(record, fits.behind(device), progress="silent"), device))
        if explained := asked[-1][0].verdict in ("named", *_VERDICTS):
            break
    gap, device = asked[-1 if explained else 0]
    name, verdict = plant.collector.devices[device].name, _VERDICTS.get(gap.verdict, "structure")
    changed = _moved(gap) if verdict == "parameters" else ()
    changed = tuple(replace(one, parameter=f"{name}.{one.parameter}") for one in changed)
    said = (
        f"{name} differs: "
        if explained
        else f"No device alone explains what differs; {name} is nearest: "
    )
    return Drift(
        verdict,
        said + gap.sentence,
        changed,
        p_value,
        fits.source,
        gap,
        name if explained else None,
    )


def _changed(fits: FreedFits) -> tuple[list[int], FreedFit]:
    """Places of the parameters that changed, in the order in which they entered, and the fit with
    them.
    """
    added: list[int] = []
    last = fits.fit(())
    level = float(chdtri(1, FALSE_ALARM / max(fits.size, 1)))
    while len(added) < min(MOST, fits.size):
        tried = {j: fits.fit((*added, j), last) for j in fits.likely(added, last)}
        least = min((one.cost for one in tried.values()), default=last.cost)
        if last.cost - least > level:
            worth = {
                j: one.cost + (fits.move(j, float(one.w[-1])) / USUAL) ** 2
                for j, one in tried.items()
            }
            best = min(worth, key=worth.__getitem__)
            added, last = [*added, best], tried[best]
            continue
        if added or fits.adequate(last.cost):
            break
        few = sorted(tried, key=lambda j: tried[j].cost)[:PAIRED]
        pairs = {pair: fits.fit(pair, last) for pair in combinations(few, 2)}
        pair = min(pairs, key=lambda one: pairs[one].cost, default=())
        if not pair or last.cost - pairs[pair].cost <= chdtri(2, FALSE_ALARM / len(pairs)):
            break
        added, last = list(pair), pairs[pair]
    for j in tuple(added[:-1]):
        rest = [one for one in added if one != j]
        without = fits.fit(rest)
        if without.cost - last.cost < level:
            added, last = rest, without
    return added, last


def _change(fits: FreedFits, k: int, added: Sequence[int], last: FreedFit) -> Change:
    """The parameter that entered k-th, in the fit with all."""
    j = added[k]
    place = fits.root.shape[1] + k
    deviation = float(np.sqrt(max(np.linalg.pinv(last.curvature)[place, place], 0.0)))
    moved = [last.w[place] + side * 1.96 * deviation for side in (0.0, -1.0, 1.0)]
    ends = [fits.x0 + one * np.eye(fits.size)[j] for one in (0.0, *moved)]
    before, after, low, high = (float(fits.coordinates.to_theta(x)[j]) for x in ends)
    others = tuple(one for one in added if one != j)
    without = fits.fit(others)
    ratio = max(without.cost - last.cost, 0.0)
    alike = [
        fits.names[other]
        for other in fits.likely(others, without)
        if other != j and fits.fit((*others, other)).cost < last.cost + EQUALLY_GOOD.chi2
    ]
    z = float(np.copysign(np.sqrt(ratio), after - before))
    return Change(fits.names[j], before, after, (min(low, high), max(low, high)), z, tuple(alike))


def _moved(gap: Gap) -> Iterator[Change]:
    """What the gap's refit moved beyond its tolerance, in place of a test of single parameters."""
    for one in gap.moved:
        if abs(one.sigmas) > 1:
            ends = None if one.low is None or one.high is None else (one.low, one.high)
            yield Change(one.name, one.nominal, one.refitted, ends, None)


def _sentence(changed: Sequence[Change], fits: FreedFits, gap: Gap | None) -> str:
    if not changed:
        return (
            f"The same within the noise ({fits.source}): no parameter changed "
            f"(an unchanged device is called changed in {100 * FALSE_ALARM:g} % of cases)."
        )
    words = []
    for change in changed:
        factor = f", {change.after / change.before:.3g} times as much" if change.before else ""
        interval = (
            ""
            if change.interval is None
            else f" ({change.interval[0]:.4g} to {change.interval[1]:.4g})"
        )
        alike = (
            f", or {' or '.join(change.alike)}, which the data cannot tell from it"
            if change.alike
            else ""
        )
        words.append(
            f"{change.parameter} went from {change.before:.4g} to "
            f"{change.after:.4g}{interval}{factor}{alike}"
        )
    rest = (
        "nothing else changed"
        if gap is None
        else "what else differs is within the tolerances of a gap"
    )
    return f"{'; '.join(words)}; {rest}."
