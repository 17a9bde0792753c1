"""A diagram with its limits, played: from parameter values and a record's voltage to the current
that it would deliver.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from ibrid.assembly.averaged import equations
from ibrid.assembly.numbers import Scalar, is_zero
from ibrid.assembly.rest import NO_REST, Rest, rest
from ibrid.assembly.set_points import SET_POINTS, set_point_gains
from ibrid.errors import IbridError
from ibrid.measurement.recordings.events import EventRecord
from ibrid.modules.large_signal import square_root
from ibrid.modules.vocabulary import Vocabulary
from ibrid.playback.between_samples import Matrices
from ibrid.playback.limits import ORDER, Limit, Limited, memory_at_rest, require_applicable
from ibrid.playback.machine_code import LANES
from ibrid.playback.places import Places, places_of
from ibrid.playback.port import drawn_at_pcc, port_at_rest, require_port_alone, solved, through_port
from ibrid.playback.steps import ORDER_5, ORDER_8, Rule, simulate, simulate_in_fixed_steps
from ibrid.playback.tape import Tape, tape_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import Parameter, parameter_table, parameters_at
from ibrid.structure.reading.wiring import sources_of, wire

#: Phase error (rad) of the rational form of a delay up to this frequency (Hz): far below what a
#: record shows; of a prediction, which leads to a valley and no further.
PHASE, LED_PHASE, HIGHEST = 1e-6, 1e-2, 2000.0
#: Step times the fastest mode, of an answer.
FINE = 0.7
#: Step times a mode that is damped well, at most, by the stages of a rule: it follows what is
#: slower, and the rule is stable up to 3.3 and 6.4 (Dormand and Prince, orders 5 and 8). Part of a
#: mode's size by which it decays where it is damped so.
DAMPED, WELL = {6: 2.5, 12: 4.0}, 0.5
#: Steps between two samples at most: of an answer, and of a fit, where what is stiffer is no
#: candidate.
MOST_PARTS, FEW_PARTS = 400, 16
#: How often a step is divided in which something switches: of an answer; of a fit near the noise,
#: whose cost else jumps (an integrator that stands, 60 dB: by 5,000 of 6,000), or to what jumps or
#: is followed from step to step; of others, predictions.
DEEP, DEEPER, SHALLOW = 5, 4, 2
#: Corrections that are kept: of the records of a model, and of the one before.
KNOWN = 16
#: Parameters by name, sets of them, and orders of delays for which the laws are kept.
Values = Mapping[str, float]
Sets = Sequence[Values]
_Orders = tuple[tuple[str, int], ...]
#: Current, times of leaving and memory, as of `run`.
Simulated = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Played:
    """`current` : (N, 2) terminal current, d and q, NaN from where the simulation left. `left` : s,
    None if it did not.
    `memory` : what the limits keep, at the end. `sizes` : (3,) of `SIZES`, at rest.
    """

    current: np.ndarray
    left: float | None
    memory: np.ndarray
    sizes: np.ndarray


class Player:
    """Plays one diagram with its limits; the laws are joined once.

    Raises IbridError for a limit that has no place in it.
    """

    def __init__(
        self,
        diagram: Diagram,
        kinds: Vocabulary,
        limits: Sequence[Limit] = (),
        omega_0: float = 120 * np.pi,
    ) -> None:
        require_port_alone(diagram.outside)
        if diagram.outside.inside:  # p and q at rest are read at the PCC
            diagram = diagram.behind(replace(diagram.outside, inside=False))
        self.wiring, self.omega_0 = wire(diagram, kinds), omega_0
        self.table = parameter_table(self.wiring, "exact")
        self.limits = tuple(sorted(limits, key=lambda one: ORDER.index(one.id)))
        self.places = places_of(diagram, kinds) if self.limits else None
        require_applicable(self.limits, self.places)
        self._laws: dict[tuple[_Orders, bool, bool], _Laws] = {}

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
        self,
        record: EventRecord,
        values: Sets,
        *,
        step: float = FINE,
        led: bool = False,
        rule: Rule = ORDER_8,
        sharp: bool = True,
    ) -> list[Played]:
        """The answer to a record's voltage at each of several parameter sets, which take the same
        steps.

        led : the states are corrected by the measured current, as a Kalman filter at rest does it,
        so that an error does not ring on: what is left is that of a prediction. sharp : False far
        from any noise, where kinks need no dividing of steps.

        Of frames of an estimator the voltage before it is played, and the current is seen through
        the same window. Led, the frames themselves are played: behind one window for both, voltage
        and current keep any linear relation.

        Raises OperatingPointError, IbridError or DiagramError where no set has a rest; one without
        a rest beside others is NaN.
        """
        laws = self._laws_at(values[0], led=led, told=self._told(record))
        if led or not record.smeared:
            return laws.run(record, values, step, rule, sharp)
        played, window = (
            laws.run(record.before_estimator, values, step, rule, sharp),
            record.rebuilt.matrix,
        )
        return [replace(one, current=window @ one.current) for one in played]

    def matrices(self, record: EventRecord, values: Values) -> Matrices:
        """A, B, C, D from the voltage to the current at the PCC at a record's rest, d and q.

        Raises as `play` does where there is no rest."""
        return self._laws_at(values).at_rest(record, values)

    def pulse_responses(
        self, record: EventRecord, values: Values, intervals: np.ndarray, size: float
    ) -> np.ndarray:
        """(M, N, 2) what a voltage that is wrong in one of some intervals between samples changes
        in the current.

        By sqrt(30) s (1 - s), s from 0 to 1, so by one rms, in d and then in q for each interval;
        by `size` times that in the simulation. Not finite where that leaves. Raises as `play` does
        where there is no rest.
        """
        return self._laws_at(values).pulse_responses(record, values, intervals, size)

    def _laws_at(self, values: Values, *, led: bool = False, told: bool = False) -> "_Laws":
        """The joined laws for the delays among some values; told : with set points that move."""
        key = self._orders(values, LED_PHASE if led else PHASE), led, told
        if key not in self._laws:
            self._laws[key] = _Laws(self, *key)
        return self._laws[key]

    def _told(self, record: EventRecord) -> bool:
        """Whether set points move in a record; IbridError for one that is not played."""
        if other := [name for name in record.steps_told if name not in SET_POINTS]:
            raise IbridError(
                f"{other[0]} moves in record {record.name}; {' and '.join(SET_POINTS)} are played "
                "into a diagram, "
                "leave that record or column out"
            )
        return bool(record.steps_told)

    def _orders(self, values: Values, phase: float = PHASE) -> _Orders:
        return tuple(
            (name, rational_order(float(self.table.value(name, kind.delay, values)), phase))
            for name, kind in self.wiring.kinds.items()
            if kind.delay is not None
        )


def rational_order(delay: float, phase: float = PHASE) -> int:
    """Smallest order of a Pade form whose phase error at `HIGHEST` is below `phase`.

    Law: the error is (omega T)^(2n+1) (n!)^2 / ((2n)! (2n+1)!) to first order.
    """
    angle = 2 * np.pi * HIGHEST * delay
    for order in range(1, 12):
        error = (
            angle ** (2 * order + 1)
            * factorial(order) ** 2
            / (factorial(2 * order) * factorial(2 * order + 1))
        )
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
) -> Simulated:
    """Current (N, 2, S) along signals (t -> (k,), the voltage first), the time (S,) at which each
    left, NaN if not, and the memory (k, S) at the end.

    tape : rates, current, next memory and switches of (states, memory, (time since, signals),
    constants). x (n, S), memory (k, S), constants (q, S), contiguous. rate : steps per second at
    least, `most` between two samples. deepest : as of `simulate`, as is the rule of the steps.
    """
    parts = np.clip(np.ceil(np.diff(signals.x) * rate), 1, most).astype(np.int64)
    return _simulated(simulate, tape, signals, (x, memory, constants), parts, deepest, rule)


def run_in_fixed_steps(
    tape: Tape,
    signals: CubicSpline,
    x: np.ndarray,
    memory: np.ndarray,
    constants: np.ndarray,
    a: np.ndarray,
) -> Simulated:
    """The same by one trapezoidal step from sample to even sample.

    a : (n, n) state matrix at rest.
    """
    time = signals.x
    step = float(time[-1] - time[0]) / (len(time) - 1)
    inverse = np.ascontiguousarray(np.linalg.inv(np.eye(len(a)) - 0.5 * step * a))
    begin = (x, memory, constants)
    return _simulated(simulate_in_fixed_steps, tape, signals, begin, step, inverse)


def _simulated(
    steps: Any, tape: Tape, signals: CubicSpline, begin: Sequence[np.ndarray], *how: Any
) -> Simulated:
    """By compiled steps, from states, memory and constants; how : what these steps ask for."""
    code = (tape.once, tape.each, tape.rows, tape.results)
    lanes, spline = begin[0].shape[1], np.ascontiguousarray(signals.c)
    current, left, memory = steps(code, *map(_filled, begin), spline, signals.x, *how)
    return current[:, :, :lanes], left[:lanes], memory[:, :lanes]


def _filled(columns: np.ndarray) -> np.ndarray:
    """With as many columns as the code takes at once."""
    return np.pad(columns, ((0, 0), (0, -columns.shape[1] % LANES)), "edge")


def fastest(jacobian: Any) -> float:
    """Largest magnitude of an eigenvalue of a state matrix, 1/s."""
    return float(np.abs(np.linalg.eigvals(np.nan_to_num(np.array(jacobian)))).max(initial=1.0))


def steps_per_second(a: np.ndarray, step: float, rule: Rule) -> float:
    """Steps per second that the modes of a state matrix ask for.

    Law: |mode| times the step is `step` at most; of a mode that is damped well `DAMPED`, since it
    rings no longer than the step lasts and follows what is slower. Filters far above what a record
    shows, and rational forms of delays, are such.
    """
    modes = np.linalg.eigvals(np.nan_to_num(a))
    damped = -modes.real > WELL * np.abs(modes)
    longest = np.where(damped, max(step, DAMPED[len(rule[2])]), step)
    return float((np.abs(modes) / longest).max(initial=1.0))


def correction(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(n, 2) gain K of x' = A x + B v + K (i - C x): a Kalman filter's where voltage and current
    are equally unsure; 0 where there is none.

    Law: K = P C', A P + P A' - P C' C P + Q = 0. With the stable eigenvectors (U1; U2) of the
    Hamiltonian matrix P = U2 U1^-1 (Potter, "Matrix quadratic solutions", SIAM J. Appl. Math. 14
    (1966) 496-501): a fifth of the time of a Schur form, and a prediction is led by any K that is
    nearly right.
    """
    n = len(a)
    process = b @ b.T + 1e-6 * np.eye(n)
    try:
        modes, vectors = np.linalg.eig(np.block([[a.T, -c.T @ c], [-process, -a]]))
        stable = vectors[:, np.real(modes) < 0]
        covariance = np.real(np.linalg.solve(stable[:n].T, stable[n:].T).T)
    except (np.linalg.LinAlgError, ValueError):
        return np.zeros((n, 2))
    return covariance @ c.T


