"""A study: the measured device and how it is looked at, said once and passed whole."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cached_property
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict, Unpack

from ibrid.border import DEFAULTS, methods_take_kinds, require_kinds
from ibrid.errors import IbridError, OperatingPointError, near
from ibrid.fit.objective import objective_for
from ibrid.fit.settings import FitSettings, require_one_of
from ibrid.frozen import FrozenDict
from ibrid.measurement.conventions.contradictions import check_conventions
from ibrid.measurement.quality.plausibility import implausible_numbers
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.recordings.transformed import transformed
from ibrid.measurement.sweeps.noise import with_sigma
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import NAMED_VOCABULARIES, VOCABULARY, Vocabulary, choose_vocabulary
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.compiling.check import Examination
from ibrid.structure.compiling.compiled import CompiledDiagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.network.outside import NOTHING, Outside
from ibrid.structure.network.port_file import read_port
from ibrid.structure.reading.parameters import EQUILIBRIA

#: `shared`: one set of parameters fitted jointly over all operating points; `per-op`: a set for
#: each, as in the paper.
PARAMETER_MODES = ("shared", "per-op")
#: What is thought of the labels of data: they are believed, or p, q, v, base, signs, node and frame
#: may be written wrongly.
LABELLED = ("exact", "uncertain")


class StudyOptions(TypedDict, total=False):
    """The keywords of `Study`, for whoever passes them on."""

    parameters: str
    equilibrium: str
    vocabulary: str | Sequence[ModuleKind]
    holdout_op: str | Sequence[str]
    seed: int
    port: Outside | str | PathLike[str] | None
    network: Outside | str | PathLike[str] | None
    labels: str


#: What the keywords are where nothing is said of them; `network` is another name of `port`.
DEFAULTS[StudyOptions] = {
    "parameters": "shared",
    "equilibrium": "exact",
    "vocabulary": "extended",
    "holdout_op": (),
    "seed": 0,
    "port": None,
    "network": None,
    "labels": "exact",
}


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Study:
    """What is measured, and what does not change while diagrams are compared with it.

    Parameters
    ----------
    sweep : measured operating points; a sigma that their repeats tell is filled in. Of records
    alone what they
        show of small departures. events : those records, where nothing else was measured; `of`
        makes such a study.
    parameters : "shared" or "per-op" (`PARAMETER_MODES`). equilibrium : "exact" (computed) or
    "paper" (fitted numbers).
    vocabulary : "extended", "paper" or kinds of one's own.
    holdout_op : names of operating points kept out of every fit and predicted; needs shared
    parameters and "exact".
    seed : of everything random.
    port : passive elements between the PCC and the filter (`structure.port_file.read_port`); needs
    the exact equilibrium.
    labels : "exact" or "uncertain" (`LABELLED`); uncertain ones need shared parameters and the
    exact equilibrium.
    devices : inverters behind the terminals at most; with 1 the kinds that divide power between two
    are left out. These follow from the others, once. kinds, held : of the vocabulary; names of the
    held-out points. fitted, held_out : the operating points that are fitted, and those that are
    predicted. groups : fitted ones that share their parameters, all of them
    or each for itself. physics : the words with which a model is assembled, equilibrium, power_node
    and omega_0 (rad/s).

    Raises
    ------
    IbridError : an option that does not exist, an operating point that the sweep lacks, or nothing
    left to fit.
    """

    sweep: Sweep
    _: KW_ONLY
    parameters: str = "shared"
    equilibrium: str = "exact"
    vocabulary: str | Sequence[ModuleKind] = "extended"
    holdout_op: str | Sequence[str] = ()
    seed: int = 0
    port: Outside = NOTHING
    labels: str = "exact"
    devices: int = 2
    events: Events | None = None
    kinds: Vocabulary = field(init=False, repr=False)
    held: tuple[str, ...] = field(init=False, repr=False)
    fitted: Sweep = field(init=False, repr=False)
    held_out: tuple[PointSweep, ...] = field(init=False, repr=False)
    groups: tuple[tuple[PointSweep, ...], ...] = field(init=False, repr=False)
    physics: Mapping[str, Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_kinds(self)
        require_one_of("parameters", self.parameters, PARAMETER_MODES)
        require_one_of("equilibrium", self.equilibrium, EQUILIBRIA)
        require_one_of("labels", self.labels, LABELLED)
        if not isinstance(self.seed, Integral) or self.seed < 0:
            raise IbridError(f"seed must be a whole number, 0 or more, found {self.seed}")
        held = (self.holdout_op,) if isinstance(self.holdout_op, str) else tuple(self.holdout_op)
        for name in held:
            if name not in self.sweep.names:
                raise OperatingPointError(
                    f"the data have no operating point {name!r} to hold out; "
                    f"{near(name, self.sweep.names)}"
                )
        if held and (self.parameters != "shared" or self.equilibrium != "exact"):
            raise IbridError(
                "a held-out operating point can be predicted only with shared parameters and the "
                "exact equilibrium; "
                "drop --holdout-op or the other options"
            )
        if self.labels != "exact" and (self.parameters != "shared" or self.equilibrium != "exact"):
            raise IbridError(
                "uncertain labels are told from the parameters by shared ones and the exact "
                "equilibrium alone; drop --labels "
                "or the other options"
            )
        if self.events is not None and (self.parameters, self.equilibrium, self.labels) != (
            "shared",
            "exact",
            "exact",
        ):
            raise IbridError(
                "events are fitted with shared parameters, the exact equilibrium and exact labels; "
                "leave those out"
            )
        if self.port and self.equilibrium != "exact":
            raise IbridError(
                "a port joins the operating point, which the paper's equilibrium fits; use the "
                "exact equilibrium"
            )
        if self.events is not None:
            self.events.require_moving(held)
            object.__setattr__(
                self, "port", replace(self.port, inside=False)
            )  # p and q at rest are those of the PCC
        if len(set(held)) >= len(self.sweep.points):
            raise IbridError("every operating point is held out; leave at least one to fit")
        object.__setattr__(self, "sweep", with_sigma(self.sweep))
        kinds = choose_vocabulary(self.vocabulary)
        object.__setattr__(
            self, "kinds", tuple(kind for kind in kinds if self.devices > 1 or not kind.shares)
        )
        sweep = self.sweep
        fitted = sweep.without(held) if held else sweep
        derived = {
            "held": held,
            "fitted": fitted,
            "held_out": tuple(sweep.point(name) for name in held),
            "groups": (fitted.points,)
            if self.parameters == "shared"
            else tuple((point,) for point in fitted.points),
            "physics": FrozenDict(
                equilibrium=self.equilibrium, power_node=sweep.power_node, omega_0=sweep.omega_0
            ),
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, data: "Sweep | Events | Study", **options: Unpack[StudyOptions]) -> "Study":
        """A study of a sweep, or of records alone; or the one that is given, with these options
        changed.
        """
        bases = data.sweep if isinstance(data, Study) else data
        said: dict[str, Any] = with_port(options, bases)
        if isinstance(data, Study):
            return replace(data, **said) if said else data
        if isinstance(data, Events):
            return cls(transformed(data), events=data, **said)
        return cls(data, **said)

    def placed(self, diagram: Diagram) -> Diagram:
        """A diagram behind the port."""
        return diagram.behind(self.port) if self.port else diagram

    @cached_property
    def blind(self) -> "Study":
        """The study as if what is held out had never been measured, for whoever must not see it."""
        events = self.events and self.events.only(*self.fitted.names)
        return replace(self, sweep=self.fitted, events=events, holdout_op=()) if self.held else self

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """What a look at the data alone finds doubtful: conventions that do not hold together,
        numbers that cannot be.
        """
        return (*check_conventions(self.sweep).warnings, *implausible_numbers(self.sweep))

    @cached_property
    def vocabulary_name(self) -> str:
        """A shipped vocabulary by its name; otherwise what is added to and left out of the extended
        one.
        """
        kinds = choose_vocabulary(self.vocabulary)
        for name, shipped in NAMED_VOCABULARIES.items():
            if kinds == shipped:
                return name
        added = [kind.name for kind in kinds if kind not in VOCABULARY]
        kept = {kind.name for kind in kinds}
        left_out = [kind.name for kind in VOCABULARY if kind.name not in kept]
        return (
            "extended"
            + "".join(f" + {name}" for name in added)
            + "".join(f" - {name}" for name in left_out)
        )

    @cached_property
    def examined(self) -> Examination:
        """The grammar, with a memory: (diagram, its canonical print) -> hash, violations and
        warnings.
        """
        return Examination(self.kinds, self.equilibrium)

    def compiled(self, diagram: Diagram) -> CompiledDiagram:
        """Compile a diagram behind the port, with the kinds and the equilibrium of the study."""
        return CompiledDiagram(self.placed(diagram), self.kinds, self.equilibrium)

    def hash_of(self, diagram: Diagram) -> str:
        """The structure's hash; DiagramError where a kind or port does not exist."""
        return structure_hash(diagram, self.kinds, equilibrium=self.equilibrium)

    def effort(
        self,
        settings: FitSettings | None = None,
        *,
        objective: str | None = None,
        restarts: int | None = None,
    ) -> FitSettings:
        """The effort of a fit, with what it minimises: `objective`, else that of `settings`, else
        what suits the data.
        """
        settings = settings or FitSettings()
        wanted = objective or settings.objective or objective_for(self.fitted.points)
        changed = {} if restarts is None else {"restarts": restarts}
        return replace(settings, objective=wanted, **changed)

    def __getstate__(self) -> dict[str, Any]:
        """The fields travel to workers, not what is derived from them when it is asked for."""
        return {one.name: getattr(self, one.name) for one in fields(self)}


def with_port(options: StudyOptions, data: Sweep | Events) -> dict[str, Any]:
    """The keywords with the port that `port` or `network` means: itself, or its file, read on the
    bases of the data.

    Raises IbridError where both are given.
    """
    said: dict[str, Any] = dict(options)
    told = [one for name in ("port", "network") if (one := said.pop(name, None)) is not None]
    if len(told) > 1:
        raise IbridError("network and port are two names of one thing; give one of them")
    if told:
        port = told[0]
        said["port"] = port if isinstance(port, Outside) else read_port(Path(port), data)
    return said
