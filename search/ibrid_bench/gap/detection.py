"""The detection limit: whether the data can tell the device from the model at all, whoever looks at
them.

The given model is refitted to the device's response without noise, weighed by the noise of the
measurement and held to the nominal values: its cost less that of the truth is the noncentrality of
any test that could find the effect.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import pi

from ibrid_bench.hidden.case import F0_HZ, Case
from ibrid_bench.hidden.declaration import HiddenEffect
from ibrid_bench.hidden.effects import HIDDEN
from ibrid_bench.hidden.program import BlockDiagram, block_diagram

from ibrid.errors import IbridError
from ibrid.gap.refitting.noise import LEAST_UNKNOWN, Noise
from ibrid.gap.refitting.prior import build_prior
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.measurement.sweeps.noise import of_norm
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

#: Least difference of cost, chi2 and prior together.
LIMIT = 30.0
#: A block to be removed can often be driven to where it does nothing: then three standard
#: deviations of its nominal value.
REMOVAL_LIMIT = 9.0
#: Random starts of each of the two refits, and their spread in standard deviations of the prior.
DRAWS, SPREADS = 40, (0.7, 1.5)
#: Starts from true and nominal values, the drawn ones, and the best of the first refit once more.
STARTS = 2 * (2 + DRAWS) + 1


@dataclass(frozen=True)
class Visibility:
    """How far the best refit without an effect is from the truth.

    `gain` : in cost. `penalty_terms` : the prior's part of it.
    """

    gain: float
    pull: float
    change: str

    @property
    def above(self) -> bool:
        """Whether the effect is above the detection limit."""
        return self.gain >= LIMIT or (self.change == "remove" and self.pull >= REMOVAL_LIMIT)


def visibilities(case: Case, clean: Case, seed: int) -> tuple[Visibility, ...]:
    """One for each hidden effect: the model is given all the others. () where nothing is hidden
    that has a name.

    clean : the same case without noise.
    """
    hidden = case.truth["effects"]
    named = [one for one in HIDDEN if any(one.key == _key(told) for told in hidden)]
    if not hidden:
        return ()
    exact = _with_sigma_of(case.sweep, clean.sweep)
    device = case.truth["device"]
    true_names = set(case.truth["values"] if device is None else device["values"])
    found = []
    for told in hidden:
        others = [one for one in named if one.key != _key(told)]
        model = _model_with(case, others)
        found.append(_visibility(model, told["change"], exact, case, true_names, seed))
    return tuple(found)


def _key(told: dict[str, str]) -> str:
    return f"{told['id']}:{told['change']}:{told['variant']}"


def _model_with(case: Case, effects: Sequence[HiddenEffect]) -> BlockDiagram:
    """The given model, some of what it misses repaired, with its true values; without them where
    that is no diagram.
    """
    touched: Iterable[str] = {
        name for one in effects for name in one.touches if hasattr(case.model, name)
    }
    repaired = replace(case.model, **{name: getattr(case.device, name) for name in touched})
    try:
        return block_diagram(repaired, 2 * pi * F0_HZ)
    except IbridError:
        return BlockDiagram(case.program, case.truth["values"])


def _with_sigma_of(noisy: Sweep, clean: Sweep) -> Sweep:
    """Clean admittances with the sigma of a measurement, where it has none with what design allows
    the least.
    """
    points = []
    for seen, true in zip(noisy.points, clean.points, strict=True):
        sigma = of_norm(true, LEAST_UNKNOWN) if seen.sigma is None else seen.sigma
        points.append(replace(true, sigma=sigma))
    return replace(clean, points=tuple(points))


def _visibility(
    model: BlockDiagram, change: str, exact: Sweep, case: Case, true_names: set[str], seed: int
) -> Visibility:
    diagram = parse_program(model.text)
    wiring = wire(diagram, VOCABULARY)
    believed = {name: value for name, value in case.values.items() if name in model.values}
    prior = build_prior(believed, wiring, parameter_table(wiring, "exact"))
    refitter = SweepFitter(
        Noise(exact, True, "the noise of the measurement"), VOCABULARY, prior, seed
    )
    best = None
    starts = [dict(model.values), believed]
    for spread in SPREADS:
        found = refitter.fit(diagram, starts, draws=DRAWS, spread=spread)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
            starts = [best.values, *starts]
    if best is None:
        return Visibility(float("inf"), 0.0, change)
    true = {name: value for name, value in model.values.items() if name in true_names}
    expected = refitter.evaluate_values(
        diagram, true
    ).penalty  # what the device lacks stands at its nominal value
    return Visibility(best.cost - expected, best.penalty - expected, change)
