"""The port map: which single unknown transfer, at which port, would explain the whole misfit.

One complex number Delta per frequency, shared by all operating points, joins the model at a port,
and the parameters are fitted anew. Where that reaches the noise, the port may be the place of what
is missing, and Delta is what is missing there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.adequacy import is_adequate, p_value
from ibrid.fit.problem import Problem
from ibrid.fit.starts import high_frequency_seed
from ibrid.gap.ports.open_port import OpenPort
from ibrid.gap.ports.port_fit import MOST_STEPS, PortPoint, PortProblem, fit_port
from ibrid.gap.ports.ports import Port, ports
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram

#: Further starts of every port where none is adequate, and how far they spread without a prior.
FURTHER, SPREAD = 4, 0.3
#: Steps of a look from values that explain all where the transfer is at its place.
LOOK = 5


@dataclass(frozen=True, eq=False)
class PortFit:
    """What an unknown transfer at one port explains.

    `chi2` : of the data. `dof` : its degrees of freedom, 8 K M less 2 K and what the data say of
    the parameters.
    `p_value` : chance of a larger chi2 if only noise is left. `is_adequate` : p_value above 1e-3.
    `frequency` : (K,) Hz.
    `transfer` : (K,) complex, the Delta that was found. `deviation` : (K,), standard error of its
    real or imaginary part, the larger; 5 or more where the data do not see it. `values` : fitted
    parameters.
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
    prior: Prior,
    starts: Sequence[Mapping[str, float]],
    *,
    scale: float = 1.0,
    only: Sequence[str] | None = None,
    few_steps: bool = False,
) -> tuple[PortFit, ...]:
    """One fit for every port of a legal diagram, the least chi2 per degree of freedom first.

    Parameters
    ----------
    sweep : every point with `sigma`, all on one frequency grid. prior : what is believed of free
    parameters.
    starts : parameter values, each of which is tried; a name that one lacks gets the nominal, else
    a typical value.
    scale : factor on sigma. only : names of ports; None: all of them. look : a few steps from the
    starts alone.

    A port at which the model has no response at any start is left out.
    Raises IbridError where sigma is missing, grids differ, or a name is unknown.
    """
    _require_common_grid(sweep)
    searches = [
        _PortSearch(port, kinds, sweep, prior, scale)
        for port in _select_ports(diagram, kinds, only)
    ]
    if few_steps:
        looks = [
            one.fit_from_vectors(
                [one.target.parameter_prior.start(start) for start in starts], LOOK
            )
            for one in searches
        ]
        return tuple(sorted((one for one in looks if one is not None), key=_rank_key))
    fits = [one.fit_from_vectors(one.vectors_from(starts)) for one in searches]
    if not any(fit is not None and fit.adequate for fit in fits):
        again = [
            one.fit_from_vectors(one.sample_vectors(np.random.default_rng(0))) for one in searches
        ]
        fits = [min((a, b), key=_rank_key) for a, b in zip(fits, again, strict=True)]
    return tuple(sorted((one for one in fits if one is not None), key=_rank_key))


def _rank_key(fit: PortFit | None) -> float:
    """To six digits, so that exact twins come in the order of the ports on every machine."""
    return np.inf if fit is None else float(f"{fit.chi2_per_dof:.6g}")


def _require_common_grid(sweep: Sweep) -> None:
    first = sweep.points[0]
    for point in sweep.points:
        if point.sigma is None:
            raise IbridError(
                f"the port map needs sigma at operating point {point.op.name}; give it an estimate."
            )
        if not np.array_equal(point.frequency, first.frequency):
            raise IbridError(
                f"the port map needs one frequency grid at all operating points; {point.op.name} "
                "has another than "
                f"{first.op.name}, keep the frequencies that they share."
            )


def _select_ports(
    diagram: Diagram, kinds: Vocabulary, only: Sequence[str] | None
) -> tuple[Port, ...]:
    available = ports(diagram, kinds)
    if only is None:
        return available
    names = [one.name for one in available]
    if unknown := [name for name in only if name not in names]:
        raise IbridError(f"the diagram has no port {unknown[0]!r}; {near(unknown[0], names)}")
    return tuple(one for one in available if one.name in only)


