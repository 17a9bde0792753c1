"""What a block does, found from its declaration and never from its name: a kind of one's own counts
like one that ships.
"""

from collections.abc import Mapping
from enum import StrEnum
from functools import cached_property
from itertools import chain, combinations
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ibrid.modules.declaration import TRIAL_OMEGA_0, trial_arguments, width
from ibrid.signals import Signal

if TYPE_CHECKING:
    from ibrid.modules.kind import ModuleKind

#: Families that a diagram asks for: `kind.family` is declared.
PLANT, BRANCH, SYNCHRONISATION = "physical plant", "physical branch", "synchronisation"

#: Where a law is evaluated, rad/s; far apart, and none of them special.
_POINTS = 1j * np.array([3.1, 170.0, 2900.0])
_ROUNDING = 1e-9


class Element(StrEnum):
    """What a block is to a control engineer. The first lines are in the order in which linear
    blocks of a row are drawn.

    In line, from in_ to out, on a scalar or on each axis of a dq vector: GAIN k, PI kP + kI/s,
    DELAY exp(-s T), INTEGRATOR 1/s, LOW_PASS with a gain of 1 at rest, HOLD of a sampled signal in
    rational form, NOTCH of one frequency, PADE a delay's rational form (all-pass), SIGN -1;
    COUPLING J times a number and the nominal frequency, COUPLING_AT_FREQUENCY the same at a
    measured frequency. On the space vector: TURN by a constant angle, BAND_PASS of the fundamental,
    POSITIVE_SEQUENCE without the negative one; NEGATIVE_PI of the negative one alone; RESONATOR on
    each axis, nothing at rest. Axes: PACK two scalars to dq, SLICE_D and SLICE_Q back, MAGNITUDE of
    a dq vector. ZERO : a constant source. Frames: ROTATION_IN from the grid's frame into the
    controller's, ROTATION_OUT back. Power: POWER p and q of e and i. Synchronisation: PLL frequency
    and angle from e_q, FREQUENCY_METER the frequency of a voltage, OSCILLATOR frequency and voltage
    from a voltage and a current. REFERENCE of current from set-points of power and a voltage.
    Circuit: FILTER between converter and grid (the plant), SHUNT beside it, CONVERTER_LOSS of
    voltage against a current, DC_LINK, SHARE of two devices behind one PCC.
    """

    GAIN = "gain"
    COUPLING = "cross coupling"
    PI = "PI regulator"
    PLL = "phase-locked loop"
    DELAY = "delay"
    INTEGRATOR = "integrator"
    LOW_PASS = "low-pass"
    HOLD = "hold"
    NOTCH = "notch"
    PADE = "rational delay"
    SIGN = "sign"
    COUPLING_AT_FREQUENCY = "cross coupling at the measured frequency"
    PACK = "pack of two axes"
    SLICE_D = "d axis"
    SLICE_Q = "q axis"
    MAGNITUDE = "magnitude"
    ZERO = "zero"
    ROTATION_IN = "rotation into the controller's frame"
    ROTATION_OUT = "rotation into the grid's frame"
    POWER = "power"
    FREQUENCY_METER = "frequency meter"
    OSCILLATOR = "oscillator"
    FILTER = "output filter"
    SHUNT = "shunt"
    DC_LINK = "DC link"
    SHARE = "share"
    TURN = "turn"
    BAND_PASS = "band-pass at the fundamental"
    POSITIVE_SEQUENCE = "positive-sequence filter"
    RESONATOR = "resonator"
    NEGATIVE_PI = "PI regulator of the negative sequence"
    REFERENCE = "current reference from power"
    CONVERTER_LOSS = "converter loss"


#: J times a signal, by the nominal frequency or a measured one.
COUPLINGS = (Element.COUPLING, Element.COUPLING_AT_FREQUENCY)
#: Into the controller's frame, and out of it.
ROTATIONS = (Element.ROTATION_IN, Element.ROTATION_OUT)


