"""The port map: which single unknown transfer, at which port, would explain the whole misfit.

One complex number Delta per frequency, shared by all operating points, joins the model at a port, and the parameters are
fitted anew. Where that reaches the noise, the port may be the place of what is missing, and Delta is what is missing there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from ibrid.errors import IbridError, near
from ibrid.gap.open_port import OpenPort
from ibrid.gap.port_fit import Fit, Target, fit_port
from ibrid.gap.ports import Port, ports
from ibrid.measurement.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import Diagram

#: A port whose fit is as bad as this by chance, or less rarely, is adequate.
ADEQUATE = 1e-3


@dataclass(frozen=True, eq=False)
class PortFit:
    """What an unknown transfer at one port explains.

    `chi2` : of the data. `dof` : its degrees of freedom, 8 K M less 2 K and what the data say of the parameters.
    `p_value` : chance of a larger chi2 if only noise is left. `adequate` : p_value above 1e-3. `frequency` : (K,) Hz.
    `transfer` : (K,) complex, the Delta that was found. `deviation` : (K,), standard error of its real or imaginary part,
    the larger; infinite where the data do not see it. `values` : fitted parameters.
    """

    port: Port
    chi2: float
    dof: float
    chi2_per_dof: float
    p_value: float
    adequate: bool
    frequency: np.ndarray
    transfer: np.ndarray
    deviation: np.ndarray
    values: Mapping[str, float]


def port_map(
    diagram: Diagram,
    kinds: Vocabulary,
    sweep: Sweep,
    prior: Mapping[str, tuple[float, float]],
    starts: Sequence[Mapping[str, float]],
    *,
    scale: float = 1.0,
    only: Sequence[str] | None = None,
) -> tuple[PortFit, ...]:
    """One fit for every port of a legal diagram, the least chi2 per degree of freedom first.

    Parameters
    ----------
    sweep : every point with `sigma`, all on one frequency grid. prior : free parameter -> (centre, width) in the
    coordinate of the search (ln for a positive box), a standard deviation; those without an entry have none.
    starts : parameter values, each of which is tried; a name that one lacks gets the prior's centre, else a typical value.
    scale : factor on sigma. only : names of ports; None: all of them.

    Raises IbridError where sigma is missing, grids differ, a name is unknown, or nothing can be fitted.
    """
    _check(sweep)
    found = ports(diagram, kinds)
    if only is not None:
        names = [one.name for one in found]
        if unknown := [name for name in only if name not in names]:
            raise IbridError(f"the diagram has no port {unknown[0]!r}; {near(unknown[0], names)}")
        found = tuple(one for one in found if one.name in only)
    fits = [one for port in found if (one := _fitted(port, kinds, sweep, prior, starts, scale)) is not None]
    return tuple(sorted(fits, key=lambda one: one.chi2_per_dof))


def _check(sweep: Sweep) -> None:
    first = sweep.points[0].frequency
    for point in sweep.points:
        if point.sigma is None:
            raise IbridError(f"the port map needs sigma at operating point {point.op.name}; give it an estimate.")
        if not np.array_equal(point.frequency, first):
            raise IbridError(
                f"the port map needs one frequency grid at all operating points; {point.op.name} has another than "
                f"{sweep.points[0].op.name}, leave it out or keep the common frequencies."
            )


def _fitted(
    port: Port,
    kinds: Vocabulary,
    sweep: Sweep,
    prior: Mapping[str, tuple[float, float]],
    starts: Sequence[Mapping[str, float]],
    scale: float,
) -> PortFit | None:
    model = OpenPort(port, kinds, sweep)
    target = _target(model, sweep, prior, scale)
    begun = [fit_port(model, target, _start(model, prior, one)) for one in starts]
    ended = [one for one in begun if one is not None]
    if not ended:
        return None
    return _described(port, model, target, min(ended, key=lambda one: one.cost), sweep)


def _target(model: OpenPort, sweep: Sweep, prior: Mapping[str, tuple[float, float]], scale: float) -> Target:
    centre, precision = np.zeros(len(model.names)), np.zeros(len(model.names))
    for name, (middle, width) in prior.items():
        if name not in model.names:
            raise IbridError(f"the prior names {name!r}, which is no free parameter; {near(name, model.names)}")
        index = model.names.index(name)
        centre[index], precision[index] = middle, width**-2
    data = np.array([one.admittance for one in sweep.points])
    sigma = np.array([one.sigma for one in sweep.points])
    return Target(data, 1.0 / (scale * sigma), centre, precision)


def _start(model: OpenPort, prior: Mapping[str, tuple[float, float]], start: Mapping[str, float]) -> np.ndarray:
    if unknown := [name for name in start if name not in model.names]:
        raise IbridError(f"a start names {unknown[0]!r}, which is no free parameter; {near(unknown[0], model.names)}")
    typical = [start.get(one.name, one.typical) for one in model.symbolic.parameters]
    x = model.coordinates.to_x(np.array(typical, dtype=float))
    for index, name in enumerate(model.names):
        if name not in start and name in prior:
            x[index] = prior[name][0]
    return x


def _described(port: Port, model: OpenPort, target: Target, fit: Fit, sweep: Sweep) -> PortFit:
    """Degrees of freedom and standard errors; a parameter lies in its box, so that is the least that is known of it."""
    box = model.coordinates.x_high - model.coordinates.x_low
    covariance = np.linalg.inv(fit.information + np.diag(target.precision + box**-2.0))
    seen = (np.abs(fit.by_transfer) ** 2).sum(axis=1)
    dof = target.data.size * 2 - 2 * int((seen > 0).sum()) - float(np.trace(fit.information @ covariance))
    followed = [np.einsum("kp,pq,kq->k", part, covariance, part) for part in (fit.follows.real, fit.follows.imag)]
    with np.errstate(divide="ignore"):
        deviation = np.sqrt(1.0 / seen + np.maximum(*followed))
    dof = max(dof, 1.0)
    p_value = float(chi2_distribution.sf(fit.chi2, dof))
    theta = model.coordinates.to_theta(fit.x)
    return PortFit(
        port=port,
        chi2=fit.chi2,
        dof=dof,
        chi2_per_dof=fit.chi2 / dof,
        p_value=p_value,
        adequate=p_value > ADEQUATE,
        frequency=sweep.points[0].frequency,
        transfer=fit.g - 1.0,
        deviation=deviation,
        values=dict(zip(model.names, theta.tolist(), strict=True)),
    )
