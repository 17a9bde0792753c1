"""Two inverters behind one PCC, each a nonlinear model of its own: what is measured is the sum of
their currents.
"""

from dataclasses import dataclass
from math import isfinite

import casadi as ca

from ibrid.errors import IbridError
from ibrid.plants.dynamics import Dynamics, J
from ibrid.plants.gfl import GFLParameters, gfl_dynamics
from ibrid.plants.gfm import DroopParameters, gfm_dynamics


@dataclass(frozen=True, kw_only=True)
class ParallelParameters:
    """A grid-following and a grid-forming inverter at one PCC, both per unit on one base.

    following, forming : the two inverters. share_p, share_q : fractions of p and q at the PCC that
    the grid-following one delivers; the other delivers the rest.

    Raises IbridError when a share is not finite.
    """

    following: GFLParameters
    forming: DroopParameters
    share_p: float
    share_q: float

    def __post_init__(self) -> None:
        for name in ("share_p", "share_q"):
            if not isfinite(getattr(self, name)):
                raise IbridError(
                    f"{name} of two inverters must be a finite number; found {getattr(self, name)}."
                )


def parallel_dynamics(parameters: ParallelParameters, omega_0: float) -> Dynamics:
    """x = [x_following, x_forming], i_DQ the sum, r the set-points of both; p and q of each are
    those at the PCC.
    """
    m = parameters
    v_DQ, pq = ca.SX.sym("v_DQ", 2), ca.SX.sym("pq", 2)
    share = ca.vertcat(m.share_p, m.share_q)
    x, r, rates, asked, states = [], [], [], [], []
    current = ca.SX.zeros(2)
    for name, dynamics, part in (
        ("following", gfl_dynamics(m.following, omega_0), share),
        ("forming", gfm_dynamics(m.forming, omega_0), 1 - share),
    ):
        x.append(ca.SX.sym(f"x_{name}", len(dynamics.states)))
        r.append(ca.SX.sym(f"r_{name}", dynamics.set_points))
        i = dynamics.g(x[-1], v_DQ)
        rates.append(dynamics.f(x[-1], v_DQ, r[-1]))
        asked.append(ca.vertcat(ca.dot(v_DQ, i), ca.dot(v_DQ, J(i))) - part * pq)
        states += [f"{name}.{state}" for state in dynamics.states]
        current += i
    whole, set_points = ca.vertcat(*x), ca.vertcat(*r)
    return Dynamics(
        states=tuple(states),
        f=ca.Function(
            "f", [whole, v_DQ, set_points], [ca.vertcat(*rates)], ["x", "v_DQ", "r"], ["x_dot"]
        ),
        g=ca.Function("g", [whole, v_DQ], [current], ["x", "v_DQ"], ["i_DQ"]),
        asked=ca.Function("asked", [whole, v_DQ, set_points, pq], [ca.vertcat(*asked)]),
    )
