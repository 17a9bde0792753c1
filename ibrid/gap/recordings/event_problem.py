"""What is asked of records of events, alone or beside a sweep: model, data, what is believed, and
what is held out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.gap.budget import Budget
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_noise import event_noise
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.gap.refitting.prior import (
    OTHER_TOLERANCE,
    Nominal,
    NominalValue,
    Prior,
    build_prior,
    read_nominal_value,
)
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.recordings.fixed_steps import as_of_the_device, in_fixed_steps, step_of
from ibrid.measurement.sweeps.amplitudes import at_amplitudes
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary, choose_vocabulary
from ibrid.parts.editing.practice import Effect
from ibrid.playback.compare import limits_told, model_of_record
from ibrid.playback.limits import Limit, require_applicable
from ibrid.playback.places import places_of
from ibrid.playback.port import require_port_alone
from ibrid.structure.compiling.check import require_legal
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.network.outside import NOTHING
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.study import Study, StudyOptions, with_port

#: Why nothing fits records.
NO_REST = (
    "the model has no rest at p, q, v of the records (check them and the base), or is unstable "
    "when their voltage is played"
)


@dataclass(frozen=True, eq=False)
class EventProblem:
    """The question: the `diagram` as given with its `limits`, nominal `values`, all `events` with
    the names `held` out, and the `study` of the sweep beside them, None without one.
    """

    diagram: Diagram
    limits: tuple[Limit, ...]
    values: Nominal
    events: Events
    held: Sequence[str]
    study: Study | None
    kinds: Vocabulary
    seed: int

    @property
    def sweep(self) -> Sweep | None:
        """What was swept."""
        return None if self.study is None else self.study.sweep

    @property
    def fitted(self) -> Events:
        """The records that are not held out."""
        return self.events.only(*(name for name in self.events.names if name not in self.held))

    @cached_property
    def in_fixed_steps(self) -> "EventProblem | None":
        """The same of records, and a sweep, as a program of fixed steps makes them; None where none
        can have made these.
        """
        step = None if any(one.stepped for one in self.events.records) else step_of(self.events)
        if step is None:
            return None
        study = self.study
        if study is not None:
            study = replace(study, sweep=as_of_the_device(study.sweep, step))
        return replace(self, events=in_fixed_steps(self.events), study=study)

    def prior(self) -> dict[str, NominalValue]:
        """What the nominal values mean; those of limits as wide as any but the plant's.

        The tolerances of a port join where nothing was swept: the cost of a sweep has them.
        """
        boxes = {
            f"{one.id}.{name}": box for one in self.limits for name, box in one.parameters.items()
        }
        told = {name: one for name, one in self.values.items() if name in boxes}
        wiring = wire(self.diagram, self.kinds)
        table = parameter_table(wiring, "exact")
        port = {
            one.name: NominalValue(one.typical, one.tolerance)
            for one in table.free
            if one.tolerance
        }
        rest = {
            name: one for name, one in self.values.items() if name not in told and name not in port
        }
        limits = {name: read_nominal_value(name, one, boxes[name]) for name, one in told.items()}
        return {
            **(port if self.study is None else {}),
            **build_prior(rest, wiring, table),
            **{
                name: NominalValue(value, tolerance or OTHER_TOLERANCE)
                for name, (value, tolerance) in limits.items()
            },
        }

    def records(
        self,
        prior: Prior,
        catalogue: Sequence[Effect] = (),
        budget: Budget | None = None,
        *,
        sampled: bool = True,
    ) -> EventDataset:
        """The data that answer it, and what may be missing.

        budget : of the search. sampled : False for weights that are the same for all diagrams,
        without what each makes of the voltage between samples.
        """
        swept = None if self.study is None else self.study.fitted
        refitter = (
            None
            if swept is None
            else SweepFitter(estimate_noise(swept), self.kinds, prior, self.seed)
        )
        noise = event_noise(self.fitted, self.fitted.rests if swept is None else swept)
        data = EventDataset(
            noise, self.kinds, prior, catalogue, self.seed, refitter, self.limits, budget
        )
        if sampled:
            data.estimate_sampling_noise(self.diagram, {})
        return data


def build_event_problem(
    model: Diagram | Record,
    sweep: Sweep | Study | None,
    values: Nominal | None,
    events: Events,
    options: StudyOptions,
) -> EventProblem:
    """The question in full; IbridError for what does not belong together."""
    limits: tuple[Limit, ...] = ()
    if isinstance(model, Record):
        known = model_of_record(model)
        diagram, values, limits = known.diagram, values or known.values, known.limits
    else:
        diagram, (limits, values) = model, limits_told(values or {})
    given = options.get("holdout_op", ())
    held = (given,) if isinstance(given, str) else tuple(given)
    names = tuple(name for name in held if name in events.names)
    if names and len(names) == len(events.names):
        raise IbridError("every record is held out; leave at least one to fit")
    events.require_moving(names)
    points = tuple(name for name in held if name not in names)
    if sweep is None and points:
        raise IbridError(
            f"the events have no record {points[0]!r} to hold out; {near(points[0], events.names)}"
        )
    study = None if sweep is None else Study.of(sweep, **{**options, "holdout_op": points})
    if study is not None:
        study = replace(study, sweep=at_amplitudes(study.sweep)[0])
        step = step_of(events) if events.solver else None
        study = study if step is None else replace(study, sweep=as_of_the_device(study.sweep, step))
    kinds = (
        choose_vocabulary(options.get("vocabulary", "extended")) if study is None else study.kinds
    )
    port = with_port(options, events).get("port", NOTHING) if study is None else study.port
    diagram = diagram.behind(port) if port else diagram
    if study is None and diagram.outside.inside:  # p and q of a record are those of the PCC
        diagram = diagram.behind(replace(diagram.outside, inside=False))
    require_port_alone(diagram.outside)
    require_legal(diagram, kinds, equilibrium="exact")
    require_applicable(limits, places_of(diagram, kinds) if limits else None)
    return EventProblem(
        diagram, limits, values or {}, events, names, study, kinds, options.get("seed", 0)
    )


def event_problem_of_study(diagram: Diagram, study: Study) -> EventProblem:
    """The question of a study of records alone, of a diagram without limits."""
    if study.events is None:
        raise IbridError("the study has no records of events; make one of them, Study.of(events)")
    told: StudyOptions = {
        "holdout_op": study.held,
        "vocabulary": study.kinds,
        "seed": study.seed,
        "port": study.port,
    }
    return build_event_problem(diagram, None, None, study.events, told)
