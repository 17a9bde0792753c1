"""The answer of `ibrid generic`: what was fitted, what these events do not show, and how well the
generic model answers to each of them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.generic.blind_bands import BlindBand
from ibrid.generic.dialect import Dialect, dialect_named
from ibrid.generic.dyr import range_warnings
from ibrid.generic.fit import GenericFit, fit_generic
from ibrid.generic.model import GenericModel, model_named
from ibrid.generic.seen import SeenRecord, seen_events
from ibrid.measurement.recordings.dq_pairs import to_pairs
from ibrid.measurement.recordings.event_windows import windows_of
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.quantities import counted
from ibrid.playback.compare import PlayedRecord, nrmse
from ibrid.playback.validation import validation_of
from ibrid.showing import brief, made_above, shown
from ibrid.writing import PlainData, write_json

SCHEMA = "ibrid.generic/1"
#: Times the noise that a model may leave and still explains the events.
EXPLAINED = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class GenericAnswer:
    """`start` : what a file said, before the fit; None where nothing was said. `played` : the
    records and the model's current. `validation` : as `playback.validation` has it. Of an
    identified model: `held_out` : events that no fit saw; `cannot_show` : bands in which the
    generic model is blind; `left_out` : events that the identified model has no answer to.
    """

    model: GenericModel
    dialect: str
    fit: GenericFit
    start: Mapping[str, float] | None
    played: tuple[PlayedRecord, ...]
    started: Mapping[str, float | None]
    validation: Mapping[str, Any]
    warnings: tuple[str, ...]
    source: str
    f0_hz: float
    held_out: tuple[PlayedRecord, ...] = ()
    cannot_show: tuple[BlindBand, ...] = ()
    left_out: tuple[str, ...] = ()

    def __repr__(self) -> str:
        worst = max((one.nrmse or 0.0 for one in self.played), default=0.0)
        records = counted(len(self.played), "record")
        return brief(f"<GenericAnswer: {self.model.name}, {records}, NRMSE {worst:.3g} at most>")

    def __str__(self) -> str:
        """The tables that `ibrid generic` prints."""
        return str(shown(self, "texts.generic_text", "generic_text"))

    def _repr_html_(self) -> str:
        """Errors and parameters, for notebooks."""
        return str(shown(self, "pages.notebook", "generic_html"))

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each parameter."""
        names = ("block", "parameter", "before", "value", "remark")
        rows = [dict(zip(names, row, strict=True)) for row in self.rows()]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def save(self, path: str | PathLike[str]) -> None:
        """Write the JSON of `plain`, replacing the file atomically."""
        write_json(Path(path), self.plain())

    def rows(self) -> list[tuple[str, str, float | None, float, str]]:
        """LawBlock, name, value before, value now, and what the events say about it."""
        begin = self.start or {}
        return [
            (block.name, name, begin.get(name), self.fit.values[name], self._said(name))
            for block in self.model.blocks
            for name in block.names
        ]

    def _said(self, name: str) -> str:
        if name in self.fit.at_bound:
            return "ended at the bound of its range: not to be relied on"
        if name in self.fit.deviations:
            return f"+- {1.96 * self.fit.deviations[name]:.3g}"
        if name in self.fit.scanned:
            low, high = self.fit.scanned[name]
            return f"from {low:.3g} to {high:.3g} as likely"
        if name in self.fit.unseen:
            return f"not shown: {self.fit.unseen[name]}"
        if name in self.fit.flags_alike:
            return "not shown: the other choice is as likely"
        flags = [flag.name for block in self.model.blocks for flag in block.flags if flag.tried]
        return "chosen" if name in flags else "left as it was"

    def plain(self) -> PlainData:
        """For generic.json."""
        return {
            "schema": SCHEMA,
            "model": self.model.name,
            "dialect": self.dialect,
            "events": self.source,
            "parameters": {
                name: {
                    "block": block,
                    "value": value,
                    "start": before,
                    "sigma": self.fit.deviations.get(name),
                    "identifiable": name in self.fit.deviations or name in self.fit.scanned,
                    "as_likely": list(self.fit.scanned[name]) if name in self.fit.scanned else None,
                    "remark": said,
                }
                for block, name, before, value, said in self.rows()
            },
            "correlations": [list(pair) for pair in self.fit.correlations],
            "flags_not_shown": list(self.fit.flags_alike),
            "over_noise": float(np.sqrt(self.fit.squares)),
            "nrmse_by_record": {one.record.name: one.nrmse for one in self.played},
            "nrmse_of_start": dict(self.started),
            "nrmse_held_out": {one.record.name: one.nrmse for one in self.held_out},
            "cannot_show": [
                {"event": one.event, "band_hz": [one.low_hz, one.high_hz], "left": one.left}
                for one in self.cannot_show
            ],
            "left_out": list(self.left_out),
            "validation": dict(self.validation),
            "warnings": list(self.warnings),
        }


