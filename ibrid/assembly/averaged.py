"""The laws of a diagram's modules joined into one nonlinear averaged model, absolute and at rest at
an operating point.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import casadi as ca
import networkx as nx
import numpy as np

from ibrid.assembly.module_motion import Module, by_port
from ibrid.assembly.rest import Rest
from ibrid.border import methods_take_kinds
from ibrid.frozen import Frozen
from ibrid.showing import brief, shown
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, sources_of


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class NonlinearModel(Frozen):
    """dx/dt = f(x, z, v, r), 0 = g(x, z, v, r), i = h(x, z, v, r); absolute quantities, per unit
    and rad, time in s.

    v : (2,) terminal voltage [v_D, v_Q]. i : (2,) terminal current out of the inverter, q axis
    leading.
    `states` : names of x, "instance.state", in the order of the record's state space. `algebraic` :
    names of z, the signals of loops of direct terms; mostly there are none. `references` : names of
    r, inputs to which a constant adds (p* and q* in front of power controllers). `x0`, `z0`, `v0`,
    `r0`, `i0` : the operating point, at rest.
    """

    states: tuple[str, ...]
    algebraic: tuple[str, ...]
    references: tuple[str, ...]
    f: ca.Function
    g: ca.Function
    h: ca.Function
    x0: np.ndarray
    z0: np.ndarray
    v0: np.ndarray
    r0: np.ndarray

    def __repr__(self) -> str:
        return brief(
            f"<NonlinearModel: {len(self.states)} states, references "
            f"{', '.join(self.references) or 'none'}",
            ">",
        )

    def _repr_html_(self) -> str:
        """States at rest, for notebooks."""
        return shown(self, "pages.notebook", "model_html")

    @property
    def i0(self) -> np.ndarray:
        """(2,) terminal current at rest."""
        return np.array(self.h(*self._at_rest)).ravel()

    def linearised(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(A, B, C, D) at the operating point, by exact derivatives; small deviations from v0 and
        i0.
        """
        f_x, f_z, f_v, g_x, g_z, g_v, h_x, h_z, h_v = (
            np.array(one) for one in self._derivatives(*self._at_rest)
        )
        z_x, z_v = (
            np.linalg.solve(g_z, one) if len(self.algebraic) else one for one in (-g_x, -g_v)
        )
        return f_x + f_z @ z_x, f_v + f_z @ z_v, h_x + h_z @ z_x, h_v + h_z @ z_v

    def dae(self, v: ca.SX, *, time: ca.SX | None = None, r: Any = None) -> dict[str, Any]:
        """The problem for `casadi.integrator`, with the terminal voltage as an expression, of time
        or of parameters.

        r : other references, an expression or numbers; by default those of the operating point.
        """
        x, z = ca.SX.sym("x", len(self.states)), ca.SX.sym("z", len(self.algebraic))
        arguments = (x, z, v, self.r0 if r is None else r)
        problem = {"x": x, "ode": self.f(*arguments)}
        if self.algebraic:
            problem |= {"z": z, "alg": self.g(*arguments)}
        return problem if time is None else problem | {"t": time}

    @property
    def _at_rest(self) -> tuple[np.ndarray, ...]:
        return self.x0, self.z0, self.v0, self.r0

    @cached_property
    def _derivatives(self) -> ca.Function:
        symbols = [
            ca.SX.sym(name, len(some)) for name, some in zip("xzvr", self._at_rest, strict=True)
        ]
        found = [
            ca.jacobian(one(*symbols), by) for one in (self.f, self.g, self.h) for by in symbols[:3]
        ]
        return ca.Function("derivatives", symbols, [ca.densify(one) for one in found])


@dataclass(frozen=True)
class Shaped:
    """What limits and freezes do to the joined laws. `arriving` : input channel -> what arrives
    there instead of the sum.
    `moving` : (instance, number of the state) -> factor on its rate.
    """

    arriving: Mapping[Channel, Any] = field(default_factory=dict)
    moving: Mapping[tuple[str, int], Any] = field(default_factory=dict)


#: Makes a `Shaped` of what arrives at an input channel as a sum, and of the signal of each output
#: channel.
Shaping = Callable[[Callable[[Channel], Any], Mapping[Channel, Any]], Shaped]


@dataclass(frozen=True)
class Equations:
    """Expressions in the states, the terminal voltage, constants and the signals of `loops`, which
    make `residual` zero.

    `resolved` : replaces in further expressions every signal by what it is made of.
    """

    rates: ca.SX
    current: ca.SX
    residual: ca.SX
    loops: list[Channel]
    unknown: ca.SX
    resolved: Callable[[Sequence[Any]], ca.SX]


