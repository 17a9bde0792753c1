"""The port map: at which port one unknown transfer function would explain the whole misfit.

One complex number Delta for each frequency, shared by all operating points, is added to the model
at a port, and the parameters are fitted again. Where that reaches the noise, the port may be where
something is missing, and Delta is what is missing there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.fit.adequacy import is_adequate, p_value
from ibrid.fit.problem import Problem
from ibrid.fit.starts import high_frequency_seed
from ibrid.gap.ports.open_port import OpenPort
from ibrid.gap.ports.port_fit import MOST_STEPS, PortPoint, PortProblem, fit_port
from ibrid.gap.ports.ports import Port, ports
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram

#: Random starts of every port where none is adequate, and their spread without a prior.
FURTHER_STARTS = 4
SPREAD = 0.3
#: Steps from values that explain the data where the transfer is at its place.
FEW_STEPS = 5
#: Digits of chi2 per degree of freedom by which ports are ranked, so that equivalent ones come in
#: the same order on every machine.
RANK_DIGITS = 6


@dataclass(frozen=True, eq=False)
class PortFit:
    """What an unknown transfer function at one port explains.

    Parameters
    ----------
    port : Port
        Where it is.
    chi2, dof, chi2_per_dof : float
        Of the data; the degrees of freedom are 8 K M less 2 K and what the data say of the
        parameters.
    p_value : float
        Probability of a larger chi2 by noise alone.
    adequate : bool
        Whether the p value is above 1e-3.
    frequency : ndarray
        (K,) Hz.
    transfer, deviation : ndarray
        (K,) complex Delta, and the standard error of its real or imaginary part, the larger; 5 or
        more where the data do not determine it.
    values : mapping
        Fitted parameters by name.
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
    """Fit an unknown transfer function at every port of a legal diagram.

    Parameters
    ----------
    sweep : Sweep
        Every point with `sigma`, all on one frequency grid.
    prior : mapping
        Nominal values of free parameters with tolerances.
    starts : sequence of mapping
        Parameter values, each of which is tried; what they lack is the nominal or typical value.
    scale : float
        Factor on sigma.
    only : sequence of str
        Names of ports; None: all of them.
    few_steps : bool
        Take a few steps from the starts alone.

    Returns
    -------
    tuple of PortFit
        Least chi2 per degree of freedom first; without ports at which the model has no response.

    Raises
    ------
    IbridError
        Sigma is missing, grids differ, or a name is unknown.
    """
    _require_common_grid(sweep)
    searches = [
        _PortSearch(port, kinds, sweep, prior, scale)
        for port in _select_ports(diagram, kinds, only)
    ]
    if few_steps:
        quick_fits = []
        for search in searches:
            x = [search.problem.parameter_prior.start(start) for start in starts]
            quick_fits.append(search.fit_from(x, FEW_STEPS))
        return _rank_fits(quick_fits)
    fits = [search.fit_from(search.list_starts(starts)) for search in searches]
    if not any(fit is not None and fit.adequate for fit in fits):
        further = [
            search.fit_from(search.sample_starts(np.random.default_rng(0))) for search in searches
        ]
        fits = [min(pair, key=_rank_key) for pair in zip(fits, further, strict=True)]
    return _rank_fits(fits)


def _rank_fits(fits: Sequence[PortFit | None]) -> tuple[PortFit, ...]:
    return tuple(sorted((fit for fit in fits if fit is not None), key=_rank_key))


def _rank_key(fit: PortFit | None) -> float:
    """Return the rounded chi2 per degree of freedom; infinite without a fit."""
    return np.inf if fit is None else float(f"{fit.chi2_per_dof:.{RANK_DIGITS}g}")


def _require_common_grid(sweep: Sweep) -> None:
    """Raise IbridError where sigma is missing or frequency grids differ."""
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
    """Return the ports of a diagram by name; IbridError for an unknown name."""
    available = ports(diagram, kinds)
    if only is None:
        return available
    names = [port.name for port in available]
    unknown = [name for name in only if name not in names]
    if unknown:
        raise IbridError(f"the diagram has no port {unknown[0]!r}; {near(unknown[0], names)}")
    return tuple(port for port in available if port.name in only)