@takes_kinds
def fit_generic_model(
    events: Events,
    model: str = "wecc_regc_a+reec_a",
    *,
    start: Mapping[str, float] | None = None,
    dialect: str = "wecc",
    measured: bool = True,
) -> GenericAnswer:
    """Fit a generic model to recordings.

    model : by name. start : values of a file, whose flags are kept; typical values and all flags
    without. dialect : in which program's reading of the laws. measured : whether the records have
    noise, beside which what is left over is judged.

    Raises IbridError for names that are not known, and for records that show nothing.
    """
    chosen, switches = model_named(model), dialect_named(dialect)
    records = seen_events(events)
    fit = fit_generic(chosen, records, start, switches, held_flags=start is not None)
    played = tuple(_played(chosen, switches, fit.values, record) for record in records)
    before = (
        ()
        if start is None
        else tuple(
            _played(chosen, switches, {**chosen.typical, **start}, record) for record in records
        )
    )
    given = {**chosen.typical, **(start or {})}
    return GenericAnswer(
        model=chosen,
        dialect=dialect,
        fit=fit,
        start=start,
        played=played,
        started={one.record.name: one.nrmse for one in before},
        validation=validation_of(played),
        warnings=tuple(
            dict.fromkeys(
                (
                    *(_not_explained(fit, played) if measured else ()),
                    *range_warnings(chosen.blocks, given),
                    *range_warnings(chosen.blocks, fit.values),
                )
            )
        ),
        source=events.source,
        f0_hz=events.f0_hz,
    )


def played_events(answer: GenericAnswer, events: Events) -> tuple[PlayedRecord, ...]:
    """Records in which something happens, and the current of a fitted model."""
    dialect = dialect_named(answer.dialect)
    return tuple(
        _played(answer.model, dialect, answer.fit.values, record) for record in seen_events(events)
    )


def _not_explained(fit: GenericFit, played: Sequence[PlayedRecord]) -> Iterator[str]:
    """A sentence where the model leaves far more than noise."""
    over_noise = float(np.sqrt(fit.squares))
    if over_noise > EXPLAINED:
        worst = max(one.nrmse or 0.0 for one in played)
        yield (
            f"the model leaves {over_noise:.3g} times the noise, and an NRMSE of {worst:.3g} at "
            "most: the device is not of this model, or the fit ended in a local minimum; do not "
            "rely on the values and their intervals, and try --start with a file that is near"
        )


def _played(
    model: GenericModel, dialect: Dialect, values: Mapping[str, float], seen: SeenRecord
) -> PlayedRecord:
    answer = seen.current(
        lambda time, v, told, rest: model.play(values, dialect, time, v, told, rest)
    )
    current = to_pairs(answer)
    record = seen.record
    return PlayedRecord(
        record, current, None, nrmse(current, record), {}, windows_of(record, record.f0_hz or 50.0)
    )
