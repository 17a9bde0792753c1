"""Sweeps at several injection amplitudes as a kind of data: an edit is a nonlinearity at a port of
the linear model.
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
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram

#: Random starts of the linear model, whose parameters the fits begin with.
DRAWS = 32


class AmplitudeDataset(Dataset):
    """Sweeps at all injection amplitudes together, as a dataset.

    The linear model is fitted to their mean; what they differ by is added to its chi2. One
    nonlinearity alone is tried, without other conventions and cross-validation. No linear transfer
    explains several amplitudes; `at_each_amplitude` locates it for each where no nonlinearity
    does.
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
        self.data, self.kinds, self.prior = data, kinds, prior
        self.noise = Noise(data.pooled, True, "")
        self.sweep_fitter = SweepFitter(self.noise, kinds, prior, seed)
        self._fits: dict[NonlinearityEdit, NonlinearityFit | None] = {}

    def _fit_given(self, diagram: Diagram) -> Model | None:
        """The linear model."""
        refit = self.sweep_fitter.fit(diagram, [{}], draws=DRAWS)
        return (
            None
            if refit is None
            else Model(diagram, Convention(), replace(refit, chi2=refit.chi2 + self.data.within))
        )

    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """The linear model as it is: what a nonlinearity ends in is no start of it."""
        return model

    def insertions(self, model: Model) -> tuple[NonlinearityEdit, ...]:
        """Every nonlinearity at every place of the linear model."""
        return () if model.edits else list_nonlinearity_edits(model.diagram, self.kinds)

    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """A nonlinearity, its threshold and the parameters fitted to all amplitudes; once for
        each.
        """
        if not isinstance(insertion, NonlinearityEdit):
            return None
        if insertion not in self._fits:
            search = NonlinearityFitter(insertion, model.diagram, self.kinds, self.data, self.prior)
            self._fits[insertion] = search.best([model.refit.values, {}])
        fit = self._fits[insertion]
        return None if fit is None else replace(model, refit=fit, edits=(insertion,))

    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """The fit itself: less says nothing."""
        return self._fit_edit(model, insertion, quick=())

    def is_stable(self, model: Model) -> bool:
        """True for a nonlinearity that may be believed: adequate for errors that grow with the
        measured distortion, and its threshold held by the data.
        """
        fit = model.refit
        return isinstance(fit, NonlinearityFit) and fit.is_adequate() and fit.seen

    def at_each_amplitude(self, diagram: Diagram) -> tuple[PortFit, ...]:
        """Ports of nonlinearities at which one unknown transfer explains each amplitude by itself;
        the worst amplitude's fit.
        """
        names = list(
            dict.fromkeys(one.port.name for one in list_nonlinearity_edits(diagram, self.kinds))
        )
        if not names:
            return ()
        data, by_level = self.data, []
        for level in range(data.amplitude.shape[2]):
            if not (data.weight[:, :, level] > 0).all():
                continue
            points = tuple(
                replace(
                    point,
                    admittance=data.admittance[:, m, level],
                    sigma=1.0 / data.weight[:, m, level],
                    amplitude=None,
                )
                for m, point in enumerate(data.sweep.points)
            )
            sweep = replace(data.sweep, points=points)
            fits = port_map(diagram, self.kinds, sweep, self.prior, [{}], only=names)
            self.budget.spend(len(fits))
            by_level.append({fit.port.name: fit for fit in fits})
        worst = [
            max((level[name] for level in by_level), key=lambda fit: fit.chi2_per_dof)
            for name in names
            if all(name in level for level in by_level)
        ]
        return tuple(sorted(worst, key=lambda fit: fit.chi2_per_dof))
