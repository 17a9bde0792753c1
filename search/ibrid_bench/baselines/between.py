"""A black box at an operating point that was not measured: nothing in it knows p and q, so
responses are carried over.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ibrid.measurement.sweeps.sweep import OperatingPoint


def nearest(points: Sequence[OperatingPoint], wanted: OperatingPoint) -> tuple[int, ...]:
    """Places of the operating points nearest in p and q; several when they are equally near."""
    distance = np.array([np.hypot(one.p - wanted.p, one.q - wanted.q) for one in points])
    return tuple(int(place) for place in np.flatnonzero(distance <= distance.min() + 1e-9))


def weights_between(points: Sequence[OperatingPoint], wanted: OperatingPoint) -> np.ndarray:
    """(N,) factors of the responses: the polynomial in p and q through all points of a rectangular
    grid, at `wanted`.

    Its degree in p is the number of different p minus one, in q likewise: with a single p the
    response is taken not to depend on it. Points that are no full grid: least squares of the
    smallest norm.
    """
    degrees = [range(len({getattr(one, axis) for one in points})) for axis in "pq"]
    powers = list(product(*degrees))
    at = np.array([[one.p**a * one.q**b for a, b in powers] for one in points])
    there = np.array([wanted.p**a * wanted.q**b for a, b in powers])
    return np.linalg.lstsq(at.T, there, rcond=None)[0]
