"""What a fleet looks like as a whole: its families with their typical values, the devices that are
unlike them, the drifts.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import log, sqrt
from typing import Any

from ibrid.errors import IbridError
from ibrid.foreign_text import csv_text
from ibrid.frozen import Frozen
from ibrid.report.pages.template import page
from ibrid.writing import PlainData
from ibrid_search.archives.prior import (
    BELIEVED,
    TRUSTED,
    DeviceAnswer,
    DeviceFamily,
    Prior,
    learned,
)
from ibrid_search.run.store import Store
from ibrid_search.step import Status

#: Deviations of spread and own interval together beyond which a parameter is unlike its family's.
FAR = 4.0
#: A family of less than this part of the devices is rare.
RARE = 0.01
#: Lines of a table on the page at most; the table beside it has all.
MOST = 200


@dataclass(frozen=True)
class DeviceLine(Frozen):
    """A device in the table.

    `unlike` : why it is an outlier, in words, the worst first. `drift` : the answer of that job.
    """

    number: int
    name: str
    status: str
    reason: str
    diagram: str = ""
    family: str = ""
    grade: str = ""
    nrmse: float | None = None
    expected: bool = False
    learned_from: int = 0
    seconds: float = 0.0
    attempts: int = 1
    unlike: tuple[str, ...] = ()
    drift: Mapping[str, Any] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """What a reader is to know of it."""
        if self.status != Status.OK:
            return self.reason
        return self.drift["sentence"] if self.drift else "; ".join(self.unlike)


@dataclass(frozen=True)
class Summary:
    """`job` : what was done for each device. `families` : with all devices that are trusted."""

    job: str
    folder: str
    devices: tuple[DeviceLine, ...]
    families: tuple[DeviceFamily, ...]

    @property
    def failed(self) -> tuple[DeviceLine, ...]:
        """Devices without an answer."""
        return tuple(one for one in self.devices if one.status != Status.OK)

    @property
    def outliers(self) -> tuple[DeviceLine, ...]:
        """Devices that are unlike the others, those that nothing explains first."""
        return tuple(
            sorted(
                (one for one in self.devices if one.unlike), key=lambda one: one.grade in TRUSTED
            )
        )

    @property
    def drifted(self) -> tuple[DeviceLine, ...]:
        """Devices that changed."""
        return tuple(one for one in self.devices if one.drift and one.drift["verdict"] != "same")

    @property
    def grades(self) -> Counter[str]:
        """How many devices are explained how well."""
        return Counter(one.grade for one in self.devices if one.grade)

    def to_json(self) -> PlainData:
        """The fleet as a whole; a line a device is in the table."""
        families = [
            {
                "diagram": one.label,
                "structure": one.structure,
                "devices": one.devices,
                "typical": {name: list(pair) for name, pair in one.typical.items()},
            }
            for one in self.families
        ]
        told = {"outliers": self.outliers, "drifted": self.drifted, "failed": self.failed}
        return {
            "schema": "ibrid.fleet/1",
            "job": self.job,
            "sentence": self.sentence,
            "devices": len(self.devices),
            "grades": dict(sorted(self.grades.items())),
            "families": families,
            **{
                key: [{"device": one.name, "words": one.words} for one in lines]
                for key, lines in told.items()
            },
        }

    @property
    def sentence(self) -> str:
        """The fleet in a line."""
        answered = len(self.devices) - len(self.failed)
        said = [f"{answered} of {len(self.devices)} devices have an answer"]
        if self.job == "drift":
            said.append(f"{len(self.drifted)} changed")
        else:
            said.append(
                f"{self.grades['explains']} are explained within the noise, by "
                f"{len(self.families)} structures"
            )
            said.append(f"{len(self.outliers)} are unlike the others")
        return "; ".join(said) + "."


def summary_of(store: Store) -> Summary:
    """The summary of what a store holds now."""
    meta = store.meta
    if "fleet" not in meta:
        raise IbridError(f"{store.path}: is the archive of a search, not of a fleet")
    attempts, answers, lines = store.retried(), {}, []
    for step in store.steps():
        line = DeviceLine(
            step.number,
            step.note,
            str(step.status),
            step.reason,
            seconds=step.seconds,
            attempts=attempts.get(step.number, 1),
        )
        if step.status is Status.OK:
            record = store.record(step.number)
            told = record.settings["fleet"]
            answers[step.number] = DeviceAnswer.of(record)
            line = replace(
                line,
                **{name: told[name] for name in ("diagram", "family", "expected")},
                grade=record.grade or "",
                nrmse=record.nrmse,
                drift=record.settings.get("drift", {}),
                learned_from=record.settings["prior"]["devices"],
            )
        lines.append(line)
    known = learned(answers.values(), len(lines))
    unlike = (
        {}
        if meta["fleet"] == "drift"
        else {number: _unlike(one, known) for number, one in answers.items()}
    )
    devices = tuple(replace(one, unlike=unlike.get(one.number, ())) for one in lines)
    return Summary(meta["fleet"], meta["folder"], devices, known.families)


def _unlike(answer: DeviceAnswer, known: Prior) -> tuple[str, ...]:
    """Why a device is an outlier; empty for one like its family."""
    if answer.grade not in TRUSTED:
        return (
            f"no structure explains it: the best {answer.grade}"
            + (" only" if answer.grade == "rough" else ""),
        )
    family = known.of(answer.structure)
    if family is None:
        return ()
    if family.devices < RARE * known.devices:
        return (f"its structure is that of {family.devices} of {known.devices} devices",)
    if family.devices <= BELIEVED:
        return ()
    far = []
    for name, (value, deviation) in answer.values.items():
        if name in family.typical and value * family.typical[name][0] > 0:
            typical, spread = family.typical[name]
            z = abs(log(value / typical)) / sqrt(spread**2 + deviation**2)
            if z > FAR:
                far.append(
                    (
                        z,
                        f"{name} is {value / typical:.3g} times the usual {typical:.3g}, {z:.1f} "
                        "deviations",
                    )
                )
    return tuple(words for _, words in sorted(far, reverse=True))


_COLUMNS = (
    "number",
    "name",
    "status",
    "diagram",
    "family",
    "grade",
    "nrmse",
    "expected",
    "learned_from",
    "attempts",
)


def table_csv(summary: Summary) -> str:
    """One line a device; the last column says why there is no answer, or what is unusual.

    Times are in the page alone: two equal fleets have equal tables.
    """
    rows = [[*(getattr(one, name) for name in _COLUMNS), one.words] for one in summary.devices]
    return csv_text([[*_COLUMNS, "words"], *rows])


def fleet_html(summary: Summary) -> str:
    """The page as text."""
    facts: dict[str, Any] = {
        "fleet": summary,
        "most": MOST,
        "expected": sum(one.expected for one in summary.devices),
        "again": sum(one.attempts > 1 for one in summary.devices),
    }
    return page("fleet.html", facts, "ibrid_search")
