"""The result of the gap workflow: verdict, what is missing and where, with evidence."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ibrid.border import methods_take_kinds
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.gap.amplitudes.port_gain import PortGain
from ibrid.gap.ports.port_map import PortFit
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.sweeps.linearity import Linearity
from ibrid.measurement.sweeps.quantities import span
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.showing import brief, made_above, shown
from ibrid.structure.diagrams.program import parse_program
from ibrid.writing import write_json

if TYPE_CHECKING:
    from ibrid.gap.ports.missing_transfer import MissingTransfer
    from ibrid.playback.compare import Playback
    from ibrid.structure.diagrams.diagram import Diagram

SCHEMA = "ibrid.gap/1"
Verdict = Literal[
    "no-gap", "parameters-only", "named", "located-unnamed", "unexplained", "data-convention"
]


@dataclass(frozen=True)
class LocatedMisfit:
    """A part of a sweep that the refitted model misses.

    Parameters
    ----------
    op : str
        Operating point.
    band : tuple of float
        Hz.
    entry : str
        dd, dq, qd or qq.
    share : float
        Part of the squared misfit.
    z : float
        Significance, in standard deviations of a normal distribution.
    """

    op: str
    band: tuple[float, float]
    entry: str
    share: float
    z: float

    @property
    def place(self) -> tuple[str, str, str]:
        """Operating point, band and entry in words."""
        return self.op, span(*self.band), self.entry


@dataclass(frozen=True)
class LocatedEventMisfit:
    """A part of a record that the refitted model misses.

    Parameters
    ----------
    window : tuple of float
        s.
    component : str
        d or q.
    share, z : float
        As of `LocatedMisfit`.
    """

    record: str
    window: tuple[float, float]
    component: str
    share: float
    z: float

    @property
    def place(self) -> tuple[str, str, str]:
        """Record, window and component in words."""
        return self.record, "{:.4g} s to {:.4g} s".format(*self.window), f"i_{self.component}"


@dataclass(frozen=True, eq=False)
class EventComparison(Frozen):
    """The recordings beside the simulated response before and after the repair.

    Parameters
    ----------
    before, after : Playback
        Of the refitted model and of the repaired one.
    swept : bool
        Whether there is a sweep, too.
    floors : mapping
        NRMSE that noise and sampling alone would leave, of every record, those held out included.
    """

    before: "Playback"
    after: "Playback"
    swept: bool
    floors: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class NamedEffect(Frozen):
    """An effect and the edit that it asks for.

    Parameters
    ----------
    id, change, where : str
        Effect of the catalogue, "add", "remove" or "replace", and the location in the program.
    parameters : mapping
        Name -> (estimate, low, high), with the 95 % confidence interval.
    evidence : mapping
        Gain in chi2, threshold, p values, BIC difference to the runner-up, validation errors.
    indistinguishable_from : tuple of str
        Ids of effects that these data cannot distinguish from it.
    """

    id: str
    change: str
    where: str
    parameters: Mapping[str, tuple[float, float | None, float | None]]
    evidence: Mapping[str, Any]
    indistinguishable_from: tuple[str, ...] = ()


@dataclass(frozen=True)
class Candidate(Frozen):
    """An edit that was fitted.

    Parameters
    ----------
    cost, gain : float
        chi2 plus prior penalty, and its decrease from the baseline.
    bic : float
        Bayesian information criterion.
    free_parameters : int
        Of the model with the edit.
    adequate : bool
        Whether that fits as well as the noise allows.
    stable : bool or None
        None where it was not determined.
    reason : str
        Why it is rejected, "" where it is not.
    parameters : mapping
        Values of the parameters that the edit adds.
    """

    id: str
    change: str
    where: str
    cost: float
    gain: float
    bic: float
    free_parameters: int
    adequate: bool
    stable: bool | None
    reason: str
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ParameterChange:
    """The nominal and the refitted value of a parameter.

    Parameters
    ----------
    low, high : float or None
        95 % confidence interval of the refitted value.
    sigmas : float
        Change in standard deviations of its tolerance.
    """

    name: str
    nominal: float
    refitted: float
    low: float | None
    high: float | None
    sigmas: float


@dataclass(frozen=True)
class UndetectableEffect:
    """An effect that this experiment would not have shown.

    Parameters
    ----------
    detectability : float
        Noncentrality (chi2) that its typical strength would have had.
    sweep : str
        Which measurement would show it.
    """

    id: str
    change: str
    where: str
    detectability: float
    sweep: str


@dataclass(frozen=True)
class SuggestedEdit(Frozen):
    """An edit without a name in the catalogue, put to the tests of a named effect.

    Parameters
    ----------
    words, source : str
        The edit in words, and who or what suggested it.
    program : str
        Text of the model with it.
    chi2_per_dof, before : float
        chi2 per degree of freedom of that model, refitted, and of the given one.
    parameters : mapping
        Values of the parameters that it adds.
    held_out : mapping
        Validation errors before and after, whitened rms; empty where a test fails.
    reason : str
        The test that it fails, "" where it passes all.
    """

    words: str
    source: str
    program: str
    chi2_per_dof: float
    before: float
    parameters: Mapping[str, float] = field(default_factory=dict)
    held_out: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    reason: str = ""


@dataclass(frozen=True)
class NonlinearityTrial:
    """A nonlinearity that was fitted to all injection amplitudes.

    Parameters
    ----------
    gain : float
        Decrease of the cost from that of the linear model.
    threshold : float
        Fitted, per unit.
    """

    id: str
    words: str
    where: str
    gain: float
    chi2_per_dof: float
    p_value: float
    threshold: float


@dataclass(frozen=True, eq=False)
class AmplitudeResult:
    """How the response depends on the injection amplitude, and what explains that.

    Parameters
    ----------
    linearity : Linearity
        The test of linearity.
    kept : int
        Frequencies on which the small-signal result rests.
    words, parameter : str
        Of the accepted nonlinearity and its threshold; "" where none is accepted.
    tried : tuple of NonlinearityTrial
        Every nonlinearity at every port, the best first.
    before, after, floor : float or None
        NRMSE over all amplitudes: of the linear model, with the nonlinearity, and of noise alone.
    port_gain : PortGain or None
        Measured gain of the port of the nonlinearity.
    """

    linearity: Linearity
    kept: int
    words: str = ""
    parameter: str = ""
    tried: tuple[NonlinearityTrial, ...] = ()
    before: float | None = None
    after: float | None = None
    floor: float | None = None
    port_gain: PortGain | None = None


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Gap(Frozen):
    """Result of `find_gap`.

    Parameters
    ----------
    verdict, sentence : str
        The verdict, and its report in words.
    located : tuple of LocatedMisfit or LocatedEventMisfit
        Where the refitted given model misses the data, worst first.
    ports : tuple of PortFit
        The port map: where one unknown transfer function would explain the misfit, best first.
    effects : tuple of NamedEffect
        What is missing.
    before, after : mapping
        NRMSE "nominal", "refit" and "holdout" (operating points held out) of the given and of the
        repaired model; None where unknown.
    noise_floor : float or None
        NRMSE that noise alone would leave; None where unknown.
    moved : tuple of ParameterChange
        Parameters with nominal values, furthest first.
    could_not_have_seen : tuple of UndetectableEffect
        Effects that this experiment would not have shown.
    candidates : tuple of Candidate
        Every edit that was tried, best first.
    steps : tuple of str
        What was decided, in order.
    noise, noise_level : str and float
        Where the noise comes from, and the level that an unknown one was taken to have, relative
        to |Y|.
    null_space : tuple of str
        What the data do not determine, in sentences.
    given, program : str
        Text of the given and of the repaired program.
    baseline, repaired : Record
        Of the refitted given model and of the repaired one (the same where nothing was changed),
        with parameters, responses and intervals.
    sweep, held_out : Sweep and tuple of str
        The measured data, and the names of what was not fitted.
    nominal : mapping
        Responses (K, 2, 2) of the model as given, by operating point.
    angle, convention : float and Convention
        Angle of the measuring frame in rad, and the convention in which the repaired model reads
        the data.
    suggested : tuple of SuggestedEdit
        Where something is located and has no name, edits that may explain it, the best first.
    amplitude : AmplitudeResult or None
        Of data with several injection amplitudes.
    events : EventComparison or None
        Of recordings.
    effort, experiments, complete : str, int and bool
        The allowed effort, the fits and screening fits that were made, and False for an
        intermediate result or an exhausted effort.
    """

    verdict: Verdict
    sentence: str
    located: tuple[LocatedMisfit | LocatedEventMisfit, ...]
    ports: tuple[PortFit, ...]
    effects: tuple[NamedEffect, ...]
    before: Mapping[str, float | None]
    after: Mapping[str, float | None]
    noise_floor: float | None
    moved: tuple[ParameterChange, ...]
    could_not_have_seen: tuple[UndetectableEffect, ...]
    candidates: tuple[Candidate, ...]
    steps: tuple[str, ...]
    noise: str
    noise_level: float
    null_space: tuple[str, ...]
    given: str
    program: str
    baseline: Record
    repaired: Record
    sweep: Sweep
    held_out: tuple[str, ...] = ()
    nominal: Mapping[str, np.ndarray] = field(default_factory=dict)
    angle: float = 0.0
    convention: Convention = field(default_factory=Convention)
    suggested: tuple[SuggestedEdit, ...] = ()
    amplitude: AmplitudeResult | None = None
    events: EventComparison | None = None
    effort: str = "normal"
    experiments: int = 0
    complete: bool = True

    @property
    def diagram(self) -> "Diagram":
        """The repaired block diagram."""
        return parse_program(self.program, "the repaired program")

    @cached_property
    def missing_transfer(self) -> "MissingTransfer | None":
        """The transfer function that the measurement shows at the named or located port.

        None where there is none.
        """
        from ibrid.gap.ports.missing_transfer import missing_transfer

        return missing_transfer(self)

    def __repr__(self) -> str:
        return brief(f"<Gap: {self.verdict}, {self.sentence}", ">")

    def plot(self, op: str | None = None, ax: Any = None, entry: str = "dd") -> Any:
        """Plot before and after at an operating point, port map and measured transfer function.

        With ax=(magnitude, phase), plot before and after of one entry on those axes.
        """
        return shown(self, "plotting", "gap_figure", op, ax, entry)

    def save(self, path: str | PathLike[str]) -> None:
        """Write gap.json, replacing the file atomically."""
        write_json(Path(path), made_above(self, "ibrid.gap.results.files", "gap_json"))

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame of the candidates, as they are ranked."""
        names = ("id", "change", "where", "gain", "bic", "free_parameters", "adequate", "reason")
        rows = [{name: getattr(candidate, name) for name in names} for candidate in self.candidates]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def _repr_html_(self) -> str:
        """Return the HTML of verdict, effects, before and after, for notebooks."""
        return shown(self, "pages.gap_page", "gap_html")
