"""A diagram with its limits, played: from parameter values and a record's voltage to the current that it would deliver."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial, hypot
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_continuous_are

from ibrid.assembly.averaged import equations
from ibrid.assembly.rest import Rest, rest
from ibrid.assembly.signals_at_rest import sources_of
from ibrid.errors import IbridError
from ibrid.measurement.events import EventRecord
from ibrid.measurement.sweep import OperatingPoint
from ibrid.modules.vocabulary import Vocabulary
from ibrid.playback.limits import ORDER, Limit, Limited, memory_at_rest
from ibrid.playback.machine_code import LANES
from ibrid.playback.places import Places, places_of
from ibrid.playback.port import drawn_at_pcc, port_at_rest, require_port_alone, solved, through_port
from ibrid.playback.steps import ORDER_8, Rule, simulate
from ibrid.playback.tape import Tape, tape_of
from ibrid.structure.diagram import Diagram
from ibrid.structure.parameters import Parameter, parameter_table
from ibrid.structure.wiring import wire

#: Phase error (rad) of the rational form of a delay up to this frequency (Hz): far below what a record shows; of a prediction,
#: which leads to a valley and no further.
PHASE, LED_PHASE, HIGHEST = 1e-6, 1e-2, 2000.0
#: Step times the fastest mode: of an answer, and of a fit, where it need not be better than any noise.
FINE, COARSE = 0.7, 1.5
#: Steps between two samples at most: of an answer, and of a fit, where what is stiffer is no candidate.
MOST_PARTS, FEW_PARTS = 400, 16
#: How often a step is divided in which something switches: of an answer; of a fit near the noise, whose cost else jumps (an
#: integrator that stands, 60 dB: by 5,000 of 6,000), or to what jumps or is followed from step to step; of others, predictions.
DEEP, DEEPER, SHALLOW = 5, 4, 2
#: States at rest that are kept: limits and predictions change none.
KEPT = 200
#: Parameter sets; the same with their rests; and values of the orders of delays for which the laws are kept.
Sets = Sequence[Mapping[str, float]]
_Lanes = Sequence[tuple[Rest, Mapping[str, float]]]
_Orders = tuple[tuple[str, int], ...]


@dataclass(frozen=True, eq=False)
class Played:
    """`current` : (N, 2) terminal current, d and q, NaN from where the simulation left. `left` : s, None if it did not.
    `memory` : what the limits keep, at the end."""

    current: np.ndarray
    left: float | None
    memory: np.ndarray


class Player:
    """Plays one diagram with its limits; the laws are joined once."""

    def __init__(
        self, diagram: Diagram, kinds: Vocabulary, limits: Sequence[Limit] = (), omega_0: float = 120 * np.pi
    ) -> None:
        require_port_alone(diagram.outside)
        if diagram.outside.inside:  # p and q at rest are read at the PCC
            diagram = diagram.behind(replace(diagram.outside, inside=False))
        self.wiring, self.omega_0 = wire(diagram, kinds), omega_0
        self.table = parameter_table(self.wiring, "exact")
        self.limits = tuple(sorted(limits, key=lambda one: ORDER.index(one.id)))
        self.places = places_of(diagram, kinds) if self.limits else None
        self._laws: dict[tuple[_Orders, bool], _Laws] = {}
        self._rests: dict[tuple[OperatingPoint, float, _Orders, tuple[float, ...]], Rest] = {}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Free numbers of the diagram, then of its limits."""
        own = [
            Parameter(f"{one.id}.{name}", box.low, box.high, box.typical, box.unit, box.meaning, ())
            for one in self.limits
            for name, box in one.parameters.items()
        ]
        return (*self.table.free, *own)

    def play(
        self, record: EventRecord, values: Sets, *, step: float = FINE, led: bool = False, rule: Rule = ORDER_8,
        sharp: bool = True,
    ) -> list[Played]:  # fmt: skip
        """The answer to a record's voltage at each of several parameter sets, which take the same steps.

        led : the states are corrected by the measured current, as a Kalman filter at rest does it, so that an error does not
        ring on: what is left is that of a prediction. sharp : False far from any noise, where kinks need no dividing of steps.

        Raises OperatingPointError, IbridError or DiagramError where no set has a rest; one without a rest beside others is NaN.
        """
        orders = self._orders(values[0], LED_PHASE if led else PHASE)
        rests: list[Rest | None] = []
        for one in values:
            try:
                rests.append(self._rest(one, record, orders))
            except IbridError as refused:
                rests.append(None)
                if len(rests) == len(values) and all(one is None for one in rests):
                    raise refused
        laws = self._laws_at(orders, next(one for one in rests if one is not None), led)
        kept = [(k, one) for k, one in enumerate(rests) if one is not None]
        current, left, memory = laws.run(record, [(at, values[k]) for k, at in kept], step, rule, sharp)
        nothing = np.full((len(record.time), 2), np.nan)
        played = [Played(nothing, float(record.time[0]), np.full(len(memory), np.nan))] * len(values)
        for lane, (k, _) in enumerate(kept):
            gone = None if np.isnan(left[lane]) else float(left[lane])
            played[k] = Played(current[:, :, lane], gone, memory[:, lane])
        return played

    def _orders(self, values: Mapping[str, float], phase: float = PHASE) -> _Orders:
        return tuple(
            (name, rational_order(float(self.table.value(name, kind.delay, values)), phase))
            for name, kind in self.wiring.kinds.items()
            if kind.delay is not None
        )

    def _rest(self, values: Mapping[str, float], record: EventRecord, orders: _Orders) -> Rest:
        op = record.rest
        own = {one.name: values[one.name] for one in self.table.free}
        key = op, record.offset_hz, orders, tuple(own.values())
        if key not in self._rests:
            if len(self._rests) >= KEPT:
                self._rests.clear()
            self._rests[key] = rest(
                self.wiring,
                self.table,
                own,
                op.pqv,
                power_node="pcc",
                omega_0=self.omega_0,
                pade_orders=dict(orders),
                deviation=2 * np.pi * record.offset_hz,
            )
        return self._rests[key]

    def _laws_at(self, orders: _Orders, at: Rest, led: bool) -> "_Laws":
        if (orders, led) not in self._laws:
            self._laws[orders, led] = _Laws(self, at, led)
        return self._laws[orders, led]