class _PortSearch:
    """The fits of one port."""

    def __init__(
        self, port: Port, kinds: Vocabulary, sweep: Sweep, prior: Prior, scale: float
    ) -> None:
        self.port, self.sweep = port, sweep
        self.model = OpenPort(port, kinds, sweep)
        self.parameters = self.model.symbolic.parameters
        self.names = [one.name for one in self.parameters]
        self._require(prior, "the prior")
        parameter_prior = ParameterPrior(self.parameters, prior)
        data = np.stack([one.admittance for one in sweep.points], axis=1)
        sigma = np.stack([np.asarray(one.sigma) for one in sweep.points], axis=1)
        self.target = PortProblem(data, 1.0 / (scale * sigma), parameter_prior)

    def vectors_from(self, starts: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        """The given starts, and each with the grid side that the data show; without one the nominal
        values.
        """
        vectors = []
        for start in starts or ({},):
            self._require(start, "a start")
            vectors.append(self.target.parameter_prior.start(start))
        return [*vectors, *(self._with_grid_side(x) for x in vectors if self.grid_side)]

    def sample_vectors(self, rng: np.random.Generator) -> list[np.ndarray]:
        """Starts around the nominal values, with that grid side."""
        middle = self.target.parameter_prior.start({})
        width = self.target.parameter_prior.width(middle, SPREAD)
        return [
            self._with_grid_side(middle + one)
            for one in width * rng.standard_normal((FURTHER, len(width)))
        ]

    def fit_from_vectors(
        self, starts: Sequence[np.ndarray], steps: int = MOST_STEPS
    ) -> PortFit | None:
        fit = fit_port(self.model, self.target, starts, steps)
        return None if fit is None else self._summarise(fit)

    def _require(self, named: Mapping[str, object], what: str) -> None:
        if unknown := [name for name in named if name not in self.names]:
            raise IbridError(
                f"{what} names {unknown[0]!r}, which is no free parameter; "
                f"{near(unknown[0], self.names)}"
            )

    @cached_property
    def grid_side(self) -> dict[str, float]:
        """Free parameters of the grid side of an LCL filter, as the top of the band shows them."""
        members = {member: one.name for one in self.parameters for member in one.members}
        plant = [name for name, parameter in members if parameter == "C_F"]
        if not plant:
            return {}
        seed = high_frequency_seed(
            Problem(self.model.symbolic, self.sweep.points), self.sweep.omega_0
        )
        return {
            members[plant[0], name]: value
            for name, value in seed.items()
            if (plant[0], name) in members
        }

    def _with_grid_side(self, x: np.ndarray) -> np.ndarray:
        return np.where(
            [name in self.grid_side for name in self.names],
            self.target.parameter_prior.start(self.grid_side),
            x,
        )

    def _summarise(self, fit: PortPoint) -> PortFit:
        """Degrees of freedom and standard errors; a parameter lies in its box, so that is the least
        known of it.
        """
        theta = self.model.coordinates.to_theta(fit.x)
        known = (
            fit.believed + (self.model.coordinates.x_high - self.model.coordinates.x_low) ** -2.0
        )
        covariance = _invert_scaled(fit.information + np.diag(known))
        known_of_g = fit.seen + self.target.prior_weight(fit.g)
        free = (
            2 * float((fit.seen / known_of_g).sum())
            + len(known)
            - float(known @ np.diag(covariance))
        )
        followed = [
            np.einsum("kp,pq,kq->k", part, covariance, part)
            for part in (np.real(fit.follows), np.imag(fit.follows))
        ]
        dof = max(self.target.data.size * 2 - free, 1.0)
        return PortFit(
            port=self.port,
            chi2=fit.chi2,
            dof=dof,
            chi2_per_dof=fit.chi2 / dof,
            p_value=p_value(fit.chi2, dof),
            adequate=is_adequate(fit.chi2, dof),
            frequency=self.sweep.points[0].frequency,
            transfer=fit.g - 1.0,
            deviation=np.sqrt(1.0 / known_of_g + np.maximum(*followed)),
            values=dict(zip(self.names, theta.tolist(), strict=True)),
        )


def _invert_scaled(matrix: np.ndarray) -> np.ndarray:
    """Of a positive definite matrix, in units that make its diagonal 1."""
    unit = np.diag(matrix) ** -0.5
    values, vectors = np.linalg.eigh(matrix * unit[:, None] * unit)
    root = unit[:, None] * vectors / np.sqrt(np.maximum(values, np.finfo(float).eps))
    return root @ root.T
