"""The network frequency perturbation plot: power over the frequency of the grid."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid.analysis.grids.power_jacobian import PowerJacobian


def draw_nfp(pair: Sequence[Any], jacobian: PowerJacobian) -> None:
    """Magnitude in dB and phase in degrees, on two axes."""
    magnitude, phase = pair
    with np.errstate(divide="ignore"):  # of zero nothing is drawn
        decibels = 20 * np.log10(np.abs(jacobian.nfp))
    magnitude.semilogx(jacobian.frequency, decibels)
    magnitude.set(title="NFP: dp over df", ylabel="dB")
    phase.semilogx(jacobian.frequency, np.degrees(np.unwrap(np.angle(jacobian.nfp))))
    phase.set(ylabel="degrees", xlabel="Hz")
