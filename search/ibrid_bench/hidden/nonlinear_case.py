"""A case whose device holds a dead zone or a limit, measured at several injection amplitudes in the
time domain.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import pi
from typing import Literal, get_args

import numpy as np
from ibrid_bench.hidden.bases import draw_base
from ibrid_bench.hidden.case import F0_HZ, Case
from ibrid_bench.hidden.device import admittance, stable
from ibrid_bench.hidden.equations import equations
from ibrid_bench.hidden.injection import injected
from ibrid_bench.hidden.nominal import nominal_values
from ibrid_bench.hidden.nonlinear import Nonlinearity
from ibrid_bench.hidden.parameters import Device
from ibrid_bench.hidden.points import HELD_OUT, operating_points
from ibrid_bench.hidden.program import block_diagram
from ibrid_bench.hidden.rest import at_rest

from ibrid.errors import IbridError, SweepError
from ibrid.measurement.sweeps.amplitudes import joined
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.sweeping import frequency_grid

NonlinearKind = Literal["pll_deadband", "current_limit", "nothing"]
NONLINEAR: tuple[NonlinearKind, ...] = get_args(NonlinearKind)
#: Structures that can be simulated in time: no delay, and a command that does not depend on itself.
_BASES = ("gfl", "gfl_exact", "gfl_pll_filter", "gfl_pll_filter_exact", "gfl_power_filter")
#: Injection amplitudes, per unit.
AMPLITUDES = (0.004, 0.016, 0.064)
#: Widths of a dead zone, per unit; a limit over the largest current of the operating points.
_WIDTHS, _LIMITS = (0.001, 0.004), (1.02, 1.05)
#: Relative change of the response at the lowest frequency from which on what is hidden shows.
_SHOWS = 0.03
_ATTEMPTS = 200


def draw_nonlinear_case(
    kind: NonlinearKind,
    seed: int,
    *,
    noise_db: float | None = None,
    sigma: Literal["known", "none"] = "known",
    amplitudes: Sequence[float] = AMPLITUDES,
    grid: str = "3:2000:10",
    points: int = 2,
    error: float = 0.15,
) -> Case:
    """Draw a case; the same arguments give the same case, and the same device at every level of
    noise.

    noise_db : dB below the norm of Y, of each sweep. amplitudes : per unit of the injected voltage,
    ascending.
    grid : of frequencies, A:B:N in Hz. error : of the nominal values, see `draw_case`.

    Raises IbridError for words it does not know and where no stable device is found.
    """
    if kind not in NONLINEAR:
        raise IbridError(f"a nonlinear case hides {', '.join(NONLINEAR)}; found {kind}.")
    if (
        not amplitudes
        or list(amplitudes) != sorted({float(one) for one in amplitudes})
        or amplitudes[0] <= 0
    ):
        raise IbridError(f"amplitudes must be positive and ascending; found {list(amplitudes)}.")
    rng = np.random.default_rng([seed, 1])
    ops = operating_points(points, rng)
    frequency = frequency_grid(grid)
    base, device, nonlinearity, levels = _simulated(kind, ops, frequency, amplitudes, rng)
    diagram = block_diagram(device, 2 * pi * F0_HZ)
    values, far_off = nominal_values(diagram.values, rng, error=error, gross=False)
    if noise_db is not None:
        noise = np.random.default_rng([seed, 2])
        levels = [
            add_noise(one, noise_db, rng=noise, record_sigma=sigma == "known") for one in levels
        ]
    held_out = PointSweep(
        HELD_OUT, frequency, admittance(device, HELD_OUT, frequency, 2 * pi * F0_HZ)
    )
    hidden = {
        "pll_deadband": {"width": nonlinearity.deadband},
        "current_limit": {"limit": nonlinearity.limit},
    }
    truth = {
        "schema": "ibrid.hidden/1",
        "kind": "nonlinear",
        "seed": seed,
        "effects": [{"id": kind, "change": "add", "parameters": hidden[kind]}]
        if kind in hidden
        else [],
        "verdicts": ["named", "located-unnamed"]
        if kind in hidden
        else ["no-gap", "parameters-only"],
        "amplitudes": list(amplitudes),
        "noise_db": noise_db,
        "sigma": "none" if noise_db is None else sigma,
        "base": base,
        "values": dict(diagram.values),
        "far_off": far_off,
        "device": {"program": diagram.text, "values": dict(diagram.values)},
    }
    return Case(
        joined(levels),
        diagram.text,
        values,
        replace(levels[0], points=(held_out,)),
        truth,
        device,
        device,
    )


def _simulated(
    kind: NonlinearKind,
    ops: Sequence[OperatingPoint],
    frequency: np.ndarray,
    amplitudes: Sequence[float],
    rng: np.random.Generator,
) -> tuple[str, Device, Nonlinearity, list[Sweep]]:
    """A structure, a device of it that is stable at all points, what it holds, and its sweeps.

    Drawn again where the motion is not steady, as a limit or a dead zone may leave a cycle of its
    own, and where what is hidden does not show.
    """
    for _ in range(_ATTEMPTS):
        base = _BASES[int(rng.integers(len(_BASES)))]
        device = draw_base(base, rng)
        still = replace(device, kP_pll=1e-3, kI_pll=1e-3)  # what a dead zone makes of a PLL
        if not all(
            stable(device, op) and stable(still, op, margin=-1.0) for op in (*ops, HELD_OUT)
        ):
            continue
        nonlinearity = _drawn(kind, device, ops, rng)
        # the largest amplitude at the lowest frequency first: it shows most, and is the first to be
        # unsteady
        try:
            if (
                kind != "nothing"
                and _change(device, nonlinearity, ops, frequency[:1], amplitudes[-1]) < _SHOWS
            ):
                continue
            levels = [
                _measured(device, nonlinearity, ops, frequency, one) for one in reversed(amplitudes)
            ]
        except SweepError:
            continue
        return base, device, nonlinearity, levels[::-1]
    raise IbridError(f"none of {_ATTEMPTS} devices is stable; choose another seed.")


def _drawn(
    kind: str, device: Device, ops: Sequence[OperatingPoint], rng: np.random.Generator
) -> Nonlinearity:
    """Thresholds; both are drawn whatever the kind, so that kinds share the draws."""
    low, high = _WIDTHS
    width, factor = float(low * (high / low) ** rng.random()), float(rng.uniform(*_LIMITS))
    if kind == "pll_deadband":
        return Nonlinearity(deadband=width)
    if kind == "current_limit":
        return Nonlinearity(limit=factor * max(_current(device, op) for op in ops))
    return Nonlinearity()


def _change(
    device: Device,
    nonlinearity: Nonlinearity,
    ops: Sequence[OperatingPoint],
    frequency: np.ndarray,
    amplitude: float,
) -> float:
    """Largest relative difference that it makes to the linearised device."""
    found = []
    for point in _measured(device, nonlinearity, ops, frequency, amplitude).points:
        linear = admittance(device, point.op, frequency, 2 * pi * F0_HZ)
        found.append(np.linalg.norm(point.admittance - linear) / np.linalg.norm(linear))
    return float(max(found))


def _current(device: Device, op: OperatingPoint) -> float:
    """Magnitude of the converter's current at rest, which the current loop makes equal to its
    reference.
    """
    x = at_rest(device, op, "capacitor", 2 * pi * F0_HZ).x
    names = equations(device.structure).states
    return float(np.hypot(x[names.index("i_ti_d")], x[names.index("i_ti_q")]))


def _measured(
    device: Device,
    nonlinearity: Nonlinearity,
    ops: Sequence[OperatingPoint],
    frequency: np.ndarray,
    amplitude: float,
) -> Sweep:
    points = tuple(
        PointSweep(
            op,
            frequency,
            injected(device, nonlinearity, op, frequency, amplitude, 2 * pi * F0_HZ),
            amplitude=np.full(len(frequency), amplitude),
        )
        for op in ops
    )
    return Sweep(
        points,
        f0_hz=F0_HZ,
        power_node="capacitor",
        source="hidden device, injected in the time domain",
    )
