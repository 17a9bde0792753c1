"""Random grid-following inverters that are stable where they are swept: test material with known
insides.
"""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.gfl import GFLParameters, hertz
from ibrid.plants.reference import P1_Q03, ReferenceInverter
from ibrid.plants.sweeping import is_stable

Population = Literal["textbook", "wide"]

# log-uniform between the two values; per unit, rad/s, 1/s
_RANGES: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "textbook": {
            "L_F": (0.05, 0.2),
            "R_F": (0.002, 0.02),
            "C_F": (0.02, 0.1),
            "L_g": (0.05, 0.25),
            "R_g": (0.003, 0.03),
            "kP_pll": (20.0, 200.0),
            "kI_pll": (200.0, 8000.0),
            "kP_power": (0.005, 0.05),
            "kI_power": (5.0, 50.0),
            "kP_current": (0.15, 1.0),
            "kI_current": (4.0, 60.0),
        },
        "wide": {
            "L_F": (0.03, 0.4),
            "R_F": (0.001, 0.04),
            "C_F": (0.01, 0.2),
            "L_g": (0.03, 0.4),
            "R_g": (0.002, 0.08),
            "kP_pll": (5.0, 400.0),
            "kI_pll": (20.0, 20000.0),
            "kP_power": (0.001, 0.3),
            "kI_power": (1.0, 200.0),
            "kP_current": (0.05, 1.5),
            "kI_current": (0.5, 200.0),
        },
    }
)
_PLL_FILTER = (hertz(200), hertz(1000))


@takes_kinds
def random_stable(
    rng: np.random.Generator,
    *,
    population: Population = "textbook",
    pll_filter: bool = False,
    operating_points: Iterable[OperatingPoint] = P1_Q03,
    name: str = "random",
    margin: float = 1.0,
    attempts: int = 1000,
) -> ReferenceInverter:
    """Draw parameters log-uniformly until the inverter exists and is stable at every operating
    point.

    population : "textbook", about one decade per parameter, or "wide", where most draws are
    unstable.
    pll_filter : with a low-pass of 200 to 1000 Hz before the PLL.
    margin : poles lie left of -margin rad/s; nobody commissions a device that rings for seconds.
    Raises IbridError when none of `attempts` draws is stable.
    """
    points = tuple(operating_points)
    if population not in _RANGES:
        raise IbridError(f"population must be textbook or wide; found {population}.")
    for _ in range(attempts):
        values = {key: _log_uniform(rng, *bounds) for key, bounds in _RANGES[population].items()}
        cutoff = _log_uniform(rng, *_PLL_FILTER) if pll_filter else None
        plant = ReferenceInverter(
            name=name,
            parameters=GFLParameters(omega_c_pll=cutoff, **values),  # pyright: ignore[reportArgumentType]
            f0_hz=60.0,
            summary=f"random draw, {population} ranges" + (", filtered PLL" if pll_filter else ""),
            source=(
                f"Log-uniform draw from the {population} ranges, kept because every pole lies left "
                "of "
                f"-{margin:g} rad/s where it is swept."
            ),
            operating_points=points,
        )
        if all(is_stable(plant, op, margin=margin) for op in points):
            return plant
    raise IbridError(
        f"one of {attempts} random draws must be stable at {', '.join(op.name for op in points)}; "
        "none was, "
        "try operating points with less power."
    )


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())
