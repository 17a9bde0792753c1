"""The library of the sparse regression: what a grid-following controller can add to the admittance
behind the capacitor.

Every term is a matrix times a scalar of s. The matrices carry the operating point: how a change of
voltage enters through the power that is calculated from it (linear in the current at rest) and
through the angle of the PLL that follows it.
"""

import numpy as np
from ibrid_bench.baselines.series_filter import I, J, SeriesFilter, rotating

from ibrid.measurement.sweeps.sweep import OperatingPoint

#: Corners of the lags: four a decade, 1 Hz to 10 kHz.
CORNERS = np.geomspace(1.0, 1e4, 17)
#: Per-unit filters 1 / (R + L S), by every pair of these.
RESISTANCES, INDUCTANCES = (0.03, 0.1, 0.3, 1.0), (0.03, 0.1, 0.3)
#: Resonances of LC filters: Hz, and damping ratios.
RESONANCES, DAMPINGS = np.geomspace(200.0, 5000.0, 15), (0.01, 0.1)


def control_terms(
    frequency: np.ndarray, omega_0: float, op: OperatingPoint, filter_: SeriesFilter
) -> dict[str, np.ndarray]:
    """Name -> (K, 2, 2) complex, in the grid frame, per unit.

    Law, in the frame of the capacitor voltage e: I and J (current control, feedforward,
    decoupling); S and J S (power control: dp and dq of de at the current i_g at rest); P and J P
    (PLL: the current i_ti at rest turned by the angle of e); each times a constant and lags.
    Besides, filters 1/(R + L S), resonances, and a capacitor.
    """
    e, i_g, i_ti = filter_.at_rest(op)
    size = float(np.hypot(*e))
    to_grid = np.array([[e[0], -e[1]], [e[1], e[0]]]) / size
    grid_current, converter_current = to_grid.T @ i_g, to_grid.T @ i_ti
    power = np.array([[grid_current[0], grid_current[1]], [grid_current[1], -grid_current[0]]])
    angle = np.outer(J @ converter_current, [0.0, 1.0]) / size
    matrices = {"I": I, "J": J, "S": power, "J S": J @ power, "P": angle, "J P": J @ angle}
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    scalars = {"1": np.ones_like(s)} | {
        f"lag {hertz:.3g} Hz": 1 / (1 + s / (2 * np.pi * hertz)) for hertz in CORNERS
    }
    terms = {
        f"{one} {other}": scalar[:, None, None] * (to_grid @ matrix @ to_grid.T)
        for one, matrix in matrices.items()
        for other, scalar in scalars.items()
    }
    return {
        name: term
        for name, term in (terms | _filters(frequency, omega_0)).items()
        if np.abs(term).max() > 0
    }


def _filters(frequency: np.ndarray, omega_0: float) -> dict[str, np.ndarray]:
    """Parts of the plant; they commute with J."""
    inductor = rotating(frequency, omega_0)
    terms = {"capacitor": inductor}
    for resistance in RESISTANCES:
        for inductance in INDUCTANCES:
            name = f"1/({resistance:g} + {inductance:g} S)"
            terms[name] = np.linalg.inv(resistance * I + inductance * inductor)
            terms[f"J {name}"] = J @ terms[name]
    for hertz in RESONANCES:
        for damping in DAMPINGS:
            ratio = inductor * omega_0 / (2 * np.pi * hertz)
            peak = np.linalg.inv(ratio @ ratio + 2 * damping * ratio + I)
            terms[f"resonance {hertz:.0f} Hz {damping:g}"] = peak
            terms[f"slope of resonance {hertz:.0f} Hz {damping:g}"] = ratio @ peak
    return terms