class _PortSearch:
    """The fits of one port to a sweep with M operating points and K frequencies."""

    def __init__(
        self, port: Port, kinds: Vocabulary, sweep: Sweep, prior: Prior, scale: float
    ) -> None:
        self.port = port
        self.sweep = sweep
        self.model = OpenPort(port, kinds, sweep)
        self.parameters = self.model.symbolic.parameters
        self.names = [parameter.name for parameter in self.parameters]
        self._require_names(prior, "the prior")
        parameter_prior = ParameterPrior(self.parameters, prior)
        data = np.stack([point.admittance for point in sweep.points], axis=1)
        sigma = np.stack([np.asarray(point.sigma) for point in sweep.points], axis=1)
        self.problem = PortProblem(data, 1.0 / (scale * sigma), parameter_prior)

    def list_starts(self, starts: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        """Return starts x (P,) by name, and each with the grid side that the data show.

        The nominal values without any start.
        """
        x = []
        for start in starts or ({},):
            self._require_names(start, "a start")
            x.append(self.problem.parameter_prior.start(start))
        if self.grid_side:
            x += [self._with_grid_side(start) for start in x]
        return x

    def sample_starts(self, rng: np.random.Generator) -> list[np.ndarray]:
        """Sample starts x (P,) around the nominal values, with the grid side that the data show."""
        nominal = self.problem.parameter_prior.start({})
        width = self.problem.parameter_prior.width(nominal, SPREAD)
        offsets = width * rng.standard_normal((FURTHER_STARTS, len(width)))
        return [self._with_grid_side(nominal + offset) for offset in offsets]

    def fit_from(self, starts: Sequence[np.ndarray], steps: int = MOST_STEPS) -> PortFit | None:
        """Fit from starts x (P,); None without a response."""
        point = fit_port(self.model, self.problem, starts, steps)
        return None if point is None else self._summarise(point)

    def _require_names(self, values: Mapping[str, object], what: str) -> None:
        """Raise IbridError for a name that is no free parameter."""
        unknown = [name for name in values if name not in self.names]
        if unknown:
            raise IbridError(
                f"{what} names {unknown[0]!r}, which is no free parameter; "
                f"{near(unknown[0], self.names)}"
            )

    @cached_property
    def grid_side(self) -> dict[str, float]:
        """Parameters of the grid side of an LCL filter, as the highest frequencies show them."""
        names = {
            member: parameter.name for parameter in self.parameters for member in parameter.members
        }
        plants = [module for module, key in names if key == "C_F"]
        if not plants:
            return {}
        plant = plants[0]
        problem = Problem(self.model.symbolic, self.sweep.points)
        seed = high_frequency_seed(problem, self.sweep.omega_0)
        return {names[plant, key]: value for key, value in seed.items() if (plant, key) in names}

    def _with_grid_side(self, x: np.ndarray) -> np.ndarray:
        """Return x (P,) with the grid side that the data show."""
        is_grid_side = [name in self.grid_side for name in self.names]
        return np.where(is_grid_side, self.problem.parameter_prior.start(self.grid_side), x)

    def _summarise(self, point: PortPoint) -> PortFit:
        """Return the fit at a point, with degrees of freedom and standard errors.

        What neither data nor prior determine of a parameter lies within its bounds.
        """
        coordinates = self.model.coordinates
        theta = coordinates.to_theta(point.x)
        by_bounds = (coordinates.x_high - coordinates.x_low) ** -2.0
        prior_information = point.prior_information + by_bounds
        covariance = _invert_scaled(point.information + np.diag(prior_information))
        information_on_g = point.transfer_information + self.problem.prior_weight(point.g)
        by_prior = float(prior_information @ np.diag(covariance))
        determined = 2 * float((point.transfer_information / information_on_g).sum())
        free = determined + len(prior_information) - by_prior
        variance_by_x = [
            np.einsum("kp,pq,kq->k", part, covariance, part)
            for part in (np.real(point.transfer_by_x), np.imag(point.transfer_by_x))
        ]
        dof = max(self.problem.data.size * 2 - free, 1.0)
        return PortFit(
            port=self.port,
            chi2=point.chi2,
            dof=dof,
            chi2_per_dof=point.chi2 / dof,
            p_value=p_value(point.chi2, dof),
            adequate=is_adequate(point.chi2, dof),
            frequency=self.sweep.points[0].frequency,
            transfer=point.g - 1.0,
            deviation=np.sqrt(1.0 / information_on_g + np.maximum(*variance_by_x)),
            values=dict(zip(self.names, theta.tolist(), strict=True)),
        )


def _invert_scaled(matrix: np.ndarray) -> np.ndarray:
    """Invert a positive definite matrix (P, P), scaled to a diagonal of 1."""
    unit = np.diag(matrix) ** -0.5
    values, vectors = np.linalg.eigh(matrix * unit[:, None] * unit)
    root = unit[:, None] * vectors / np.sqrt(np.maximum(values, np.finfo(float).eps))
    return root @ root.T
