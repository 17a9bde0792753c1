"""What a module kind declares: ports, states, parameter boxes and state-space matrices, each once.

A kind is a frozen value, so one written in a notebook travels to another process unchanged.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import ModuleError
from ibrid.frozen import Frozen
from ibrid.modules.behaviour import Behaviour, Element
from ibrid.modules.declaration import check_declaration
from ibrid.modules.large_signal import LargeSignal
from ibrid.modules.own_law import call_law
from ibrid.signals import Signal

Rows = Sequence[Sequence[Any]]
Matrices = tuple[Rows, Rows, Rows, Rows]

#: What besides parameters a `state_space` may ask for by argument name.
#: `omega_0` is 2 pi f0 in rad/s, `frame` is (cos delta_eq, sin delta_eq) of the controller frame.
CONTEXT = ("omega_0", "frame")
#: Suffix that asks for the equilibrium of the signal at a port, a pair (d, q) in the frame of that
#: port.
EQUILIBRIUM = "_eq"


@methods_take_kinds
@dataclass(frozen=True, slots=True)
class Range:
    """Admissible range of a parameter.

    `low`, `high` : the box. `typical` : where a first guess lies. `unit`, `meaning` : words for
    tables.
    `divides` : the law divides by the parameter, so a fixed value must lie above zero.
    `usual` : (low, high) within the box, where a parameter lies unless its binding gives it a box
    of its own; None: the box.
    """

    low: float
    high: float
    typical: float
    unit: str
    meaning: str
    divides: bool = False
    usual: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        require_kinds(self)
        if not self.low < self.high or not math.isfinite(self.high - self.low):
            raise ModuleError(
                f"a range needs finite numbers low < high, got low={self.low}, high={self.high}"
            )
        if not self.low <= self.typical <= self.high:
            raise ModuleError(f"typical={self.typical} must lie within [{self.low}, {self.high}]")
        if (
            self.usual is not None
            and not self.low <= self.usual[0] <= self.typical <= self.usual[1] <= self.high
        ):
            raise ModuleError(
                f"usual={self.usual} must lie within [{self.low}, {self.high}] and hold "
                f"{self.typical}"
            )

    @property
    def unbound(self) -> tuple[float, float]:
        """Where a parameter lies to which no binding gives a box."""
        return self.usual or (self.low, self.high)

    @property
    def logarithmic(self) -> bool:
        """True when the box is positive, so that factors rather than differences are natural."""
        return self.low > 0


#: The equilibrium numbers that `equilibrium="paper"` fits at every operating point (appendix of the
#: paper).
PAPER_RANGES: Mapping[str, Range] = {
    "E0d": Range(0.5, 1.5, 1.0, "pu", "d component of the capacitor voltage at equilibrium"),
    "I0d": Range(0.5, 1.5, 1.0, "pu", "d component of the current at equilibrium"),
    "delta_eq": Range(-0.5, 0.5, 0.05, "rad", "angle of the controller frame at equilibrium"),
}


@methods_take_kinds
@dataclass(frozen=True)
class ModuleKind(Behaviour, Frozen):
    """One word of the vocabulary. What it does, as far as diagrams ask, follows from its
    declaration: see `Behaviour`.

    Parameters
    ----------
    name : key in programs and records.
    family : class of Table I: physical plant, dynamic control, synchronisation, operating point,
    static, residual.
    law : the equation in words and symbols.
    inputs, outputs : port -> signal kind, in the order of the columns of B and the rows of C.
    states : names of the states; their number is the order.
    parameters : name -> Range, in the order of the law.
    state_space : returns nested lists (A, B, C, D), using + - * / alone so that floats and CasADi
    symbols both work.
        Its arguments are the parameters and, where the law needs them, `omega_0`, `frame` and
        `PORT_eq`.
    dc_gain : gain at zero frequency of a dynamic kind with one input; None when it integrates, or
    when its outputs at
        rest are not a fixed multiple of its input. Static kinds need none.
    equilibrium : port -> "E0d", "I0d" or "V0", the value taken under `equilibrium="paper"`.
    delay : parameter that is a transport delay exp(-s T); the port then carries it exactly in
    frequency responses.
    shares : parameters that set the operating point of a device and no matrix, as the fraction of p
    that it delivers.
    bilinear : True for a product of its inputs, whose operating point is not that of its
    linearisation.
    input_at_rest : of a controller with a pole at zero and one scalar input, what arrives there at
    rest, from its parameters (by
        name) and `deviation`, the grid's frequency less the nominal one in rad/s; None: zero, as an
        integrator wants it.
    rests_by_law : True for a memoryless kind that rests where `large_signal.law` says, at the
    operating points of its
        inputs; others rest where their linearisation does.
    reference : where the law comes from.
    extended : True for kinds beyond the 23 of the paper.
    large_signal : the law in absolute quantities, for kinds whose matrices depend on the operating
    point; others are
        linear. A kind may leave it out: then diagrams with it have no nonlinear export.
    branches : of a plant, the parameters (resistance, capacitance) or (resistance, capacitance,
    inductance) of each series
        branch at the node of the measured voltage e, None for what is not there; with them its
        operating point is known in closed form from p, q and v.
    reactance_at_rest : of a plant with branches, in place of L_F its reactance at a current i_ti,
    from that and its parameters.
    plant_at_rest : of a plant of another shape, the same as a function of its parameters (by name),
    p, q, v and power_node:
        port -> (D, Q) in the grid frame for v_in, u_r, e, i_g, i_ti and i_C, with + - * / and
        `square_root`.

    Raises ModuleError where the declaration contradicts itself; `ibrid.testing.check_kind` asks
    more.
    """

    name: str
    family: str
    law: str
    inputs: Mapping[str, Signal]
    outputs: Mapping[str, Signal]
    state_space: Callable[..., Matrices]
    reference: str
    states: tuple[str, ...] = ()
    parameters: Mapping[str, Range] = field(default_factory=dict)
    dc_gain: float | None = None
    equilibrium: Mapping[str, str] = field(default_factory=dict)
    delay: str | None = None
    shares: tuple[str, ...] = ()
    bilinear: bool = False
    input_at_rest: Callable[..., Any] | None = None
    rests_by_law: bool = False
    extended: bool = False
    large_signal: LargeSignal | None = None
    branches: tuple[tuple[str | None, ...], ...] | None = None
    reactance_at_rest: Callable[..., Any] | None = None
    plant_at_rest: Callable[..., Mapping[str, tuple[Any, Any]]] | None = None

    def __repr__(self) -> str:
        return f"<{self.name}>"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_kinds(self)
        check_declaration(self, (*PAPER_RANGES, "V0"), CONTEXT, EQUILIBRIUM)

    def matrices(self, **arguments: Any) -> Matrices:
        """`state_space` at these arguments; ModuleError, one sentence, where a user's own law
        raises whatever it does.
        """
        return call_law(self.name, self.state_space, **arguments)

    @property
    def order(self) -> int:
        """Number of states counted in the order bound; a transport delay counts as 2, and in
        rational form it and a hold as no more.
        """
        if self.delay is not None:
            return 2
        return (
            min(2, len(self.states))
            if self.element in (Element.HOLD, Element.PADE)
            else len(self.states)
        )

    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """What `state_space` asks for, by name."""
        return tuple(inspect.signature(self.state_space).parameters)

    @cached_property
    def equilibrium_ports(self) -> tuple[str, ...]:
        """Ports whose operating point enters the matrices."""
        return tuple(
            name.removesuffix(EQUILIBRIUM) for name in self.arguments if name.endswith(EQUILIBRIUM)
        )

    @property
    def rest_parameters(self) -> tuple[str, ...]:
        """Parameters that set what arrives at the input at rest."""
        if self.input_at_rest is None:
            return ()
        return tuple(
            name
            for name in inspect.signature(self.input_at_rest).parameters
            if name in self.parameters
        )

    def arriving_at_rest(self, parameters: Mapping[str, Any], deviation: Any = 0.0) -> Any:
        """What the input of a controller with a pole at zero is at rest.

        parameters : of the kind. deviation : of the grid's frequency from the nominal one, rad/s.
        """
        if self.input_at_rest is None:
            return 0.0
        own = {name: parameters[name] for name in self.rest_parameters}
        return call_law(self.name, self.input_at_rest, **own, deviation=deviation)

    @property
    def uses_frame(self) -> bool:
        """True when the matrices depend on the angle of the controller frame."""
        return "frame" in self.arguments

    @property
    def paper_parameters(self) -> tuple[str, ...]:
        """Names of the fitted equilibrium numbers that this kind has under
        `equilibrium="paper"`.
        """
        names = [value for value in self.equilibrium.values() if value in PAPER_RANGES]
        return tuple(dict.fromkeys((["delta_eq"] if self.uses_frame else []) + names))

    def context(
        self, omega_0: Any, frame: tuple[Any, Any], equilibria: Mapping[str, tuple[Any, Any]]
    ) -> dict[str, Any]:
        """The arguments of `state_space` besides its parameters; ports that are not given get (1,
        0).
        """
        given = {"omega_0": omega_0, "frame": frame}
        chosen = {name: value for name, value in given.items() if name in self.arguments}
        return chosen | {
            port + EQUILIBRIUM: equilibria.get(port, (1.0, 0.0)) for port in self.equilibrium_ports
        }
