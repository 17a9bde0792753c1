"""motulator's grid converters as devices that nobody here wrote: their sampled control, measured by
injected voltage.

motulator (M. Hinkkanen and others, Aalto University, MIT; `pip install 'ibrid[motulator]'`)
simulates a converter behind an L filter with its digital control, zero-order hold and one sample of
computing time included; its grid is ideal here. A sinusoid is added to one axis of the grid's
voltage; voltage and current in the frame of the voltage at rest are taken at its frequency, over
whole periods once the control has settled.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, pi, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.measurement.bridge import bridged
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.telling import Tell, silent

#: Injected voltage, per unit; seconds until the control has settled at rest, and with the
#: injection; least seconds measured.
AMPLITUDE, REST, SETTLE, LEAST = 0.01, 0.6, 0.1, 0.06
#: Steps of the solver in a sampling period, and in a period of the injection, at least.
STEPS, PER_PERIOD = 4, 40
CONTROLS = ("grid-following", "power-synchronization", "observer")


@dataclass(frozen=True)
class Converter:
    """Ratings and filter in SI units; the defaults are those of motulator's 12.5-kVA examples.

    `control` : of `CONTROLS`; the last two form the grid. `settings` : of its configuration, beside
    what the ratings say.
    """

    control: str = "grid-following"
    s_base_va: float = 12.5e3
    v_base_v: float = 400.0
    f0_hz: float = 50.0
    L: float = 10e-3
    R: float = 0.1
    u_dc: float = 650.0
    T_s: float = 100e-6
    settings: Mapping[str, float] = field(default_factory=dict)

    @property
    def peak(self) -> float:
        """Rated phase voltage, peak, V."""
        return sqrt(2 / 3) * self.v_base_v

    @property
    def current(self) -> float:
        """Rated current, peak, A."""
        return self.s_base_va / (1.5 * self.peak)


def motulator_sweep(
    converter: Converter,
    asked: Sequence[OperatingPoint],
    frequency: Sequence[float],
    out: str | Path,
    *,
    tell: Tell = silent,
) -> Sweep:
    """Measure a converter of motulator into a sweep; what was measured before an interruption is
    kept (`bridged`).

    asked : p, q, v as references; grid-forming control has its voltage's reference where q is 0.
    The sweep has what settles. Raises IbridError where motulator is not installed.
    """
    device = MotulatorDevice(converter)
    points = [device.settled(one) for one in asked]
    source = f"motulator, {converter.control} control, measured by injected voltage"
    return bridged(
        device,
        frequency,
        points,
        out,
        tell=tell,
        f0_hz=converter.f0_hz,
        power_node="pcc",
        s_base_va=converter.s_base_va,
        v_base_v=converter.v_base_v,
        sampling_hz=1 / converter.T_s,
        notes=(f"source: {source}",),
        source=source,
    )


@dataclass
class _Voltage:
    """The grid's voltage over its rated peak, in its own frame."""

    rest: float
    injected: complex = 0j
    frequency: float = 0.0
    event: Callable[[Any], Any] = lambda t: 1.0

    def at(self, t: float) -> complex:
        return self.event(t) * self.rest + self.injected * np.cos(2 * pi * self.frequency * t)


