"""How many zeros a function of s has to the right of a line, from how often it turns around zero
along that line.
"""

from collections.abc import Callable
from math import pi

import numpy as np

_LARGEST_STEP = pi / 6
_ROUNDS = 40
_AUDIBLE = 2 * pi * 20e3
_HIGHEST = 3e6  # rad/s; beyond, the loops of a power converter are closed by nothing


def unstable_zeros(
    function: Callable[[np.ndarray], np.ndarray],
    poles: np.ndarray,
    line: float,
    longest_delay: float,
) -> int:
    """Zeros with Re s > line, by the argument principle: turns around zero, plus the poles there.

    function : s (K,) -> (K,), with f(conj s) = conj f(s), and near a constant for large s. poles :
    its poles, of which
    some may cancel. longest_delay : s; the first grid resolves its turns up to 20 kHz, and the line
    is refined until the argument changes by less than 30 degrees from point to point. Returns a
    large number when that does not end: a zero lies on the line.
    """
    turns = np.arange(0.0, _AUDIBLE, 0.3 / max(longest_delay, 1e-5))
    omega = np.unique(np.concatenate([turns, np.geomspace(1e-2, _HIGHEST, 600), _around(poles)]))
    value = function(line + 1j * omega)
    for _ in range(_ROUNDS):
        coarse = np.abs(np.angle(value[1:] / value[:-1])) > _LARGEST_STEP
        if not coarse.any():
            turned = (
                np.angle(value[1:] / value[:-1]).sum() / pi
            )  # the other half of the line turns as far
            # going up with the right half plane to the right: clockwise
            return int(np.count_nonzero(np.real(poles) > line)) - round(float(turned))
        middle = (omega[1:][coarse] + omega[:-1][coarse]) / 2
        order = np.argsort(np.concatenate([omega, middle]))
        value = np.concatenate([value, function(line + 1j * middle)])[order]
        omega = np.concatenate([omega, middle])[order]
    return 10**6


def _around(poles: np.ndarray) -> np.ndarray:
    """Frequencies that resolve the turn at each pole."""
    centre = np.abs(np.imag(poles))[:, None]
    width = np.abs(np.real(poles))[:, None] + 1e-3
    near = centre + width * np.array([-10, -3, -1, -0.3, 0, 0.3, 1, 3, 10])
    return near[(near > 0) & (near < _HIGHEST)]
