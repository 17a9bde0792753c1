"""Limits that may be missing in a model, or too many, as edits with initial values."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ibrid.measurement.recordings.events import Events
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.practice import Insertion
from ibrid.playback.limits import LIMITS, Limit, applicable
from ibrid.playback.places import Places, places_of
from ibrid.structure.diagrams.diagram import Diagram

#: Initial thresholds between the least and the largest value that the records show.
THRESHOLDS = 9
#: Part of the voltage drop, from the lowest voltage up, at which voltage thresholds begin and end.
VOLTAGE_SPAN = (0.08, 0.95)
#: Initial limits of the voltage command over the steady-state voltage, and how many: the command
#: may lie below the voltage at the terminals.
COMMAND_SPAN = (0.86, 1.45)
COMMAND_LIMITS = 14


@dataclass(frozen=True, eq=False)
class LimitEdit(Insertion):
    """A limit added to a model, or removed from it.

    Parameters
    ----------
    starts : tuple of mapping
        Initial values of its parameters.
    """

    limit: Limit
    starts: tuple[Mapping[str, float], ...]

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        """Compare by identity."""
        return self is other


def list_limit_edits(
    diagram: Diagram,
    kinds: Vocabulary,
    limits: Sequence[Limit],
    events: Events,
    *,
    given: Sequence[Limit] = (),
) -> Iterator[LimitEdit]:
    """Yield every limit that a model lacks, and the limits of the given model to be removed.

    Parameters
    ----------
    limits : sequence of Limit
        Those that the model has.
    given : sequence of Limit
        Those of the given model.
    """
    places = places_of(diagram, kinds)
    present = {limit.id for limit in limits}
    for limit in limits:
        if limit in given:
            location = describe_location(limit, places)
            yield LimitEdit(limit.id, "remove", location, diagram, {}, {}, limit, ({},))
    for limit in LIMITS:
        if limit.id in present or not applicable(limit, places):
            continue
        initial = _initial_values(limit, events)
        names = [f"{limit.id}.{name}" for name in initial]
        by_name = dict(zip(names, initial.values(), strict=True))
        starts = tuple(
            dict(zip(names, values, strict=True)) for values in product(*initial.values())
        )
        location = describe_location(limit, places)
        yield LimitEdit(limit.id, "add", location, diagram, by_name, {}, limit, starts)


def describe_location(limit: Limit, places: Places | None) -> str:
    """Describe where a limit acts, in names of the program, and its form."""
    if places is None:
        return limit.words
    ports = {"pll_freeze": places.pll, "command_limit": places.command}
    location = f"at {ports.get(limit.id, places.reference)}"
    return f"{location}, {limit.words}" if limit.words else location


def _initial_values(limit: Limit, events: Events) -> dict[str, tuple[float, ...]]:
    """Return initial values of each parameter; thresholds within what the records show."""
    records = events.records
    lowest_voltage = min(float(np.hypot(*record.v.T).min()) for record in records)
    steady_voltage = max(record.rest.v for record in records)
    steady_current = max(float(np.hypot(*record.i_rest)) for record in records)
    largest_current = max(float(np.hypot(*record.i.T).max()) for record in records)
    drop = steady_voltage - lowest_voltage
    voltages = lowest_voltage + drop * np.linspace(*VOLTAGE_SPAN, THRESHOLDS)
    lowest_limit = max(1.01 * steady_current, 0.05)
    highest_limit = max(1.1 * largest_current, 1.2 * steady_current, 0.1)
    thresholds: dict[str, np.ndarray] = {
        "v_freeze": voltages,
        "v_block": voltages,
        "i_max": np.geomspace(lowest_limit, highest_limit, THRESHOLDS),
        "u_max": steady_voltage * np.geomspace(*COMMAND_SPAN, COMMAND_LIMITS),
    }
    initial: dict[str, tuple[float, ...]] = {}
    for name, bounds in limit.parameters.items():
        values = np.clip(thresholds.get(name, limit.banks[name]), bounds.low, bounds.high)
        initial[name] = tuple(float(value) for value in values)
    return initial
