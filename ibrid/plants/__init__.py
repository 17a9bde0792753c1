"""Nonlinear reference inverters with known insides, and the sweeps that measure them."""

from ibrid.plants.benchmarks import benchmarks
from ibrid.plants.gfl import GFLParameters
from ibrid.plants.published import PLANTS
from ibrid.plants.random_plants import random_stable
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import (
    Linearisation,
    frequency_grid,
    is_stable,
    operating_point,
    plant_named,
    state_space,
    sweep,
)

__all__ = [
    "PLANTS",
    "GFLParameters",
    "Linearisation",
    "ReferenceInverter",
    "benchmarks",
    "frequency_grid",
    "is_stable",
    "operating_point",
    "plant_named",
    "random_stable",
    "state_space",
    "sweep",
]