def _beside(one: CubicSpline, other: CubicSpline | PchipInterpolator) -> CubicSpline:
    """Both, of the same times, as one."""
    return CubicSpline.construct_fast(
        np.ascontiguousarray(np.concatenate([one.c, other.c], axis=2)), one.x
    )


def _clock(record: EventRecord) -> float:
    """Time of the first sample after the event begins, s: negative."""
    return float(record.time[0]) - record.rest_end


class _Laws:
    """The joined laws as a tape; all numbers of the modules are its constants."""

    def __init__(self, player: Player, orders: _Orders, led: bool, told: bool = False) -> None:
        self.player, self.led, self.told = player, led, told
        self._corrections: dict[bytes, np.ndarray] = {}
        theta, point = ca.SX.sym("theta", len(player.parameters)), ca.SX.sym("point", 3)
        deviation, clock = ca.SX.sym("deviation"), ca.SX.sym("clock")
        values = {one.name: Scalar(theta[k]) for k, one in enumerate(player.table.free)}
        physics: Any = {"power_node": "pcc", "omega_0": player.omega_0, "pade_orders": dict(orders)}
        pqv = (Scalar(point[0]), Scalar(point[1]), Scalar(point[2]))
        at = rest(player.wiring, player.table, values, pqv, deviation=deviation, **physics)
        symbols, constants = {}, list[ca.SX]()
        for module in at.modules:
            own = {}
            for name, value in module.arguments.items():
                width = 2 if isinstance(value, tuple) else 1
                symbol = ca.SX.sym(f"{module.name}.{name}", width)
                constants.append(symbol)
                own[name] = (symbol[0], symbol[1]) if width == 2 else symbol
            symbols[module.name] = own
        x = {module.name: ca.SX.sym(module.name, len(module.states)) for module in at.modules}
        v, r, since = ca.SX.sym("v", 2), ca.SX.sym("r", len(at.references)), ca.SX.sym("since")
        numbers = {
            f"{one.id}.{name}": ca.SX.sym(name) for one in player.limits for name in one.parameters
        }
        lacking_r, lacking_u, e_rest = (
            ca.SX.sym("lacking_r", 2),
            ca.SX.sym("lacking_u", 2),
            ca.SX.sym("e_rest"),
        )
        memory = ca.SX.sym("memory", len(memory_at_rest(player.limits, 0.0, 1.0, 0.0)))
        shaping = None
        if player.limits and player.places is not None:
            shaping = Limited(
                player.limits, player.places, numbers, lacking_r, lacking_u, e_rest, memory, since
            )
        references: dict[Any, Any] = {one: r[k] for k, one in enumerate(at.references)}
        steps = ca.SX.sym("steps", len(SET_POINTS) if told else 0)
        if told:
            gains = set_point_gains(player.wiring, at.modules, references, symbols)
            self.taken = [
                name
                for k, name in enumerate(SET_POINTS)
                if any(not is_zero(one[k]) for one in gains.values())
            ]
            references |= {
                one: references.get(one, 0.0) + ca.dot(ca.vertcat(*pair), steps)
                for one, pair in gains.items()
            }
        joined = equations(player.wiring, at.modules, x, v, references, symbols, shaping)
        states, further, self._through = ca.vertcat(*x.values()), ca.SX(0, 1), None
        kept = (shaping.next, shaping.switches) if shaping else ([], [])
        results = [joined.rates, joined.current, *map(joined.resolved, kept)]
        if joined.loops:
            results = [
                ca.substitute(one, joined.unknown, solved(joined.residual, joined.unknown))
                for one in results
            ]
        if player.wiring.outside.elements:
            self._through = through_port(player.wiring.outside, results, states, v, player.omega_0)
            results, v = self._through.results, self._through.v
            states, further = ca.vertcat(states, self._through.states), self._through.constants
        constant = ca.vertcat(
            *constants, r, *numbers.values(), lacking_r, lacking_u, e_rest, further
        )
        arguments = [states, ca.vertcat(since, v), memory, constant]
        still = [ca.substitute(one, steps, ca.SX.zeros(steps.numel())) for one in results[:2]]
        self._linear = ca.Function(
            "linear", arguments, [ca.jacobian(a, b) for a in still for b in (states, v)]
        )
        outside = ca.vertcat(since, v, steps)
        if led:
            measured, gain = ca.SX.sym("measured", 2), ca.SX.sym("gain", states.numel(), 2)
            results[0] = results[0] + gain @ (measured - results[1])
            constant, outside = ca.vertcat(constant, ca.vec(gain)), ca.vertcat(outside, measured)
        self.tape: Tape = tape_of(
            [states, memory, outside, constant], results, constant=[3], optimised=not led
        )
        self._joined = states, memory, since, v, constant, results
        begin = self._at_rest(at, theta[len(player.table.free) :].elements(), point[2], clock)
        self._begin = ca.Function(
            "begin", [theta, point, deviation, clock], [ca.vertcat(*part) for part in begin]
        )

    def _begun(self, record: EventRecord, values: Sets, clock: float) -> list[np.ndarray]:
        """States, memory, constants and `SIZES` at a record's rest, a column for each set of
        values; clock : as of `_at_rest`.
        """
        names = [one.name for one in self.player.parameters]
        numbers = np.array([[one[name] for one in values] for name in names]).reshape(
            len(names), len(values)
        )
        begun = self._begin(numbers, record.rest.pqv, 2 * np.pi * record.offset_hz, clock)
        return [np.array(part) for part in begun]

    def at_rest(self, record: EventRecord, values: Values) -> Matrices:
        """A, B, C, D at a record's rest."""
        x, memory, constants, _ = self._begun(record, [values], 0.0)
        if not np.isfinite(np.vstack([x, constants])).all():
            raise IbridError(NO_REST)
        a, b, c, d = (
            np.nan_to_num(np.array(part))
            for part in self._linear(x, [0.0, record.rest.v, 0.0], memory, constants)
        )
        return a, b, c, d

    @cached_property
    def _pulse_tape(self) -> Tape:
        """The tape of a voltage that is wrong in an interval: constants begin, length and size of
        the bump, a signal the time.
        """
        states, memory, since, v, constant, results = self._joined
        clock, bump = ca.SX.sym("clock"), ca.SX.sym("bump", 4)
        s = ca.fmin(ca.fmax((clock - bump[0]) / bump[1], 0.0), 1.0)
        wrong = v + np.sqrt(30.0) * s * (1.0 - s) * bump[2:]
        results = [ca.substitute(one, v, wrong) for one in results]
        return tape_of(
            [states, memory, ca.vertcat(since, v, clock), ca.vertcat(constant, bump)],
            results,
            constant=[3],
        )

    def pulse_responses(
        self, record: EventRecord, values: Values, intervals: np.ndarray, size: float
    ) -> np.ndarray:
        """(M, N, 2) as `Player.pulse_responses`."""
        x, memory, constants, _ = self._begun(record, [values], _clock(record))
        a, *_ = self.at_rest(record, values)
        begins = record.time[intervals]
        lengths = record.time[intervals + 1] - begins
        shapes = np.zeros((4, 2 * len(intervals) + 1))
        shapes[1] = 1.0
        shapes[:2, 1:] = np.repeat([begins, lengths], 2, axis=1)
        shapes[2, 1::2] = shapes[3, 2::2] = size
        lanes = shapes.shape[1]
        constants = np.concatenate([np.repeat(constants, lanes, axis=1), shapes])
        signals = CubicSpline(
            record.time, np.column_stack([record.voltage(record.time), record.time])
        )
        start, kept = (np.ascontiguousarray(np.repeat(one, lanes, axis=1)) for one in (x, memory))
        deepest = DEEPER if self._switches(memory) else SHALLOW
        current, *_ = run(
            self._pulse_tape,
            signals,
            start,
            kept,
            np.ascontiguousarray(constants),
            steps_per_second(a, 1.0, ORDER_5),
            FEW_PARTS,
            deepest,
            ORDER_5,
        )
        return np.moveaxis(current[:, :, 1:] - current[:, :, :1], 2, 0) / size

    def run(
        self, record: EventRecord, values: Sets, step: float, rule: Rule, sharp: bool
    ) -> list[Played]:
        """As `Player.play`."""
        x, memory, constants, sizes = self._begun(record, values, _clock(record))
        kept = np.flatnonzero(np.isfinite(np.vstack([x, constants])).all(axis=0)).tolist()
        if not len(kept):
            raise IbridError(NO_REST)
        x, memory, constants = (
            np.ascontiguousarray(one[:, kept]) for one in (x, memory, constants)
        )
        linear = self._linear(x[:, 0], [0.0, record.rest.v, 0.0], memory[:, 0], constants[:, 0])
        a, b, c, _ = (np.nan_to_num(np.array(one)) for one in linear)
        signals, drawn = (
            self._signals(record),
            self._drawn(record, [values[k] for k in kept]),
        )
        if self.led:
            gain = self._correction(a, b, c)
            a = a - gain @ c
            constants = np.concatenate(
                [constants, np.repeat(gain.T.reshape(-1, 1), len(kept), axis=1)]
            )
            drawn_too = (
                CubicSpline(record.time, record.i + drawn[:, :, 0])
                if drawn.any()
                else record.current
            )
            signals = _beside(signals, drawn_too)
        sharp = not self.led and (sharp or self._switches(memory))
        most, deepest = (
            (MOST_PARTS, DEEP) if step <= FINE else (FEW_PARTS, DEEPER if sharp else SHALLOW)
        )
        start = self.tape, signals, x, memory, constants
        if record.stepped:
            current, left, memory = run_in_fixed_steps(*start, a)
        else:
            rate = fastest(a) / step if step <= FINE else steps_per_second(a, step, rule)
            current, left, memory = run(*start, rate, most, deepest, rule)
        unknown, lost = np.full((len(record.time), 2), np.nan), np.full(len(memory), np.nan)
        played = [Played(unknown, float(record.time[0]), lost, np.full(3, np.nan))] * len(values)
        for lane, (k, delivered) in enumerate(
            zip(kept, np.moveaxis(current - drawn, 2, 0), strict=True)
        ):
            gone = None if np.isnan(left[lane]) else float(left[lane])
            played[k] = Played(delivered, gone, memory[:, lane], sizes[:, k])
        return played

    def _switches(self, memory: np.ndarray) -> bool:
        """Whether a limit has a memory or jumps."""
        return len(memory) > 0 or any(one.jumps for one in self.player.limits)

    def _signals(self, record: EventRecord) -> CubicSpline:
        """The voltage, and the steps of the set points beside it; IbridError for one that nothing
        in the diagram takes.
        """
        if not self.told:
            return record.voltage
        for name in record.steps_told:
            if name not in self.taken:
                raise IbridError(
                    f"{name} moves in record {record.name}, and nothing in the model compares it "
                    "with a measured power; "
                    "leave that record out, or give a model that is told it"
                )
        none = np.zeros(len(record.time))
        steps = np.stack([record.steps_told.get(name, none) for name in SET_POINTS], axis=1)
        return _beside(record.voltage, PchipInterpolator(record.time, steps))

    def _correction(self, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """As `correction`; that of the last few models is known, since slopes are asked where a
        cost was.
        """
        key = b"".join(one.tobytes() for one in (a, b, c))
        if key not in self._corrections:
            if len(self._corrections) >= KNOWN:
                self._corrections.clear()
            self._corrections[key] = correction(a, b, c)
        return self._corrections[key]

    def _drawn(self, record: EventRecord, values: Sets) -> np.ndarray:
        """(N, 2, S) what shunts at the PCC take; (N, 2, 1) zeros without any."""
        wiring, omega_0 = self.player.wiring, self.player.omega_0
        if not wiring.outside.elements:
            return np.zeros((len(record.time), 2, 1))
        numbers = [parameters_at(wiring, self.player.table, one) for one in values]
        omega = omega_0 + 2 * np.pi * record.offset_hz
        drawn = [
            drawn_at_pcc(one, wiring.outside, record.voltage, omega_0, omega) for one in numbers
        ]
        return np.stack(drawn, axis=2)

    def _at_rest(
        self, at: Rest, numbers: Sequence[Any], v: ca.SX, clock: ca.SX
    ) -> tuple[list, ...]:
        """States, memory, constants and `SIZES`; numbers : of the limits. clock : time since the
        event begins, s.
        """
        arguments = [value for module in at.modules for value in module.arguments.values()]
        constants = [
            part for one in arguments for part in (one if isinstance(one, tuple) else [one])
        ]
        constants += [*at.references.values(), *numbers]
        lacking_r, lacking_u, r, sizes = self._absolute(at)
        constants += [*lacking_r, *lacking_u, sizes[2]]
        memory = memory_at_rest(self.player.limits, r[0], sizes[2], clock)
        states = [value for module in at.modules for value in at.states[module.name]]
        if self._through is not None:
            more = port_at_rest(
                self._through, self.player.wiring.outside, at, v, self.player.omega_0
            )
            states, constants = states + more[0], constants + more[1]
        return states, memory, constants, sizes

    def _absolute(self, at: Rest) -> tuple[list, ...]:
        """What the sums of r and of u lack to be absolute, r, and |r|, |u| and |e|, at rest."""
        places: Places | None = self.player.places
        if places is None:
            return [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0, 1.0]

        def arrives(port: str, axis: int) -> Any:
            sources = sources_of(self.player.wiring, (port, axis))
            return sum(at.outputs[one] for one in sources) + at.references.get((port, axis), 0.0)

        e = [at.outputs[places.voltage, axis] for axis in (0, 1)]
        u = [arrives(f"{self.player.wiring.plant}.u_r", axis) for axis in (0, 1)]
        lacking_u = [u[axis] - arrives(places.command, axis) for axis in (0, 1)]
        lacking_r, r = [0.0, 0.0], [0.0, 0.0]
        if places.reference is not None:
            lacking_r = [-arrives(places.reference, axis) for axis in (0, 1)]
            r = [-at.outputs[places.measured, axis] for axis in (0, 1)]
        return lacking_r, lacking_u, r, [square_root(d * d + q * q) for d, q in (r, u, e)]
