"""The output filter of a reference inverter in the frame of its controller: equation (2) of the paper, LCL or L."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import casadi as ca

from ibrid.plants.dynamics import J, States

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


@dataclass(frozen=True)
class OutputFilter:
    """Signals of the filter, (2,) each, in the controller's frame.

    v : the terminal voltage. e : the voltage that the controller measures, of the capacitor or of the terminals.
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
    """L_F, R_F from the converter to e; behind it, of an LCL filter, C_F, and L_g, R_g to the terminals at v (2,)."""
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