class Behaviour:
    """Facts about a `ModuleKind` that follow from what it declares; a copy under another name has
    the same.
    """

    @property
    def residual(self) -> bool:
        """True for blocks that no designer would draw."""
        return _of(self).family == "residual"

    @property
    def static(self) -> bool:
        """True for memoryless kinds."""
        return not _of(self).states and _of(self).delay is None

    @property
    def in_line(self) -> bool:
        """True for a block of one input in_ and one output out of the same signal."""
        kind = _of(self)
        return (
            [*kind.inputs] == ["in_"]
            and [*kind.outputs] == ["out"]
            and kind.inputs["in_"] is kind.outputs["out"]
        )

    @property
    def through(self) -> bool:
        """True for a block in line that may hear a deviation of the frequency beside its input."""
        (first, *others), outputs = (*_of(self).inputs, ""), [*_of(self).outputs]
        heard = all(port in ("", "delta_omega") for port in others)
        return (
            first == "in_"
            and outputs == ["out"]
            and heard
            and _of(self).inputs["in_"] is _of(self).outputs["out"]
        )

    @property
    def signal(self) -> Signal | None:
        """The signal that all inputs and outputs carry; None where they differ."""
        signals = {*_of(self).inputs.values(), *_of(self).outputs.values()}
        return signals.pop() if len(signals) == 1 else None

    @cached_property
    def element(self) -> Element | None:
        """What the block is to a control engineer; None for a law that has no name here."""
        return _element(_of(self))

    @cached_property
    def per_axis(self) -> bool:
        """True when one scalar law acts on both axes of one dq input, whatever the operating
        point.
        """
        kind = _of(self)
        one = [*kind.inputs.values()] == [*kind.outputs.values()] == [Signal.DQ_VEC]
        return (
            one
            and not kind.equilibrium_ports
            and not kind.uses_frame
            and _scalar_law(responses(kind)) is not None
        )

    @cached_property
    def scales(self) -> bool:
        """True when some of its parameters scale its output as a whole, so that a free gain in a
        row with it says nothing.
        """
        kind = _of(self)
        if kind.equilibrium_ports or kind.uses_frame or width(kind.inputs) == 0:
            return False
        before, arguments = responses(kind), _arguments(kind)
        sets = chain(
            *(combinations(kind.parameters, size) for size in range(1, len(kind.parameters) + 1))
        )
        return any(
            _near(responses(kind, {name: 1.1 * arguments[name] for name in names}) / 1.1, before)
            for names in sets
        )

    @cached_property
    def passes(self) -> bool:
        """True for a block in line that hands a signal on at rest, axis by axis: a sign, gain,
        filter or delay, no integrator.
        """
        kind = _of(self)
        if not self.through or not (self.static or kind.dc_gain):
            return False
        return (
            not self.static
            or self.element is Element.TURN
            or (
                self.in_line
                and _near(d := numbers_of(kind, _arguments(kind))[3], np.diag(np.diag(d)))
            )
        )

    @property
    def shapes(self) -> bool:
        """True for a filter or delay in line: it hands a signal on as it is at rest, and not above
        its corner; or turned.
        """
        return (
            self.through and not self.static and _of(self).dc_gain == 1.0
        ) or self.element is Element.TURN

    @property
    def regulates(self) -> bool:
        """True for a block in line that can make a command from an error: proportional, integral or
        both.
        """
        return self.element in (Element.GAIN, Element.PI, Element.INTEGRATOR)

    @cached_property
    def integrates(self) -> bool:
        """True for a controller with a pole at zero, whose input at rest is zero."""
        kind = _of(self)
        if kind.family == PLANT or not kind.states:
            return False
        a = numbers_of(kind, _arguments(kind))[0]
        return int(np.linalg.matrix_rank(a)) < len(a)

    @property
    def has_capacitor(self) -> bool:
        """True for a filter with a capacitor: the converter's current i_ti is another than the
        grid's i_g.
        """
        return "i_ti" in _of(self).outputs

    @property
    def has_line(self) -> bool:
        """True for a filter whose measured voltage e lies behind L_g, R_g and is not that of the
        PCC.
        """
        return "L_g" in _of(self).parameters


def same_on_one_axis(scalar: "ModuleKind", vector: "ModuleKind") -> bool:
    """True when a kind of one scalar input and output does what another does on each axis, with
    parameters of the same names.
    """
    single = [*scalar.inputs.values()] == [*scalar.outputs.values()] == [Signal.SCALAR]
    alike = [*scalar.parameters] == [*vector.parameters] and 2 * len(scalar.states) == len(
        vector.states
    )
    if (
        not (single and alike and vector.per_axis)
        or scalar.equilibrium_ports
        or scalar.delay != vector.delay
    ):
        return False
    arguments = _arguments(vector)
    values = {name: arguments[name] for name in vector.parameters}
    return _near(responses(scalar, values)[:, :1, :1], responses(vector)[:, :1, :1])


def _of(behaviour: Behaviour) -> "ModuleKind":
    return cast("ModuleKind", behaviour)


