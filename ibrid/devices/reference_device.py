"""A reference inverter as a device: its nonlinear model, integrated between the samples of the
terminal voltage.

Between two samples the voltage, seen in the frame that turns at the nominal frequency, is the cubic
spline through them.
"""

from functools import cached_property

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ibrid.devices.device_file import DeviceFile
from ibrid.devices.frame import to_dq, to_phases, turning
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.equilibrium import AtRest
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import plant_named
from ibrid.playback.player import FINE, fastest, run
from ibrid.playback.recording import set_point_place
from ibrid.playback.tape import Tape, tape_of

#: Samples before a block that its spline goes through too, so that no block has an edge of its own.
BEFORE = 8


class ReferenceDevice:
    """A reference inverter that starts at rest at p_ref and q_ref, where its own power node counts
    them.
    """

    def __init__(self, device: DeviceFile) -> None:
        self._device = device
        self._references = {"p_ref": 0.0, "q_ref": 0.0}
        self._v = 1.0
        self._x = np.empty(0)
        self._r = np.empty(0)
        self._r_before = self._r
        self._past = np.zeros((0, 2))

    @cached_property
    def plant(self) -> ReferenceInverter:
        """With the parameters of the device file."""
        return plant_named(self._device.file).with_overrides(dict(self._device.parameters))

    def put(self, reference: str, value: float) -> None:
        """Set p_ref or q_ref, per unit; the states stay where they are."""
        if reference not in self._references:
            raise IbridError(f"a reference inverter takes p_ref and q_ref; found {reference}")
        self._references[reference] = value
        if len(self._x):
            self._r = self._rest().r
            self._r_before = self._r

    def move(self, reference: str, value: float) -> None:
        """Move the set point of p or q alone, along a line until the next sample.

        Raises IbridError where the inverter is told no such power.
        """
        p, q = self._references.values()
        asked = OperatingPoint("asked", p, q, self._v)
        rest = self._rest()
        place = set_point_place(self.plant, asked, rest.r, reference)
        self._r = self._r.copy()
        self._r[place] = value

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        """(n, 3) currents at the voltages (n, 3), per unit, at the samples from `first` on."""
        turn = turning(first, len(v), self._device.step_s, self._device.f0_hz)
        voltage = to_dq(v, turn)
        now = np.column_stack([np.real(voltage), np.imag(voltage)])
        if not len(self._x):
            self._v = float(abs(voltage[0]))
            rest = self._rest()
            self._x = rest.x
            self._r = rest.r
            self._r_before = rest.r
        past = len(self._past)
        samples = np.vstack([self._past, now])
        time = np.arange(first - past, first + len(v)) * self._device.step_s
        return to_phases(self._integrated(time, samples, past), turn)

    def _integrated(self, time: np.ndarray, samples: np.ndarray, past: int) -> np.ndarray:
        """(n,) d + j q of the current at the samples after the first `past`; the states go on to
        the last of them.
        """
        spline = CubicSpline(time, samples)
        begin = max(past - 1, 0)
        moved = np.zeros((len(spline.c), len(time) - 1 - begin, len(self._r)))
        if past:
            moved[-1, 0] = self._r_before - self._r
            moved[-2, 0] = (self._r - self._r_before) / (time[past] - time[begin])
        self._r_before = self._r
        outside = np.concatenate([spline.c[:, begin:], moved], axis=2)
        pieces = CubicSpline.construct_fast(outside, time[begin:])
        rate = self._fastest / FINE
        start = np.ascontiguousarray(self._x[:, None])
        constants = np.ascontiguousarray(self._r[:, None])
        current, left, x = run(self._tape, pieces, start, start, constants, rate)
        if np.isfinite(left[0]):
            raise IbridError(
                f"{self.plant.name} does not hold out: its current leaves at {left[0]:.4g} s"
            )
        self._x = x[:, 0]
        self._past = samples[-BEFORE:]
        answered = current[1 if past else 0 :, :, 0]
        return answered[:, 0] + 1j * answered[:, 1]

    def _rest(self) -> AtRest:
        p, q = self._references.values()
        return self.plant.at_rest(OperatingPoint("asked", p, q, self._v))

    @cached_property
    def _tape(self) -> Tape:
        """Rates and current; what is kept from step to step are the states, so that the next block
        can go on from them.
        """
        dynamics = self.plant.dynamics
        x, kept = (ca.SX.sym(name, len(dynamics.states)) for name in ("x", "kept"))
        outside = ca.SX.sym("outside", 3 + dynamics.set_points)
        r = ca.SX.sym("r", dynamics.set_points)
        v_DQ = outside[1:3]
        rates = dynamics.f(x, v_DQ, r + outside[3:])
        results = [rates, dynamics.g(x, v_DQ), x, ca.SX(0, 1)]
        return tape_of([x, kept, outside, r], results, constant=[3])

    @cached_property
    def _fastest(self) -> float:
        """Of the modes at rest, 1/s."""
        return fastest(self.plant.dynamics.jacobian(self._x, [self._v, 0.0], self._r)[0])
