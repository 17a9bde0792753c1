"""A record as a nonlinear averaged model: the laws of its modules joined, at rest and linear there as the record says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import networkx as nx
import numpy as np

from ibrid.analysis.linear_model import linear_model, whole_record, with_point
from ibrid.assembly.signals_at_rest import Channel, channels_of, sources_of
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.export.module_motion import by_port
from ibrid.export.rest import Rest, rest
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import Wiring, split_port, wire

#: What the numbers of every nonlinear export mean.
ABSOLUTE = (
    "Absolute quantities, per unit on the inverter's base, time in s, angles in rad; v and i are (D, Q) in a frame that turns at "
    "omega_0, current out of the inverter, q axis leading d; averaged over a switching period"
)


@dataclass(frozen=True, eq=False)
class NonlinearModel:
    """dx/dt = f(x, z, v, r), 0 = g(x, z, v, r), i = h(x, z, v, r); absolute quantities, per unit and rad, time in s.

    v : (2,) terminal voltage [v_D, v_Q]. i : (2,) terminal current out of the inverter, q axis leading.
    `states` : names of x, "instance.state", in the order of the record's state space. `algebraic` : names of z, the
    signals of loops of direct terms; mostly there are none. `references` : names of r, inputs to which a constant adds
    (p* and q* in front of power controllers). `x0`, `z0`, `v0`, `r0`, `i0` : the operating point, at rest.
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

    @property
    def i0(self) -> np.ndarray:
        """(2,) terminal current at rest."""
        return np.array(self.h(*self._at_rest)).ravel()

    def linearised(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(A, B, C, D) at the operating point, by exact derivatives; small deviations from v0 and i0."""
        f_x, f_z, f_v, g_x, g_z, g_v, h_x, h_z, h_v = (np.array(one) for one in self._derivatives(*self._at_rest))
        z_x, z_v = (np.linalg.solve(g_z, one) if len(self.algebraic) else one for one in (-g_x, -g_v))
        return f_x + f_z @ z_x, f_v + f_z @ z_v, h_x + h_z @ z_x, h_v + h_z @ z_v

    def dae(self, v: ca.SX, *, time: ca.SX | None = None, r: Any = None) -> dict[str, Any]:
        """The problem for `casadi.integrator`, with the terminal voltage as an expression, of time or of parameters.

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
        symbols = [ca.SX.sym(name, len(some)) for name, some in zip("xzvr", self._at_rest, strict=True)]
        found = [ca.jacobian(one(*symbols), by) for one in (self.f, self.g, self.h) for by in symbols[:3]]
        return ca.Function("derivatives", symbols, [ca.densify(one) for one in found])


def assembled(wiring: Wiring, at: Rest) -> NonlinearModel:
    """The model of a wired diagram at its operating point; outputs are substituted in the order of direct terms."""
    x = {module.name: ca.SX.sym(module.name, len(module.states)) for module in at.modules}
    v, r = ca.SX.sym("v", 2), ca.SX.sym("r", len(at.references))
    reference = {channel: r[index] for index, channel in enumerate(at.references)}
    signal = {
        channel: ca.SX.sym(f"{channel[0]}:{channel[1]}")
        for module in at.modules
        for channel in channels_of(module.name, module.kind.outputs)
    }
    signal |= {(TERMINAL_VOLTAGE, axis): v[axis] for axis in (0, 1)}

    def arriving(channel: Channel) -> Any:
        terms = [signal[source] for source in sources_of(wiring, channel)]
        return sum(terms, reference.get(channel, ca.SX(0)))

    rates: list[Any] = []
    law: dict[Channel, Any] = {}
    for module in at.modules:
        inputs = by_port(module.kind, [arriving(one) for one in channels_of(module.name, module.kind.inputs)])
        states = x[module.name]
        rate, outputs = module.motion([states[k] for k in range(states.numel())], inputs)
        rates += rate
        law |= dict(zip(channels_of(module.name, module.kind.outputs), map(ca.SX, outputs), strict=True))
    loops = _solve(law, signal)
    symbols = [signal[channel] for channel in law]
    explicit = [law[channel] if channel not in loops else signal[channel] for channel in law]

    def resolved(expressions: Sequence[Any]) -> ca.SX:
        whole = ca.vertcat(*expressions) if expressions else ca.SX(0, 1)
        return ca.substitute(whole, ca.vertcat(*symbols), ca.vertcat(*explicit))

    z = ca.vertcat(*[signal[channel] for channel in loops]) if loops else ca.SX.sym("z", 0)
    arguments = [ca.vertcat(*x.values()), z, v, r]
    names = ["x", "z", "v", "r"]
    residual = [law[channel] - signal[channel] for channel in loops]
    current = [arriving((TERMINAL_CURRENT, axis)) for axis in (0, 1)]
    return NonlinearModel(
        states=tuple(f"{module.name}.{state}" for module in at.modules for state in module.states),
        algebraic=channel_names(loops, wiring),
        references=channel_names(list(at.references), wiring),
        f=ca.Function("f", arguments, [ca.densify(resolved(rates))], names, ["x_dot"]),
        g=ca.Function("g", arguments, [ca.densify(resolved(residual))], names, ["residual"]),
        h=ca.Function("h", arguments, [ca.densify(resolved(current))], names, ["i"]),
        x0=np.array([value for module in at.modules for value in at.states[module.name]]),
        z0=np.array([at.outputs[channel] for channel in loops]),
        v0=np.array([at.outputs[TERMINAL_VOLTAGE, axis] for axis in (0, 1)]),
        r0=np.array(list(at.references.values()), dtype=float),
    )


def channel_names(channels: Sequence[Channel], wiring: Wiring) -> tuple[str, ...]:
    """ "NAME.port" of each channel, with .d or .q where the port has two axes."""
    return tuple(f"{port}.{'dq'[axis]}" if _has_axes(wiring, port) else port for port, axis in channels)


def _has_axes(wiring: Wiring, port: str) -> bool:
    if port in (TERMINAL_VOLTAGE, TERMINAL_CURRENT):
        return True
    name, inner = split_port(port)
    kind = wiring.kinds[name]
    return {**kind.inputs, **kind.outputs}[inner].width == 2


def _solve(law: dict[Channel, Any], signal: Mapping[Channel, Any]) -> list[Channel]:
    """Replace in each law the signals that follow from others; returns the channels of loops, which stay unknown."""
    owner = {signal[channel].name(): channel for channel in law}
    graph = nx.DiGraph()
    graph.add_nodes_from(law)
    for channel, expression in law.items():
        graph.add_edges_from((owner[one.name()], channel) for one in ca.symvar(expression) if one.name() in owner)
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


def nonlinear_model(record: Record, op: str | None = None) -> NonlinearModel:
    """The nonlinear averaged model of a record at an operating point, as `linear_model` takes it.

    Delays are the Pade forms of the record. Raises as `linear_model`, and IbridError for a record of the paper's
    equilibrium, whose matrices linearise nothing; ModuleError for a kind without a large-signal law.
    """
    linear_model(record, op)  # what has no linear model has none at all, and is refused in the same words
    with whole_record():
        whole, name = with_point(record, op)
        wiring, at = rest_of_record(whole, name)
        return assembled(wiring, at)


def rest_of_record(record: Record, op: str) -> tuple[Wiring, Rest]:
    """Wiring and operating point of a record at one of its points; raises as `nonlinear_model`."""
    settings = record.settings
    if settings["equilibrium"] != "exact":
        raise IbridError(
            "a nonlinear model needs a record with the exact equilibrium, found equilibrium "
            f"{settings['equilibrium']!r}; evaluate with --equilibrium exact, or export the linear model"
        )
    wiring = wire(record.diagram, record.vocabulary)
    point = settings["operating_points"][op]
    at = rest(
        wiring,
        parameter_table(wiring, "exact"),
        record.parameters[op],
        (float(point["p"]), float(point["q"]), float(point["v"])),
        power_node=settings["power_node"],
        omega_0=2 * np.pi * settings["f0_hz"],
        pade_orders=settings["pade_orders"],
    )
    return wiring, at