def equations(
    wiring: Wiring,
    modules: Sequence[Module],
    x: Mapping[str, ca.SX],
    v: ca.SX,
    references: Mapping[Channel, Any],
    arguments: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    shaping: Shaping | None = None,
) -> Equations:
    """The laws of modules joined; outputs are substituted in the order of direct terms.

    x : instance -> its states. v : (2,) terminal voltage. references : input channel -> constant
    that adds to its sources.
    arguments : instance -> what its law takes instead of the module's own numbers.
    """
    signal = {
        channel: ca.SX.sym(f"{channel[0]}:{channel[1]}")
        for module in modules
        for channel in channels_of(module.name, module.kind.outputs)
    }
    signal |= {(TERMINAL_VOLTAGE, axis): v[axis] for axis in (0, 1)}

    def arriving(channel: Channel) -> Any:
        terms = [signal[source] for source in sources_of(wiring, channel)]
        return sum(terms, references.get(channel, ca.SX(0)))

    shaped = Shaped() if shaping is None else shaping(arriving, signal)
    rates: list[Any] = []
    law: dict[Channel, Any] = {}
    for module in modules:
        channels = channels_of(module.name, module.kind.inputs)
        inputs = by_port(module.kind, [shaped.arriving.get(one, arriving(one)) for one in channels])
        states = x[module.name]
        rate, outputs = module.motion(
            [states[k] for k in range(states.numel())],
            inputs,
            arguments.get(module.name, module.arguments),
        )
        rates += [one * shaped.moving.get((module.name, k), 1) for k, one in enumerate(rate)]
        law |= dict(
            zip(channels_of(module.name, module.kind.outputs), map(ca.SX, outputs), strict=True)
        )
    loops = _solve(law, signal)
    symbols = [signal[channel] for channel in law]
    explicit = [law[channel] if channel not in loops else signal[channel] for channel in law]

    def resolved(expressions: Sequence[Any]) -> ca.SX:
        whole = ca.vertcat(*expressions) if expressions else ca.SX(0, 1)
        return ca.substitute(whole, ca.vertcat(*symbols), ca.vertcat(*explicit))

    return Equations(
        resolved(rates),
        resolved([arriving((TERMINAL_CURRENT, axis)) for axis in (0, 1)]),
        resolved([law[channel] - signal[channel] for channel in loops]),
        loops,
        ca.vertcat(*[signal[channel] for channel in loops]) if loops else ca.SX.sym("z", 0),
        resolved,
    )


def assembled(wiring: Wiring, at: Rest) -> NonlinearModel:
    """The model of a wired diagram at its operating point."""
    x = {module.name: ca.SX.sym(module.name, len(module.states)) for module in at.modules}
    v, r = ca.SX.sym("v", 2), ca.SX.sym("r", len(at.references))
    system = equations(
        wiring, at.modules, x, v, {channel: r[k] for k, channel in enumerate(at.references)}
    )
    arguments, names = [ca.vertcat(*x.values()), system.unknown, v, r], ["x", "z", "v", "r"]
    return NonlinearModel(
        states=tuple(f"{module.name}.{state}" for module in at.modules for state in module.states),
        algebraic=channel_names(system.loops, wiring),
        references=channel_names(list(at.references), wiring),
        f=ca.Function("f", arguments, [ca.densify(system.rates)], names, ["x_dot"]),
        g=ca.Function("g", arguments, [ca.densify(system.residual)], names, ["residual"]),
        h=ca.Function("h", arguments, [ca.densify(system.current)], names, ["i"]),
        x0=np.array([value for module in at.modules for value in at.states[module.name]]),
        z0=np.array([at.outputs[channel] for channel in system.loops]),
        v0=np.array([at.outputs[TERMINAL_VOLTAGE, axis] for axis in (0, 1)]),
        r0=np.array(list(at.references.values()), dtype=float),
    )


def channel_names(channels: Sequence[Channel], wiring: Wiring) -> tuple[str, ...]:
    """ "NAME.port" of each channel, with .d or .q where the port has two axes."""
    return tuple(
        f"{port}.{'dq'[axis]}" if wiring.width(port) == 2 else port for port, axis in channels
    )


def _solve(law: dict[Channel, Any], signal: Mapping[Channel, Any]) -> list[Channel]:
    """Replace in each law the signals that follow from others; returns the channels of loops, which
    stay unknown.
    """
    owner = {signal[channel].name(): channel for channel in law}
    graph = nx.DiGraph()
    graph.add_nodes_from(law)
    for channel, expression in law.items():
        graph.add_edges_from(
            (owner[one.name()], channel) for one in ca.symvar(expression) if one.name() in owner
        )
    condensed = nx.condensation(graph)
    loops: list[Channel] = []
    for node in nx.topological_sort(condensed):
        members = [one for one in law if one in condensed.nodes[node]["members"]]
        if len(members) > 1 or graph.has_edge(members[0], members[0]):
            loops += members
        for channel in members:
            needed = [one for one in graph.predecessors(channel) if one not in loops]
            if needed:
                law[channel] = ca.substitute(
                    law[channel],
                    ca.vertcat(*[signal[one] for one in needed]),
                    ca.vertcat(*[law[one] for one in needed]),
                )
    return loops