# --- how it is found
# ----------------------------------------------------------------------------------------------


def _element(kind: "ModuleKind") -> Element | None:
    if kind.family in (PLANT, BRANCH, SYNCHRONISATION):
        return _of_circuit(kind) if kind.family != SYNCHRONISATION else _of_synchronisation(kind)
    if kind.shares:
        return Element.SHARE
    if kind.delay is not None:
        return Element.DELAY if kind.in_line else None
    if kind.in_line:
        return _in_line(kind)
    if kind.through and kind.dc_gain == 1.0:
        return _of_sequence(kind)
    return _static(kind) if kind.static else None


def _of_circuit(kind: "ModuleKind") -> Element | None:
    if kind.family == PLANT:
        return Element.FILTER
    if _signals(kind.inputs) == "vv" and _signals(kind.outputs) == "s":
        return Element.DC_LINK
    if kind.static:
        return (
            Element.CONVERTER_LOSS
            if (_signals(kind.inputs), _signals(kind.outputs)) == ("v", "v")
            else None
        )
    return (
        Element.SHUNT
        if kind.signal is Signal.DQ_VEC and len(kind.inputs) == len(kind.outputs) == 1
        else None
    )


def _of_synchronisation(kind: "ModuleKind") -> Element | None:
    entering, leaving = _signals(kind.inputs), _signals(kind.outputs)
    if [*kind.inputs] == ["e_q"] and {*kind.outputs} == {"delta_omega", "delta"}:
        return Element.PLL
    if (entering, leaving) == ("vs", "s"):
        return Element.FREQUENCY_METER
    return Element.OSCILLATOR if (entering, leaving) == ("vv", "ss") else None


def _in_line(kind: "ModuleKind") -> Element | None:
    law = _scalar_law(responses(kind))
    names = [*kind.parameters]
    if kind.static:
        d = numbers_of(kind, _arguments(kind))[3]
        if law is not None and not names:
            return Element.SIGN if _near(law, -1.0) else None
        if len(names) != 1 or kind.equilibrium_ports or kind.uses_frame:
            return None
        if not _proportional(kind, d):
            return Element.TURN if _turns(d) and _near(d @ d.T, np.eye(len(d))) else None
        return Element.GAIN if law is not None else Element.COUPLING if _quarter_turn(d) else None
    if law is None:
        return _of_sequence(kind) if kind.dc_gain == 1.0 else _negative_pi(kind)
    if kind.dc_gain == 1.0:
        return _filter(kind, law)
    if kind.dc_gain == 0.0 and len(kind.states) == 2 * width(kind.inputs):
        return Element.RESONATOR
    if len(kind.states) != width(kind.inputs):
        return None
    values = [_arguments(kind)[name] for name in names]
    if len(values) == 2 and _near(law, values[0] + values[1] / _POINTS):
        return Element.PI
    return Element.INTEGRATOR if not values and _near(law, 1 / _POINTS) else None


def _filter(kind: "ModuleKind", law: np.ndarray) -> Element | None:
    a, b, c, d = numbers_of(kind, _arguments(kind))
    if not d.any():
        held = (
            len(a) >= 3 * len(d) and (c @ b).any()
        )  # order 3 or more and falling as slowly as order 1
        return Element.HOLD if held else Element.LOW_PASS
    if _near(np.abs(law), 1.0):
        return Element.PADE
    if _near(d, np.eye(len(d))):
        zeros = np.linalg.eigvals(a - b @ c)
        return Element.NOTCH if np.all(np.abs(zeros.real) <= _ROUNDING * np.abs(zeros)) else None
    return None


def _of_sequence(kind: "ModuleKind") -> Element | None:
    """Filters of the space vector, known by the frequency that they stop: that of a DC offset, or
    the negative sequence.
    """
    if kind.inputs["in_"] is not Signal.DQ_VEC or not all(
        _turns(one[:, :2]) for one in responses(kind)
    ):
        return None
    stopped = {Element.BAND_PASS: -1j, Element.POSITIVE_SEQUENCE: -2j}
    for element, multiple in stopped.items():
        response = responses(kind, points=np.array([multiple * TRIAL_OMEGA_0]))[0]
        if abs(response[0, 0] + 1j * response[1, 0]) <= _ROUNDING:
            return element
    return None


