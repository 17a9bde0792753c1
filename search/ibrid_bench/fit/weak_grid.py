"""Critical short-circuit ratios of identified models: poles, the Nyquist count and nonlinear
simulation beside each other.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from ibrid_bench.fit.behind_grid import critical_ratio
from ibrid_bench.fit.devices import FREQUENCY

from ibrid.analysis.grids.stability import stability
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import sweep
from ibrid.structure.diagrams.program import parse_program

#: Range in which critical ratios are searched, X/R of the grid, and how far a simulation goes on
#: both sides.
LOWEST, HIGHEST, XR, BESIDE = 1.0, 20.0, 10.0, 1.1


@dataclass(frozen=True)
class Critical:
    """One critical ratio; `simulated` is None where the simulation does not change within 10 % of
    it.
    """

    name: str
    op: str
    unstable: str
    frequency: float
    poles: float
    nyquist: float | None
    simulated: float | None


def critical_ratios(
    plants: Iterable[ReferenceInverter], *, duration: float = 3.0
) -> Iterator[Critical]:
    """Every critical ratio of every inverter at its two measured points, from the model fitted to
    its clean sweep.

    duration : of each simulated step response, s.
    """
    for plant in plants:
        record = evaluate(parse_program(plant.program), sweep(plant, None, FREQUENCY))
        answer = stability(record, [LOWEST, HIGHEST], xr=XR)
        for point, op in zip(answer.points, plant.operating_points, strict=True):
            for one in point.critical:
                reach = _reach(one.scr, [other.scr for other in point.critical])
                yield Critical(
                    plant.name,
                    point.op,
                    one.unstable,
                    one.mode.frequency,
                    one.scr,
                    one.scr_nyquist,
                    _simulated(plant, op, one.scr, reach, duration),
                )


def _reach(scr: float, ratios: Iterable[float]) -> float:
    """How far on both sides no other critical ratio lies, at most 10 %."""
    others = [max(other / scr, scr / other) for other in ratios if other != scr]
    return min([BESIDE, *(float(np.sqrt(one)) for one in others)])


def _simulated(
    plant: ReferenceInverter, op: OperatingPoint, scr: float, reach: float, duration: float
) -> float | None:
    width = min(0.005, (reach - 1) / 4)
    try:
        return critical_ratio(
            plant, op, scr / reach, scr * reach, xr=XR, width=width, duration=duration
        )
    except IbridError:
        return None
