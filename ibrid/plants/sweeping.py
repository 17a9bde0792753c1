"""Sweeping a reference inverter: by linearisation or by injection, at given operating points and frequencies."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import Literal

import numpy as np

from ibrid.errors import IbridError, OperatingPointError, SweepError, near
from ibrid.measurement.noise import add_noise
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.linear_sweep import state_space
from ibrid.plants.published import PLANTS
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.time_sweep import injected_admittance

Method = Literal["linear", "time"]


def plant_named(name: str) -> ReferenceInverter:
    """The reference inverter called `name`; IbridError with near names otherwise."""
    if name not in PLANTS:
        raise IbridError(f"there is no reference inverter called {name}; {near(name, PLANTS)}")
    return PLANTS[name]


def sweep(
    plant: ReferenceInverter | str,
    operating_points: Sequence[OperatingPoint] | None,
    frequency: np.ndarray,
    *,
    method: Method = "linear",
    noise_db: float | None = None,
    repeats: int = 1,
    seed: int = 0,
    overrides: Mapping[str, float | str] = {},
) -> Sweep:
    """The admittance sweep that a measurement of this inverter would give.

    plant : a reference inverter or its name.
    operating_points : None: the plant's own.
    frequency : (K,) Hz, ascending.
    method : "linear": Y = C (j omega I - A)^-1 B + D; "time": sinusoids injected into the nonlinear simulation.
    noise_db, repeats, seed : noise of each of `repeats` runs, in dB below the norm of Y; None: clean.
    overrides : other parameter values, named as in the diagram ("plant.L_F") or as fields of its parameters ("L_F").

    Raises IbridError for an unknown name, OperatingPointError where the operating point does not exist or is unstable.
    """
    plant = (plant_named(plant) if isinstance(plant, str) else plant).with_overrides(overrides)
    if method not in ("linear", "time"):
        raise SweepError(f"method must be linear or time; found {method}.")
    if noise_db is None and repeats != 1:
        raise SweepError(
            f"repeats of a clean sweep are all alike; found repeats = {repeats} without noise_db, give noise_db too."
        )
    points = plant.operating_points if operating_points is None else tuple(operating_points)
    clean = Sweep(
        points=tuple(PointSweep(op, frequency, _admittance(plant, op, frequency, method)) for op in points),
        f0_hz=plant.f0_hz,
        power_node=plant.power_node,
        s_base_va=plant.s_base_va,
        v_base_v=plant.v_base_v,
        source=f"reference inverter {plant.name}, {method} sweep",
    )
    if noise_db is None:
        return clean
    noisy = add_noise(clean, noise_db, rng=np.random.default_rng(seed), repeats=repeats)
    return replace(noisy, notes=(*noisy.notes, f"noise {noise_db:g} dB, {repeats} runs, seed {seed}"))


def _admittance(plant: ReferenceInverter, op: OperatingPoint, frequency: np.ndarray, method: Method) -> np.ndarray:
    linear = state_space(plant, op)
    if not linear.is_stable:
        worst = max(linear.poles, key=lambda pole: pole.real)
        raise OperatingPointError(
            f"reference inverter {plant.name} must be stable to be swept; at {op.name} it has a pole at "
            f"{worst.real:.3g} + {abs(worst.imag):.3g}j rad/s, try another operating point or other values."
        )
    if method == "time":
        return injected_admittance(plant, op, frequency)
    return linear.admittance(frequency)


def frequency_grid(text: str) -> np.ndarray:
    """(N,) Hz from "A:B:N": N logarithmically spaced frequencies from A to B, both included.

    Raises SweepError when the text has another form or 0 < A < B, N >= 2 does not hold (A = B with N = 1 is allowed).
    """
    form = "frequencies are written A:B:N, for instance 5:5000:16 for 16 points from 5 to 5000 Hz"
    parts = text.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        raise SweepError(f"{form}; found {text!r}.") from None
    single = count == 1 and low == high
    if len(parts) != 3 or not (isfinite(low) and isfinite(high) and low > 0):
        raise SweepError(f"{form}, both positive; found {text!r}.")
    if not single and (low >= high or not 2 <= count <= 100_000):
        raise SweepError(f"{form}, with A below B and N from 2 to 100000; found {text!r}.")
    # twelve digits: 50, not 49.99999999999999, and the same on every machine
    return np.array([float(f"{hz:.12g}") for hz in np.geomspace(low, high, count)])


def operating_point(text: str) -> OperatingPoint:
    """An operating point from "p=1,q=0.3[,v=1]", per unit, delivered; its name is the text in a normal form.

    Raises OperatingPointError when the text has another form, p or q is missing, or v is not positive.
    """
    form = "an operating point is written p=1,q=0.3 or p=1,q=0.3,v=1.02"
    values: dict[str, float] = {}
    for part in text.split(","):
        key, mark, number = (piece.strip() for piece in part.partition("="))
        if not mark or key not in ("p", "q", "v") or key in values:
            raise OperatingPointError(f"{form}; found {text!r}.")
        try:
            values[key] = float(number)
        except ValueError:
            raise OperatingPointError(f"{form}; {number!r} is not a number.") from None
    if not {"p", "q"} <= set(values):
        raise OperatingPointError(f"{form}, with both p and q; found {text!r}.")
    if not all(isfinite(value) for value in values.values()) or values.get("v", 1.0) <= 0:
        raise OperatingPointError(f"{form}, with finite values and v above 0; found {text!r}.")
    v = values.get("v", 1.0)
    name = f"p={values['p']:g},q={values['q']:g}" + (f",v={v:g}" if v != 1.0 else "")
    return OperatingPoint(name, values["p"], values["q"], v)