def _negative_pi(kind: "ModuleKind") -> Element | None:
    """A PI controller of the space vector in the frame that turns backwards."""
    values = [_arguments(kind)[name] for name in kind.parameters]
    if len(values) != 2 or len(kind.states) != 2 or width(kind.inputs) != 2:
        return None
    law = values[0] + values[1] / (_POINTS + 2j * TRIAL_OMEGA_0)
    found = responses(kind)
    vector = found[:, 0, 0] + 1j * found[:, 1, 0]
    turning = all(_turns(one) for one in found)
    return Element.NEGATIVE_PI if turning and _near(vector, law) else None


def _static(kind: "ModuleKind") -> Element | None:
    entering, leaving = _signals(kind.inputs), _signals(kind.outputs)
    d = numbers_of(kind, _arguments(kind))[3]
    if not entering:
        return Element.ZERO if not d.any() else None
    if kind.bilinear:
        return Element.POWER if entering == "vv" and {*kind.outputs} == {"p", "q"} else None
    if (entering, leaving) == ("vs", "v"):
        if kind.uses_frame:
            return (
                Element.ROTATION_IN if d[0, 1] > 0 else Element.ROTATION_OUT
            )  # the trial frame has a positive sine
        return (
            Element.COUPLING_AT_FREQUENCY
            if len(kind.parameters) == 1 and _quarter_turn(d[:, :2])
            else None
        )
    if kind.parameters:
        return None
    if (entering, leaving) == ("vv", "v"):
        rested = {*kind.equilibrium_ports} == {*kind.inputs} and kind.rests_by_law
        return Element.REFERENCE if rested and not d[:, 2:].any() else None
    if (entering, leaving) == ("ss", "v"):
        return Element.PACK if _near(d, np.eye(2)) else None
    if (entering, leaving) == ("v", "s"):
        if kind.equilibrium_ports:
            return Element.MAGNITUDE if _near(np.linalg.norm(d), 1.0) else None
        rows = {Element.SLICE_D: [[1.0, 0.0]], Element.SLICE_Q: [[0.0, 1.0]]}
        return next((element for element, row in rows.items() if _near(d, np.array(row))), None)
    return None


def _signals(ports: Mapping[str, Signal]) -> str:
    return "".join("v" if signal is Signal.DQ_VEC else "s" for signal in ports.values())


def _arguments(kind: "ModuleKind") -> dict[str, Any]:
    """Of the trial point; no parameter is zero, so that it shows what it does."""
    boxes = kind.parameters.items()
    return trial_arguments(kind) | {name: box.typical or box.high or box.low for name, box in boxes}


def numbers_of(
    kind: "ModuleKind", arguments: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C, D at some arguments."""
    order, entering, leaving = len(kind.states), width(kind.inputs), width(kind.outputs)
    shapes = ((order, order), (order, entering), (leaving, order), (leaving, entering))
    found = zip(kind.matrices(**arguments), shapes, strict=True)
    a, b, c, d = (np.array(rows, dtype=float).reshape(shape) for rows, shape in found)
    return a, b, c, d


def responses(
    kind: "ModuleKind",
    values: Mapping[str, float] = MappingProxyType({}),
    points: np.ndarray = _POINTS,
) -> np.ndarray:
    """(points, outputs, inputs) at typical parameters but for the values given."""
    a, b, c, d = numbers_of(kind, _arguments(kind) | dict(values))
    return np.array([c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d for s in points])


def _scalar_law(responses: np.ndarray) -> np.ndarray | None:
    """(points,) g where every response is g times the identity; None where one is not."""
    law = responses[:, 0, 0]
    return law if _near(responses, law[:, None, None] * np.eye(responses.shape[1])) else None


def _proportional(kind: "ModuleKind", d: np.ndarray) -> bool:
    arguments = _arguments(kind)
    (name,) = kind.parameters
    return _near(numbers_of(kind, arguments | {name: 1.1 * arguments[name]})[3] / 1.1, d)


def _quarter_turn(d: np.ndarray) -> bool:
    """True for a number times J = [[0, -1], [1, 0]]."""
    return (
        d.shape == (2, 2)
        and d[1, 0] != 0
        and _near(d, d[1, 0] * np.array([[0.0, -1.0], [1.0, 0.0]]))
    )


def _turns(d: np.ndarray) -> bool:
    """True for a I + b J."""
    return d.shape == (2, 2) and _near(
        d, d[0, 0] * np.eye(2) + d[1, 0] * np.array([[0.0, -1.0], [1.0, 0.0]])
    )


def _near(value: Any, expected: Any) -> bool:
    return bool(np.abs(value - expected).max() <= _ROUNDING * max(1.0, float(np.abs(value).max())))
