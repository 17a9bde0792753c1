"""The problem that recordings pose, alone or with a sweep: model, nominal values, data, and what is
held out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.gap.budget import Budget
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_noise import estimate_event_noise
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

#: Why nothing fits the recordings.
NO_EQUILIBRIUM = (
    "the model has no rest at p, q, v of the records (check them and the base), or is unstable "
    "when their voltage is played"
)


@dataclass(frozen=True, eq=False)
class EventProblem:
    """A model to be fitted to recordings.

    Parameters
    ----------
    diagram : Diagram
        As given, with its terminal network.
    limits : tuple of Limit
        Beside the diagram.
    values : mapping
        Nominal values as given; `prior` is what they mean.
    events : Events
        All recordings.
    held : sequence of str
        Names of the records that are held out.
    study : Study or None
        Of the sweep; None without one.
    kinds : Vocabulary
        Module kinds of the diagram.
    seed : int
        Of the random starts.
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
        """The measured sweep, None without one."""
        return None if self.study is None else self.study.sweep

    @property
    def fitted(self) -> Events:
        """The records that are not held out."""
        return self.events.only(*(name for name in self.events.names if name not in self.held))

    @cached_property
    def in_fixed_steps(self) -> "EventProblem | None":
        """The problem of the same data read as made by a program of fixed time steps.

        None where no such program can have made them, or they are read so already.
        """
        if any(record.stepped for record in self.events.records):
            return None
        step = step_of(self.events)
        if step is None:
            return None
        study = self.study
        if study is not None:
            study = replace(study, sweep=as_of_the_device(study.sweep, step))
        return replace(self, events=in_fixed_steps(self.events), study=study)

    def prior(self) -> dict[str, NominalValue]:
        """Build the prior of the free parameters, those of the limits included.

        A limit without a tolerance has the one of control parameters. The tolerances of a terminal
        network are added where there is no sweep: the cost of a sweep includes them.
        """
        wiring = wire(self.diagram, self.kinds)
        table = parameter_table(wiring, "exact")
        network = {
            parameter.name: NominalValue(parameter.typical, parameter.tolerance)
            for parameter in table.free
            if parameter.tolerance
        }
        limit_prior = self._limit_prior()
        others = {
            name: value
            for name, value in self.values.items()
            if name not in limit_prior and name not in network
        }
        network_prior = network if self.study is None else {}
        return {**network_prior, **build_prior(others, wiring, table), **limit_prior}

    def _limit_prior(self) -> dict[str, NominalValue]:
        """Build the prior of those parameters of the limits that have nominal values."""
        bounds_by_name = {
            f"{limit.id}.{name}": bounds
            for limit in self.limits
            for name, bounds in limit.parameters.items()
        }
        prior: dict[str, NominalValue] = {}
        for name, entry in self.values.items():
            if name in bounds_by_name:
                value, tolerance = read_nominal_value(name, entry, bounds_by_name[name])
                prior[name] = NominalValue(value, tolerance or OTHER_TOLERANCE)
        return prior

    def build_dataset(
        self,
        prior: Prior,
        catalogue: Sequence[Effect] = (),
        budget: Budget | None = None,
        *,
        sampled: bool = True,
    ) -> EventDataset:
        """Build the dataset of the fitted records, and of the sweep.

        Parameters
        ----------
        prior : mapping
            Nominal values with tolerances by name.
        catalogue : sequence of Effect
            Effects that may be missing.
        budget : Budget
            Of the search.
        sampled : bool
            Include in the weights what the diagram makes of the unknown voltage between samples.
            False for weights that are the same for all diagrams.
        """
        sweep = None if self.study is None else self.study.fitted
        sweep_fitter = None
        if sweep is not None:
            sweep_fitter = SweepFitter(estimate_noise(sweep), self.kinds, prior, self.seed)
        noise = estimate_event_noise(self.fitted, self.fitted.rests if sweep is None else sweep)
        data = EventDataset(
            noise, self.kinds, prior, catalogue, self.seed, sweep_fitter, self.limits, budget
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
    """Build a problem from the arguments of `find_gap` or `evaluate_events`.

    Raises
    ------
    IbridError
        Data, model and options that do not belong together.
    """
    if isinstance(model, Record):
        known = model_of_record(model)
        diagram = known.diagram
        values = values or known.values
        limits = known.limits
    else:
        diagram = model
        limits, values = limits_told(values or {})
    given = options.get("holdout_op", ())
    held = (given,) if isinstance(given, str) else tuple(given)
    held_records = tuple(name for name in held if name in events.names)
    if held_records and len(held_records) == len(events.names):
        raise IbridError("every record is held out; leave at least one to fit")
    events.require_moving(held_records)
    held_points = tuple(name for name in held if name not in held_records)
    if sweep is None and held_points:
        raise IbridError(
            f"the events have no record {held_points[0]!r} to hold out; "
            f"{near(held_points[0], events.names)}"
        )
    study = None
    if sweep is None:
        kinds = choose_vocabulary(options.get("vocabulary", "extended"))
        network = with_port(options, events).get("port", NOTHING)
    else:
        study = _study_of_sweep(sweep, events, {**options, "holdout_op": held_points})
        kinds = study.kinds
        network = study.port
    diagram = diagram.behind(network) if network else diagram
    if study is None and diagram.outside.inside:  # p and q of a record are those of the PCC
        diagram = diagram.behind(replace(diagram.outside, inside=False))
    require_port_alone(diagram.outside)
    require_legal(diagram, kinds, equilibrium="exact")
    require_applicable(limits, places_of(diagram, kinds) if limits else None)
    return EventProblem(
        diagram=diagram,
        limits=limits,
        values=values or {},
        events=events,
        held=held_records,
        study=study,
        kinds=kinds,
        seed=options.get("seed", 0),
    )


def _study_of_sweep(sweep: Sweep | Study, events: Events, options: StudyOptions) -> Study:
    """Return the study of a sweep at its smallest amplitude, in fixed steps where the recordings
    are.
    """
    study = Study.of(sweep, **options)
    study = replace(study, sweep=at_amplitudes(study.sweep)[0])
    step = step_of(events) if events.solver else None
    if step is not None:
        study = replace(study, sweep=as_of_the_device(study.sweep, step))
    return study


def event_problem_of_study(diagram: Diagram, study: Study) -> EventProblem:
    """Return the problem of a study of recordings alone, with a diagram without limits."""
    if study.events is None:
        raise IbridError("the study has no records of events; make one of them, Study.of(events)")
    options: StudyOptions = {
        "holdout_op": study.held,
        "vocabulary": study.kinds,
        "seed": study.seed,
        "port": study.port,
    }
    return build_event_problem(diagram, None, None, study.events, options)