class MotulatorDevice:
    """A `Device` for `bridged`: each operating point is simulated until it rests, once, and every
    injection begins there.
    """

    def __init__(self, converter: Converter) -> None:
        try:
            from motulator.grid import control, model  # pyright: ignore[reportMissingImports]
            from motulator.grid.utils import ACFilterPars  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise IbridError(
                "motulator is not installed; install it with: pip install 'ibrid[motulator]'"
            ) from None
        if converter.control not in CONTROLS:
            raise IbridError(
                f"control must be one of {', '.join(CONTROLS)}; {near(converter.control, CONTROLS)}"
            )
        self.converter, self._control, self._model = converter, control, model
        self._filter = ACFilterPars(L_fc=converter.L, R_fc=converter.R)
        self._rested: dict[str, Any] = {}

    def settled(self, asked: OperatingPoint) -> OperatingPoint:
        """What p, q settle where they and v are asked for, per unit."""
        system = self._simulation(asked)
        system.simulate(t_stop=REST)
        times, voltage, current = self._waveforms(system, REST - LEAST)
        power = np.trapezoid(voltage * current.conj(), times) / (times[-1] - times[0])
        for part in system.mdl.subsystems:  # what was recorded is not needed any more
            for name in vars(getattr(part, "sol_states", SimpleNamespace())):
                setattr(part.sol_states, name, [])
        system.mdl.sol_t, system.mdl.converter.sol_q_cs, system.ctrl._data = (
            [],
            [],
            SimpleNamespace(),
        )
        self._rested[asked.name] = system
        return OperatingPoint(asked.name, float(power.real), float(power.imag), asked.v)

    def __call__(self, frequency: float, axis: str, point: OperatingPoint) -> np.ndarray:
        """The current (d, q) over the voltage injected on an axis."""
        if point.name not in self._rested:
            self.settled(point)
        system = copy.deepcopy(self._rested[point.name])
        grid = system.mdl.ac_source.grid
        grid.injected, grid.frequency = AMPLITUDE * (1.0 if axis == "d" else 1j), frequency
        periods = max(2, ceil(LEAST * frequency))
        end = REST + SETTLE + periods / frequency
        step = min(self.converter.T_s / STEPS, 1 / (PER_PERIOD * frequency))
        system.simulate(t_stop=end + self.converter.T_s, max_step=step)
        times, voltage, current = self._waveforms(system, REST + SETTLE)
        even = np.linspace(end - periods / frequency, end, periods * 4 * PER_PERIOD, endpoint=False)
        turn = np.exp(-2j * pi * frequency * even)
        parts = [
            np.mean(np.interp(even, times, part) * turn)
            for part in (np.real(current), np.imag(current))
        ]
        injected = np.real(voltage) if axis == "d" else np.imag(voltage)
        return np.array(parts) / np.mean(np.interp(even, times, injected) * turn)

    def answer(
        self, point: OperatingPoint, event: Callable[[Any], Any], seconds: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (s) from rest on, voltage and current d + j q, per unit, in the frame of the
        voltage at rest.

        event : time from rest on -> what the voltage at rest is multiplied by.
        """
        if point.name not in self._rested:
            self.settled(point)
        system = copy.deepcopy(self._rested[point.name])
        system.mdl.ac_source.grid.event = lambda t: event(t - REST)
        system.simulate(t_stop=REST + seconds, max_step=self.converter.T_s / STEPS)
        times, voltage, current = self._waveforms(system, REST)
        return times - REST, voltage, current

    def _waveforms(self, system: Any, begin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (s) from a little before `begin`, voltage and current out of the converter, per
        unit, in the grid's frame.
        """
        data = system.mdl.ac_filter.data
        times, first = np.unique(data.t, return_index=True)
        late = times >= begin - 2 * self.converter.T_s
        times, first = times[late], first[late]
        turn = np.exp(-2j * pi * self.converter.f0_hz * times)
        return (
            times,
            data.e_gs[first] * turn / self.converter.peak,
            data.i_cs[first] * turn / self.converter.current,
        )

    def _simulation(self, asked: OperatingPoint) -> Any:
        model, converter = self._model, self.converter
        grid = _Voltage(asked.v)

        class InjectedGrid(model.ThreePhaseVoltageSource):
            """The grid with what is injected."""

            def __init__(self) -> None:
                super().__init__(w_g=2 * pi * converter.f0_hz, abs_e_g=converter.peak)
                self.grid = grid

            def generate_space_vector(self, t: Any, exp_j_theta_g: Any) -> Any:
                return converter.peak * self.grid.at(t) * exp_j_theta_g

        class CopiedFilter(type(model.ACFilter(self._filter))):  # type: ignore[misc]
            """The L filter, which can be copied."""

            def __new__(cls, *_: Any) -> Any:
                return object.__new__(cls)

        bridge = model.VoltageSourceConverter(u_dc=converter.u_dc)
        system = model.GridConverterSystem(
            converter=bridge, ac_filter=CopiedFilter(self._filter), ac_source=InjectedGrid()
        )
        return model.Simulation(system, self._controller(asked))

    def _controller(self, asked: OperatingPoint) -> Any:
        converter, control = self.converter, self._control
        given = {
            "nom_u": converter.peak,
            "nom_w": 2 * pi * converter.f0_hz,
            "max_i": 2 * converter.current,
            "T_s": converter.T_s,
            **converter.settings,
        }
        power, reactive, v = (
            asked.p * converter.s_base_va,
            asked.q * converter.s_base_va,
            converter.peak,
        )
        if converter.control == "grid-following":
            ctrl = control.GridFollowingControl(
                control.GridFollowingControlCfg(L=converter.L, **given)
            )
            ctrl.ref.q_g = lambda t: reactive
        elif converter.control == "power-synchronization":
            ctrl = control.PowerSynchronizationControl(
                control.PowerSynchronizationControlCfg(R=converter.R, **given)
            )
        else:
            ctrl = control.ObserverBasedGridFormingControl(
                control.ObserverBasedGridFormingControlCfg(L=converter.L, R=converter.R, **given)
            )
        ctrl.ref.p_g, ctrl.ref.v_c = lambda t: power, lambda t: v
        return ctrl
