"""What the gap workflow answers: verdict, what is missing and where, how sure, before and after;
and its JSON.
"""

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
    """A part of the data that the refitted model misses. `op` : operating point. `band` : Hz.
    `entry` : dd, dq, qd or qq.
    `share` : of the whole squared misfit. `z` : how significant, in standard deviations of a normal
    distribution.
    """

    op: str
    band: tuple[float, float]
    entry: str
    share: float
    z: float

    @property
    def place(self) -> tuple[str, str, str]:
        """In words."""
        return self.op, span(*self.band), self.entry


@dataclass(frozen=True)
class LocatedEventMisfit:
    """A part of a record that the refitted model misses.

    `window` : s. `component` : d or q. `share`, `z` : as of `LocatedMisfit`.
    """

    record: str
    window: tuple[float, float]
    component: str
    share: float
    z: float

    @property
    def place(self) -> tuple[str, str, str]:
        """In words."""
        return self.record, "{:.4g} s to {:.4g} s".format(*self.window), f"i_{self.component}"


@dataclass(frozen=True, eq=False)
class EventComparison(Frozen):
    """Records played by the refitted model, `before`, and by the repaired one, `after`. `swept` :
    there is a sweep, too.
    `floors` : of every record, those held out too, the NRMSE that noise and what sampling leaves
    open would leave.
    """

    before: "Playback"
    after: "Playback"
    swept: bool
    floors: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class NamedEffect(Frozen):
    """An effect and the edit that it asks for.

    `parameters` : name -> (estimate, low, high), 95 %. `evidence` : gain in chi2, threshold, p
    values, BIC difference to the runner-up, held-out errors. `indistinguishable_from` : ids of
    effects that these data cannot tell from it.
    """

    id: str
    change: str
    where: str
    parameters: Mapping[str, tuple[float, float | None, float | None]]
    evidence: Mapping[str, Any]
    indistinguishable_from: tuple[str, ...] = ()


@dataclass(frozen=True)
class Candidate(Frozen):
    """An edit that was fitted. `cost` : chi2 and prior. `gain` : cost of the baseline less its own.
    `bic` : cost with the price of its free numbers. `adequate` : fits as well as the noise allows.
    `stable` : None when nobody had to know.
    `reason` : why it is out, "" when it is not.
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
    """A parameter's nominal and refitted value; `deviations` : how far it moved, in its tolerance;
    `low`, `high` : 95 %.
    """

    name: str
    nominal: float
    refitted: float
    low: float | None
    high: float | None
    sigmas: float


@dataclass(frozen=True)
class UndetectableEffect:
    """An effect that this experiment could not have seen.

    `detectability` : noncentrality (chi2) that its typical strength would have had. `sweep` : which
    measurement would show it.
    """

    id: str
    change: str
    where: str
    detectability: float
    sweep: str


@dataclass(frozen=True)
class SuggestedEdit(Frozen):
    """An edit without a name in the catalogue, put to the tests of an effect.

    `words` : what it is. `source` : whose idea. `program` : the model with it. `chi2_per_dof` : of
    that, refitted; `before` : of the given model. `parameters` : those it adds. `held_out` : root
    mean square of the whitened error at held-out frequencies and operating points, before and
    after. `reason` : the test it fails, "" when it passes all.
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
    """A nonlinearity that was fitted.

    `gain` : fall of the cost below the linear model's. `significance_threshold` : as fitted.
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
    """`linearity` : the gate.

    `kept` : number of frequencies that the small-signal answer rests on. `words` : of the
    nonlinearity, "" where none is believed. `tried` : every place, the best first. `before`,
    `after`, `floor` : NRMSE over all amplitudes of the linear model, of that with the nonlinearity,
    and of noise alone. `port_gain` : of the place.
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
    """Answer of `find_gap`.

    `sentence` : the verdict in plain words. `located` : where the refitted baseline misses the
    data, worst first.
    `ports` : the port map, best first. `effects` : what is missing. `before`, `after` : NRMSE of
    the nominal model, the refit, and at held-out operating points; `noise_floor` : what noise alone
    would leave; None where unknown.
    `moved` : parameters with nominal values, furthest first. `candidates` : every edit tried, best
    first.
    `steps` : what was decided, in order, in words. `noise` : where the noise comes from.
    `noise_level` : what one that is not known was taken for, relative to |Y|. `program` : text
    after the repair. `baseline`, `repaired` : records of the refitted model before and after (the
    same when nothing was changed); they hold the parameters, responses and intervals. `sweep`,
    `held_out` : the measured data, fitted and not. `nominal` : responses of the model as it was
    given, by operating point. `null_space` : what the data cannot tell, in sentences.
    `angle` : of the measuring frame, rad. `convention` : in which the repaired model reads the
    data.
    `suggested` : where something is located and unnamed, edits that may explain it, what passes all
    tests first.
    `amplitude` : of data with several injection amplitudes, how the response depends on them; None
    for one amplitude.
    `events` : of records in time, how they are answered before and after.
    `effort`, `experiments` : how much was allowed, and the looks at edits and refits that were
    made. `complete` : False for an answer on the way, or when the effort was spent.
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
        """What the measurement says must act at the named or located place, frequency by frequency;
        None where none is.
        """
        from ibrid.gap.ports.missing_transfer import missing_transfer

        return missing_transfer(self)

    def __repr__(self) -> str:
        return brief(f"<Gap: {self.verdict}, {self.sentence}", ">")

    def plot(self, op: str | None = None, ax: Any = None, entry: str = "dd") -> Any:
        """A matplotlib figure for notebooks: before and after at an operating point, port map,
        measured transfer; with ax=(magnitude, phase) before and after of one entry, on those.
        """
        return shown(self, "plotting", "gap_figure", op, ax, entry)

    def save(self, path: str | PathLike[str]) -> None:
        """Write gap.json, replacing the file atomically."""
        write_json(Path(path), made_above(self, "ibrid.gap.results.files", "gap_json"))

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of the effects that were tried, as they are ranked."""
        names = ("id", "change", "where", "gain", "bic", "free_parameters", "adequate", "reason")
        rows = [{name: getattr(one, name) for name in names} for one in self.candidates]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def _repr_html_(self) -> str:
        """Verdict, what is missing, before and after, for notebooks."""
        return shown(self, "pages.gap_page", "gap_html")
