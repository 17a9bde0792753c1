"""The first result for a data set: ranked library diagrams, the control family, and a summary."""

from dataclasses import dataclass
from math import inf

from ibrid.evaluation.grade import LEAST_UNKNOWN, Grade
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.quality.event_inspection import EventsInspection
from ibrid.measurement.quality.inspect import Inspection
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.writing import PlainData

#: Grades of a fit, the best first.
GRADES = tuple(map(str, Grade))
#: Grades of a diagram that explains the data, at least closely.
GOOD_GRADES = GRADES[:2]
#: Grade -> what is said of the best diagram; {noise} is what the residual is compared with.
_VERDICTS = {
    "explains": "explains these data: the residual is no larger than {noise}",
    "close": "is close: the residual is up to twice {noise}",
    "rough": "fits roughly, with an error of at most 10 %: something of the device is missing in "
    "it",
    "fails": "does not fit: the controller differs from every built-in diagram, or the metadata of "
    "the file (p, q, base, signs) are wrong",
}
#: Grade -> what is said of a diagram of another family with the same grade.
ALTERNATIVE_VERDICTS = {
    "explains": "explains them too: these data do not tell which of the two the device is",
    "close": "is as close: these data do not tell which of the two the device is",
    "rough": "fits roughly too, so that the family is open",
}


@dataclass(frozen=True, eq=False)
class DiagramFit(Frozen):
    """Hold how well a library diagram explains the data.

    `diagram` : its name. `nrmse` : of the fit where there is a `record`, else of the screening fit.
    `grade` : one of `GRADES`, "" if it was screened only. `held_out` : operating point or event ->
    error there of a fit without it. `bic` : Bayesian information criterion of a joint fit to sweep
    and recordings. `edited_diagram` : the diagram itself where one of its blocks was replaced.
    """

    diagram: str
    nrmse: float
    grade: str = ""
    held_out: dict[str, float] | None = None
    record: Record | None = None
    bic: float = inf
    edited_diagram: Diagram | None = None

    @property
    def structure(self) -> Diagram:
        """Return the block diagram."""
        return textbook(self.diagram) if self.edited_diagram is None else self.edited_diagram

    @property
    def nrmse_by_event(self) -> dict[str, float]:
        """Return the NRMSE of each recorded event that it was fitted to."""
        return {} if self.record is None else dict(self.record.nrmse_by_record)


@dataclass(frozen=True, eq=False)
class StartResult:
    """Hold the first result for a data set.

    `data` : sweep or recordings. `ranked` : library diagrams, the best first. `family` : of the
    control of the best one, in words. `next` : commands to go on with. `events` : recordings in
    addition to a sweep. `single_event` : the only one of several recordings that was fitted, "" if
    all were. `effort` : one of `START_EFFORTS`. `alternative` : a diagram of another family with
    the same grade, with its family; "" if there is none. `devices` : behind the terminals, at most.
    """

    data: Sweep | Events
    inspection: Inspection | EventsInspection
    ranked: tuple[DiagramFit, ...]
    family: str
    next: tuple[str, ...] = ()
    events: Events | None = None
    single_event: str = ""
    effort: str = "normal"
    alternative: str = ""
    devices: int = 1

    @property
    def best(self) -> DiagramFit:
        """Return the best diagram."""
        return self.ranked[0]

    @property
    def has_sweep(self) -> bool:
        """Return True if the data are a sweep, with or without recordings."""
        return not isinstance(self.data, Events)

    @property
    def recordings(self) -> Events | None:
        """Return the recordings, whether they are all the data or accompany a sweep."""
        return self.data if isinstance(self.data, Events) else self.events

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return the warnings about the quality of sweep and recordings."""
        of_events = () if self.events is None else contradictions(self.events)
        return (*self.inspection.warnings, *of_events)

    @property
    def work(self) -> dict[str, int]:
        """Return the number of full fits and of the model evaluations they took."""
        records = [fit.record for fit in self.ranked if fit.record is not None]
        evaluations = sum(int(record.starts.get("evaluations", 0)) for record in records)
        return {"fits": len(records), "evaluations": evaluations}

    @property
    def sentence(self) -> str:
        """Return a summary of a line or two."""
        sentences = [
            self._verdict_sentence(),
            self._limit_sentence(),
            self._held_out_sentence(),
            self._events_sentence(),
        ]
        return " ".join(filter(None, sentences))

    def _verdict_sentence(self) -> str:
        """Say how well the best diagram explains the data, and whether another does as well."""
        best = self.best
        verdict = _VERDICTS[best.grade].format(noise=self._noise_description())
        subject = "The shipped diagram"
        if self.single_event:
            subject = f"For the mild event {self.single_event} alone, the shipped diagram"
        sentence = f"{subject} {best.diagram} ({self.family}) {verdict}."
        if self.alternative:
            sentence += f" {self.alternative} {ALTERNATIVE_VERDICTS[best.grade]}."
        return sentence

    def _noise_description(self) -> str:
        """Return what the residual is compared with, by what is known of the noise."""
        record = self.best.record
        misfit = None if record is None else record.misfit
        if misfit is not None and misfit["floor"]["from"] != "unknown":
            return "the noise"
        return f"{LEAST_UNKNOWN:g} of the data (noise level unknown)"

    def _limit_sentence(self) -> str:
        """Suggest `ibrid gap` where a limiter may act in a recording."""
        if self.single_event:
            return "A limiter may act in the other events; to test this, run ibrid gap."
        if not self.has_sweep and self.best.grade not in GOOD_GRADES:
            return "To test whether a limiter acts in an event, run ibrid gap."
        return ""

    def _held_out_sentence(self) -> str:
        """Report the errors at held-out operating points or events."""
        if not self.best.held_out:
            return ""
        what, preposition = "event", "in"
        if self.has_sweep:
            what, preposition = "operating point", "at"
        errors = [f"{error:.2g} {preposition} {name}" for name, error in self.best.held_out.items()]
        return f"Error at a held-out {what}: {'; '.join(errors)}."

    def _events_sentence(self) -> str:
        """Report the errors of the fitted events."""
        if self.single_event or self.recordings is None:
            return ""
        errors = [f"{error:.2g} in {name}" for name, error in self.best.nrmse_by_event.items()]
        if not errors:
            return "No diagram that was fitted has a steady state in every recorded event."
        what = "Error of the recordings"
        if self.has_sweep:
            what += ", fitted together with the sweep"
        return f"{what}: {'; '.join(errors)}."

    def to_json(self) -> PlainData:
        """Return the result in the format `ibrid.start/1`."""
        return {
            "schema": "ibrid.start/1",
            "sentence": self.sentence,
            "family": self.family,
            "data": self.inspection.to_json(),
            "ranked": [_fit_to_json(fit) for fit in self.ranked],
            "next": list(self.next),
            "effort": self.effort,
            "work": self.work,
        }


def _fit_to_json(fit: DiagramFit) -> PlainData:
    """Return an entry of the ranking in the format `ibrid.start/1`."""
    entry = {
        "diagram": fit.diagram,
        "nrmse": fit.nrmse,
        "grade": fit.grade or None,
        "held_out": fit.held_out,
    }
    if fit.nrmse_by_event:
        entry["nrmse_by_record"] = fit.nrmse_by_event
    return entry