def rational_order(delay: float, phase: float = PHASE) -> int:
    """Smallest order of a Pade form whose phase error at `HIGHEST` is below `phase`.

    Law: the error is (omega T)^(2n+1) (n!)^2 / ((2n)! (2n+1)!) to first order.
    """
    angle = 2 * np.pi * HIGHEST * delay
    for order in range(1, 12):
        error = angle ** (2 * order + 1) * factorial(order) ** 2 / (factorial(2 * order) * factorial(2 * order + 1))
        if error < phase:
            return order
    return 12


def run(
    tape: Tape,
    signals: CubicSpline,
    x: np.ndarray,
    memory: np.ndarray,
    constants: np.ndarray,
    rate: float,
    most: int = MOST_PARTS,
    deepest: int = DEEP,
    rule: Rule = ORDER_8,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Current (N, 2, S) along signals (t -> (k,), the voltage first), the time (S,) at which each left, NaN if not, and the
    memory (k, S) at the end.

    tape : rates, current, next memory and switches of (states, memory, (time since, signals), constants). x (n, S),
    memory (k, S), constants (q, S), contiguous. rate : steps per second at least, `most` between two samples. deepest : as of
    `simulate`, as is the rule of the steps.
    """
    time, lanes = signals.x, x.shape[1]
    x, memory, constants = (np.pad(one, ((0, 0), (0, -lanes % LANES)), "edge") for one in (x, memory, constants))
    parts = np.clip(np.ceil(np.diff(time) * rate), 1, most).astype(np.int64)
    code, spline = (tape.once, tape.each, tape.rows, tape.results), np.ascontiguousarray(signals.c)
    current, left, memory = simulate(code, x, memory, constants, spline, time, parts, deepest, rule)
    return current[:, :, :lanes], left[:lanes], memory[:, :lanes]


def fastest(jacobian: Any) -> float:
    """Largest magnitude of an eigenvalue of a state matrix, 1/s."""
    return float(np.abs(np.linalg.eigvals(np.nan_to_num(np.array(jacobian)))).max(initial=1.0))


def correction(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(n, 2) gain K of x' = A x + B v + K (i - C x): a Kalman filter's where voltage and current are equally unsure; 0 where
    there is none."""
    try:
        covariance = solve_continuous_are(a.T, c.T, b @ b.T + 1e-6 * np.eye(len(a)), np.eye(2))
    except (np.linalg.LinAlgError, ValueError):
        return np.zeros((len(a), 2))
    return covariance @ c.T


class _Laws:
    """The joined laws as a tape; all numbers of the modules are its constants."""

    def __init__(self, player: Player, at: Rest, led: bool) -> None:
        self.player, self.names, self.led = player, [module.name for module in at.modules], led
        self.references = list(at.references)
        symbols, self._pairs = {}, {}
        constants: list[ca.SX] = []
        for module in at.modules:
            own = {}
            for name, value in module.arguments.items():
                width = 2 if isinstance(value, tuple) else 1
                symbol = ca.SX.sym(f"{module.name}.{name}", width)
                constants.append(symbol)
                own[name] = (symbol[0], symbol[1]) if width == 2 else symbol
            symbols[module.name] = own
        x = {module.name: ca.SX.sym(module.name, len(module.states)) for module in at.modules}
        v, r = ca.SX.sym("v", 2), ca.SX.sym("r", len(self.references))
        since = ca.SX.sym("since")
        numbers = {f"{one.id}.{name}": ca.SX.sym(name) for one in player.limits for name in one.parameters}
        lacking_r, lacking_u, e_rest = ca.SX.sym("lacking_r", 2), ca.SX.sym("lacking_u", 2), ca.SX.sym("e_rest")
        memory = ca.SX.sym("memory", len(memory_at_rest(player.limits, 0.0, 1.0, 0.0)))
        shaping = None
        if player.limits and player.places is not None:
            shaping = Limited(player.limits, player.places, numbers, lacking_r, lacking_u, e_rest, memory, since)
        joined = equations(
            player.wiring, at.modules, x, v, {one: r[k] for k, one in enumerate(self.references)}, symbols, shaping
        )
        states, further, self._through = ca.vertcat(*x.values()), ca.SX(0, 1), None
        results = [joined.rates, joined.current]
        results += [
            joined.resolved(shaping.next if shaping else []),
            joined.resolved(shaping.switches if shaping else []),
        ]
        if joined.loops:
            results = [ca.substitute(one, joined.unknown, solved(joined.residual, joined.unknown)) for one in results]
        if player.wiring.outside.elements:
            self._through = through_port(player.wiring.outside, results, states, v, player.omega_0)
            results, v = self._through.results, self._through.v
            states, further = ca.vertcat(states, self._through.states), self._through.constants
        constant = ca.vertcat(*constants, r, *numbers.values(), lacking_r, lacking_u, e_rest, further)
        outside = ca.vertcat(since, v)
        arguments = [states, outside, memory, constant]
        self._linear = ca.Function("linear", arguments, [ca.jacobian(a, b) for a in results[:2] for b in (states, v)])
        if led:
            measured, gain = ca.SX.sym("measured", 2), ca.SX.sym("gain", states.numel(), 2)
            results[0] = results[0] + gain @ (measured - results[1])
            constant, outside = ca.vertcat(constant, ca.vec(gain)), ca.vertcat(outside, measured)
        self.tape: Tape = tape_of([states, memory, outside, constant], results, constant=[3])

    def run(
        self, record: EventRecord, lanes: _Lanes, step: float, rule: Rule, sharp: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Current (N, 2, S), the time (S,) at which each left, and the memory (k, S) at the end."""
        numbers = [self._numbers(at, values, record) for at, values in lanes]
        x, memory, constants = (
            np.ascontiguousarray(np.array(one, dtype=float).T) for one in zip(*numbers, strict=True)
        )
        linear = self._linear(x[:, 0], [0.0, record.rest.v, 0.0], memory[:, 0], constants[:, 0])
        a, b, c, _ = (np.nan_to_num(np.array(one)) for one in linear)
        signals, drawn = record.voltage, self._drawn(record, [at for at, _ in lanes])
        if self.led:
            gain = correction(a, b, c)
            a = a - gain @ c
            constants = np.concatenate([constants, np.repeat(gain.T.reshape(-1, 1), len(lanes), axis=1)])
            signals = CubicSpline(record.time, np.hstack([record.v, record.i + drawn[:, :, 0]]))
        sharp = not self.led and (sharp or len(memory) > 0 or any(one.jumps for one in self.player.limits))
        most, deepest = (MOST_PARTS, DEEP) if step <= FINE else (FEW_PARTS, DEEPER if sharp else SHALLOW)
        current, left, memory = run(self.tape, signals, x, memory, constants, fastest(a) / step, most, deepest, rule)
        return current - drawn, left, memory

    def _drawn(self, record: EventRecord, rests: Sequence[Rest]) -> np.ndarray:
        """(N, 2, S) what shunts at the PCC take; (N, 2, 1) zeros without any."""
        outside = self.player.wiring.outside
        if not outside.elements:
            return np.zeros((len(record.time), 2, 1))
        return np.stack([drawn_at_pcc(outside, at, record.voltage, self.player.omega_0) for at in rests], axis=2)

    def _numbers(self, at: Rest, values: Mapping[str, float], record: EventRecord) -> tuple[list, list, list]:
        """States, memory and constants at rest."""
        constants: list[float] = []
        for module in at.modules:
            for value in module.arguments.values():
                constants += [float(one) for one in value] if isinstance(value, tuple) else [float(value)]
        constants += [float(at.references.get(one, 0.0)) for one in self.references]
        constants += [float(values[f"{one.id}.{name}"]) for one in self.player.limits for name in one.parameters]
        lacking_r, lacking_u, e, r = self._at_rest(at)
        constants += [*lacking_r, *lacking_u, e]
        memory = memory_at_rest(self.player.limits, r[0], e, float(record.time[0]) - record.rest_end)
        states = [value for name in self.names for value in at.states[name]]
        if self._through is not None:
            more = port_at_rest(self.player.wiring.outside, self._through.own, at, record.rest.v, self.player.omega_0)
            states, constants = states + more[0], constants + more[1]
        return states, memory, constants

    def _at_rest(self, at: Rest) -> tuple[list[float], list[float], float, list[float]]:
        """What the sums of r and of u lack to be absolute, |e| and r at rest."""
        places: Places | None = self.player.places
        if places is None:
            return [0.0, 0.0], [0.0, 0.0], 1.0, [0.0, 0.0]

        def arrives(port: str, axis: int) -> float:
            sources = sources_of(self.player.wiring, (port, axis))
            return sum(at.outputs[one] for one in sources) + at.references.get((port, axis), 0.0)

        e = hypot(*(at.outputs[places.voltage, axis] for axis in (0, 1)))
        plant = f"{self.player.wiring.plant}.u_r"
        lacking_u = [arrives(plant, axis) - arrives(places.command, axis) for axis in (0, 1)]
        if places.reference is None:
            return [0.0, 0.0], lacking_u, e, [0.0, 0.0]
        lacking_r = [-arrives(places.reference, axis) for axis in (0, 1)]
        r = [-at.outputs[places.measured, axis] for axis in (0, 1)]
        return lacking_r, lacking_u, e, r
