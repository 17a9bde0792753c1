"""The output filter of a reference inverter in the frame of its controller: equation (2) of the
paper, LCL or L.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any, Literal, Protocol

import casadi as ca

from ibrid.errors import IbridError
from ibrid.plants.dynamics import Dynamics, J, R, States

FilterKind = Literal["LCL", "L"]


class FilterParameters(Protocol):
    """Per unit, as in `OutputFilter`; with filter "L" C_F, L_g and R_g are zero."""

    @property
    def filter(self) -> FilterKind: ...
    @property
    def L_F(self) -> float: ...
    @property
    def R_F(self) -> float: ...
    @property
    def C_F(self) -> float: ...
    @property
    def L_g(self) -> float: ...
    @property
    def R_g(self) -> float: ...


@dataclass(frozen=True, kw_only=True)
class LCLParameters:
    """An LCL filter, per unit, at whose capacitor p and q are measured."""

    L_F: float
    R_F: float
    C_F: float
    L_g: float
    R_g: float

    @property
    def filter(self) -> FilterKind:
        """The output filter."""
        return "LCL"


def require_range(parameters: Any, may_be_zero: Collection[str], whose: str) -> None:
    """Raise IbridError unless all numbers of an inverter are finite and positive, or zero where
    they may be.
    """
    for field in fields(parameters):
        value = getattr(parameters, field.name)
        if value is None or not isinstance(value, int | float):
            continue
        if not isfinite(value) or value < 0 or (value == 0 and field.name not in may_be_zero):
            least = "zero or positive" if field.name in may_be_zero else "positive"
            raise IbridError(
                f"{field.name} of a {whose} inverter must be {least}; found {value:g}."
            )


@dataclass(frozen=True)
class OutputFilter:
    """Signals of the filter, (2,) each, in the controller's frame.

    v : the terminal voltage. e : the voltage that the controller measures, of the capacitor or of
    the terminals.
    i_ti, i_g : currents of the converter and into the grid, the same behind an L filter.
    drive : sets the rates from the voltage command u_r (2,) and the frequency of the frame, rad/s.
    """

    v: ca.SX
    e: ca.SX
    i_ti: ca.SX
    i_g: ca.SX
    drive: Callable[[ca.SX, ca.SX], None]

    @property
    def power(self) -> ca.SX:
        """(p, q) at e, delivered: p = e' i_g, q = e' J i_g."""
        return ca.vertcat(ca.dot(self.e, self.i_g), ca.dot(self.e, J(self.i_g)))


def output_filter(m: FilterParameters, states: States, v: ca.SX, omega_0: float) -> OutputFilter:
    """L_F, R_F from the converter to e; behind it, of an LCL filter, C_F, and L_g, R_g to the
    terminals at v (2,).
    """
    if m.filter == "L":
        i = states.add("plant.i_g", 2)

        def drive_l(u_r: ca.SX, omega: ca.SX) -> None:
            states.moves(i, omega_0 / m.L_F * (u_r - v - m.R_F * i) - omega * J(i))

        return OutputFilter(v, v, i, i, drive_l)
    i_ti, e, i_g = states.add("plant.i_ti", 2), states.add("plant.e", 2), states.add("plant.i_g", 2)

    def drive_lcl(u_r: ca.SX, omega: ca.SX) -> None:
        states.moves(i_ti, omega_0 / m.L_F * (u_r - e - m.R_F * i_ti) - omega * J(i_ti))
        states.moves(e, omega_0 / m.C_F * (i_ti - i_g) - omega * J(e))
        states.moves(i_g, omega_0 / m.L_g * (e - v - m.R_g * i_g) - omega * J(i_g))

    return OutputFilter(v, e, i_ti, i_g, drive_lcl)


def closed(
    states: States,
    plant: OutputFilter,
    delta: ca.SX,
    v_DQ: ca.SX,
    r: ca.SX,
    further: Callable[[ca.SX], list[ca.SX]] = lambda pq: [],
) -> Dynamics:
    """The model of an inverter whose states all have their rates.

    delta : angle of its frame. r : set-points. further : what these obey beside the power asked
    for.
    """
    x, pq = states.x, ca.SX.sym("pq", 2)
    return Dynamics(
        states=tuple(states.names),
        f=ca.Function("f", [x, v_DQ, r], [states.x_dot], ["x", "v_DQ", "r"], ["x_dot"]),
        g=ca.Function("g", [x, v_DQ], [R(delta).T @ plant.i_g], ["x", "v_DQ"], ["i_DQ"]),
        asked=ca.Function("asked", [x, v_DQ, r, pq], [ca.vertcat(plant.power - pq, *further(pq))]),
    )
