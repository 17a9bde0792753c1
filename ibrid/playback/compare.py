"""Playback: what a model answers to records of events, and how far that is from what was
measured.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.measurement.recordings.event_windows import windows_of
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.playback.limits import BOUNDS, LIMITS, SIZES, Limit, limit_named, require_applicable
from ibrid.playback.places import places_of
from ibrid.playback.player import Player
from ibrid.ranges import finite_number, require_in_range
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.network.outside import PORT
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.writing import PlainData

SCHEMA = "ibrid.playback/1"


@dataclass(frozen=True, eq=False)
class EventModel:
    """What is played: a diagram, the limits beside it, and values of all free numbers,
    "instance.parameter", "limit.parameter".

    `assumed` : free numbers that nobody gave, at their typical values.
    """

    diagram: Diagram
    values: Mapping[str, float]
    limits: tuple[Limit, ...] = ()
    kinds: Vocabulary = field(default=VOCABULARY, repr=False)
    assumed: tuple[str, ...] = ()

    def player(self, f0_hz: float) -> Player:
        """Ready to play at a nominal frequency."""
        return Player(self.diagram, self.kinds, self.limits, 2 * pi * f0_hz)


def model_of_program(
    diagram: Diagram, values: Mapping[str, Any], kinds: Vocabulary = VOCABULARY
) -> EventModel:
    """A program at values, name -> number or {"value": number}; what they lack is typical.

    A name of a limit, such as "current_limit.i_max", puts that limit beside the program;
    "current_limit.mode" (magnitude, d or q) and "current_limit.windup" (true or false) say in which
    form. Raises IbridError for unknown names, for values that cannot be, and for a limit that the
    diagram has no place for.
    """
    limits, rest = limits_told(values)
    require_applicable(limits, places_of(diagram, kinds))
    table = parameter_table(wire(diagram, kinds), "exact")
    boxes = {one.name: one for one in table.free}
    ranges = {f"{one.id}.{name}": box for one in limits for name, box in one.parameters.items()}
    known = [*boxes, *ranges]
    members = {f"{module}.{key}": one.name for one in table.free for module, key in one.members}
    told = {
        name: one.get("value") if isinstance(one, Mapping) else one for name, one in rest.items()
    }
    given: dict[str, Any] = {members.get(name, name): one for name, one in told.items()}
    fixed = {
        f"{module}.{key}"
        for (module, key), bound in table.bound.items()
        if not isinstance(bound, str)
    }
    for name, value in given.items():
        if name not in known and name not in fixed:
            raise IbridError(
                f"the values name {name!r}, which the program lacks; {near(name, known)}"
            )
        if finite_number(value) is None:
            raise IbridError(f"the value of {name} must be a number, found {value!r}")
        require_in_range("value", value, f"the value of {name}", IbridError)
        if name in ranges and not ranges[name].low <= value <= ranges[name].high:
            raise IbridError(
                f"{name} must lie from {ranges[name].low:g} to {ranges[name].high:g}, found "
                f"{value:g}"
            )
        if name in boxes and value < 0 <= boxes[name].low:
            raise IbridError(f"{name} must not be negative, found {value:g}")
    found = {name: float(given.get(name, box.typical)) for name, box in {**boxes, **ranges}.items()}
    assumed = (name for name in known if name not in given and not name.startswith(f"{PORT}."))
    return EventModel(diagram, found, limits, kinds, tuple(assumed))


def model_of_record(record: Record) -> EventModel:
    """A record with the limits that stand beside its program.

    Raises IbridError where it has no one set of values.
    """
    if record.outcome != "ok" or not record.parameters:
        raise IbridError(f"the record has no fit (outcome {record.outcome}); evaluate again")
    if (record.settings["parameters"], record.settings["equilibrium"]) != ("shared", "exact"):
        raise IbridError(
            "events are played by a record with shared parameters and the exact equilibrium; "
            "evaluate with --parameters shared --equilibrium exact"
        )
    values, limits = dict(next(iter(record.parameters.values()))), []
    for one in record.settings.get("large_signal", ()):
        limits.append(limit_named(one["id"], one["mode"], one["windup"]))
        values |= {f"{one['id']}.{name}": float(value) for name, value in one["parameters"].items()}
    return EventModel(record.diagram, values, tuple(limits), record.vocabulary)


def limits_told(values: Mapping[str, Any]) -> tuple[tuple[Limit, ...], dict[str, Any]]:
    """The limits that values by name mean, and the values without the words about their form."""
    ids = dict.fromkeys(one.id for one in LIMITS)
    told = [id for id in ids if any(name.split(".")[0] == id for name in values)]
    own = {name: value for name, value in values.items() if name.split(".")[0] in told}
    words = {name: value for name, value in own.items() if name.endswith((".mode", ".windup"))}
    limits = []
    for id in told:
        mode, windup = words.get(f"{id}.mode", ""), words.get(f"{id}.windup", False)
        forms = [one for one in LIMITS if one.id == id]
        if mode not in ("", *(one.mode for one in forms)) or windup not in [
            one.windup for one in forms
        ]:
            modes = ", ".join(dict.fromkeys(one.mode for one in forms if one.mode)) or "none"
            raise IbridError(
                f"{id} has the modes {modes} and windup true or false; found {mode!r} and "
                f"{windup!r}"
            )
        limits.append(limit_named(id, mode, bool(windup)))
    known = [f"{one.id}.{name}" for one in limits for name in one.parameters]
    for name in own:
        if name not in (*known, *words):
            raise IbridError(f"the values name {name!r}, which no limit has; {near(name, known)}")
    return tuple(limits), {name: value for name, value in values.items() if name not in words}


@dataclass(frozen=True, eq=False)
class PlayedRecord:
    """A record and the model's answer. `current` : (N, 2), NaN from `left` (s) on, None where the
    simulation stayed.

    `nrmse` : |i_model - i| / |i - i_rest| over all samples, None where it left or nothing happens;
    `by_window` : rms of the difference there over that of i - i_rest in the whole record. `windows`
    : name -> (from, to), s. `acting` : limits that act at rest, a sentence each.
    """

    record: EventRecord
    current: np.ndarray
    left: float | None
    nrmse: float | None
    by_window: Mapping[str, float]
    windows: Mapping[str, tuple[float, float]]
    acting: tuple[str, ...] = ()

    @property
    def remark(self) -> str:
        """Why it has no error, a sentence; empty where it has one."""
        if self.left is None:
            return self.record.still
        return (
            f"{self.record.name}: the simulation left at {self.left:.4g} s, beyond 100 per unit of "
            "current"
        )


@dataclass(frozen=True, eq=False)
class Playback:
    """Of all records. `model` : what was played."""

    model: EventModel
    records: tuple[PlayedRecord, ...]
    source: str = ""

    @property
    def nrmse(self) -> float | None:
        """Mean over the records in which something happens; None where there is none or a
        simulation left.
        """
        errors = [one.nrmse for one in self.records if one.nrmse is not None]
        left = any(one.left is not None for one in self.records)
        return None if left or not errors else float(np.mean(errors))

    @property
    def by_window(self) -> dict[str, float]:
        """Mean over the records that have the window."""
        each = [one.by_window for one in self.records]
        names = dict.fromkeys(name for one in each for name in one)
        return {name: float(np.mean([one[name] for one in each if name in one])) for name in names}

    def plain(self) -> PlainData:
        """For playback.json."""
        return {
            "schema": SCHEMA,
            "nrmse": self.nrmse,
            "nrmse_by_record": {one.record.name: one.nrmse for one in self.records},
            "nrmse_by_window": self.by_window,
            "records": {
                one.record.name: {
                    "nrmse_by_window": dict(one.by_window),
                    "windows": {name: list(edge) for name, edge in one.windows.items()},
                    "left_at": one.left,
                    "acting_at_rest": list(one.acting),
                    "rest": {key: float(getattr(one.record.rest, key)) for key in "pqv"},
                }
                for one in self.records
            },
            "limits": [one.plain() for one in self.model.limits],
            "values": dict(self.model.values),
            "assumed": list(self.model.assumed),
            "events": self.source,
        }


def play(model: EventModel, events: Events) -> Playback:
    """Play every record.

    Raises OperatingPointError where the model has no rest at a record's p, q, v.
    """
    player = model.player(events.f0_hz)
    records = tuple(_played(player, model.values, one, events.f0_hz) for one in events.records)
    return Playback(model, records, events.source)


def answered(events: Events, playback: Playback) -> Events:
    """The events with the model's current in place of the measured one, up to where a simulation
    left.
    """
    records = []
    for played in playback.records:
        record, current = played.record, played.current
        stayed = np.isfinite(current).all(axis=1)
        if stayed.sum() < 4:
            raise IbridError(
                f"the simulation of {record.name} leaves at once; the model does not hold at its "
                "rest"
            )
        told = {name: value[stayed] for name, value in record.told.items()}
        kept = {
            "time": record.time[stayed],
            "v": record.v[stayed],
            "i": current[stayed],
            "told": told,
        }
        records.append(replace(record, **kept, sigma=None))
    return replace(events, records=tuple(records))


def _played(
    player: Player, values: Mapping[str, float], record: EventRecord, f0_hz: float
) -> PlayedRecord:
    (played,) = player.play(record, [values])
    windows = windows_of(record, f0_hz)
    by_window, error = _by_window(played.current, record, windows), nrmse(played.current, record)
    acting = tuple(_acting(player.limits, values, played.sizes, record.name))
    return PlayedRecord(record, played.current, played.left, error, by_window, windows, acting)


def _acting(
    limits: Sequence[Limit], values: Mapping[str, float], sizes: np.ndarray, record: str
) -> Iterator[str]:
    for limit, name in ((one, name) for one in limits for name in one.parameters if name in BOUNDS):
        level, (place, sign) = values[f"{limit.id}.{name}"], BOUNDS[name]
        if sign * (sizes[place] - level) > 1e-9:  # rounding
            yield (
                f"{limit.id}.{name} = {level:g} acts at rest already in record {record}, where the "
                f"{SIZES[place]} is "
                f"{sizes[place]:.4g}; the model does not stay at the record's p, q and v"
            )


def nrmse(current: np.ndarray, record: EventRecord) -> float | None:
    """|i_model - i| / |i - i_rest| of the samples that tell something.

    None where the model left, or nothing happens in the record.
    """
    if record.still:
        return None
    kept = ~record.masked
    whole = float(np.linalg.norm((record.i - record.i_rest)[kept]))
    error = float(np.linalg.norm((current - record.i)[kept]))
    return error / whole if np.isfinite(error) else None


def _by_window(
    current: np.ndarray, record: EventRecord, windows: Mapping[str, Sequence[float]]
) -> dict[str, float]:
    if record.still:
        return {}
    kept = ~record.masked
    whole, errors = float(np.sqrt(np.mean(((record.i - record.i_rest) ** 2)[kept]))), {}
    for name, (begin, end) in windows.items():
        inside = (record.time >= begin) & (record.time <= end) & kept
        error = (
            float(np.sqrt(np.mean((current - record.i)[inside] ** 2))) if inside.any() else np.nan
        )
        if np.isfinite(error):
            errors[name] = error / whole
    return errors
