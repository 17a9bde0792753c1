"""Sweeps at several injection amplitudes as a dataset of the gap workflow.

An edit adds a nonlinearity at a port of the linear model.
"""

from collections.abc import Sequence
from dataclasses import replace

from ibrid.gap.amplitudes.amplitude_data import AmplitudeData
from ibrid.gap.amplitudes.nonlinearity_edits import NonlinearityEdit, list_nonlinearity_edits
from ibrid.gap.amplitudes.nonlinearity_fit import NonlinearityFit, NonlinearityFitter
from ibrid.gap.budget import Budget
from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.ports.port_map import PortFit, port_map
from ibrid.gap.refitting.model import Model, Values
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.prior import Prior
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram

#: Random starts of the linear model, whose parameters the fits begin with.
DRAWS = 32


class AmplitudeDataset(Dataset):
    """Sweeps at all injection amplitudes together.

    The linear model is fitted to their mean; what they differ by is added to its chi2. One
    nonlinearity alone is tried, without other conventions and cross-validation. There is no port
    map, since no linear transfer function explains several amplitudes; `map_each_amplitude` locates
    it for each amplitude where no nonlinearity explains the data.

    Parameters
    ----------
    data : AmplitudeData
        The measured data.
    kinds : Vocabulary
        Module kinds of the diagram.
    prior : Prior
        Nominal values with tolerances.
    seed : int
        Of the random starts.
    budget : Budget
        Of the search.
    """

    def __init__(
        self,
        data: AmplitudeData,
        kinds: Vocabulary,
        prior: Prior,
        seed: int,
        budget: Budget | None = None,
    ) -> None:
        super().__init__(budget)
        self.data = data
        self.kinds = kinds
        self.prior = prior
        self.noise = Noise(data.pooled, True, "")
        self.sweep_fitter = SweepFitter(self.noise, kinds, prior, seed)
        self._fits: dict[NonlinearityEdit, NonlinearityFit | None] = {}

    def _fit_given(self, diagram: Diagram) -> Model | None:
        """Fit the linear model to the mean over the amplitudes."""
        fit = self.sweep_fitter.fit(diagram, [{}], draws=DRAWS)
        if fit is None:
            return None
        fit = replace(fit, chi2=fit.chi2 + self.data.chi2_within)
        return Model(diagram, Convention(), fit)

    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """Return the linear model unchanged: values with a nonlinearity are no start of it."""
        return model

    def insertions(self, model: Model) -> tuple[NonlinearityEdit, ...]:
        """List every nonlinearity at every port of the linear model; () of another."""
        return () if model.edits else list_nonlinearity_edits(model.diagram, self.kinds)

    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """Fit a nonlinearity: its threshold and the parameters, to all amplitudes, once."""
        if not isinstance(insertion, NonlinearityEdit):
            return None
        if insertion not in self._fits:
            fitter = NonlinearityFitter(insertion, model.diagram, self.kinds, self.data, self.prior)
            self._fits[insertion] = fitter.fit([model.refit.values, {}])
        fit = self._fits[insertion]
        return None if fit is None else replace(model, refit=fit, edits=(insertion,))

    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """Return the fit itself: fewer steps would not rank nonlinearities."""
        return self._fit_edit(model, insertion, quick=())

    def is_stable(self, model: Model) -> bool:
        """Whether a nonlinearity is accepted: adequate, with an identifiable threshold."""
        fit = model.refit
        return isinstance(fit, NonlinearityFit) and fit.is_adequate() and fit.is_identifiable

    def map_each_amplitude(self, diagram: Diagram) -> tuple[PortFit, ...]:
        """Compute a port map for each amplitude by itself, and return the worst fit of each port.

        Of the ports at which nonlinearities are tried; the least chi2 per degree of freedom first.
        """
        edits = list_nonlinearity_edits(diagram, self.kinds)
        names = list(dict.fromkeys(edit.port.name for edit in edits))
        if not names:
            return ()
        maps: list[dict[str, PortFit]] = []
        for level in range(self.data.amplitude.shape[2]):
            if not (self.data.weight[:, :, level] > 0).all():
                continue
            sweep = self._sweep_at(level)
            fits = port_map(diagram, self.kinds, sweep, self.prior, [{}], only=names)
            self.budget.spend(len(fits))
            maps.append({fit.port.name: fit for fit in fits})
        worst_fits: list[PortFit] = []
        for name in names:
            if all(name in fits for fits in maps):
                worst_fits.append(max((fits[name] for fits in maps), key=_misfit_per_dof))
        return tuple(sorted(worst_fits, key=_misfit_per_dof))

    def _sweep_at(self, level: int) -> Sweep:
        """Return the sweep of one amplitude, by its number."""
        points = [
            replace(
                point,
                admittance=self.data.admittance[:, m, level],
                sigma=1.0 / self.data.weight[:, m, level],
                amplitude=None,
            )
            for m, point in enumerate(self.data.sweep.points)
        ]
        return replace(self.data.sweep, points=tuple(points))


def _misfit_per_dof(fit: PortFit) -> float:
    return fit.chi2_per_dof
