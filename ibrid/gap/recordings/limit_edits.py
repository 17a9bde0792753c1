"""Where limits may be missing in a model, or in a device: every form at its place, with values that
a fit begins with.
"""

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

#: Levels between the least and the largest that a record shows, at which a threshold is looked for.
LEVELS = 9


@dataclass(frozen=True, eq=False)
class LimitEdit(Insertion):
    """A limit put beside a model, or taken from it.

    `starts` : values of its parameters to begin with.
    """

    limit: Limit
    starts: tuple[Mapping[str, float], ...]

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        """A place is itself alone."""
        return self is other


def list_limit_edits(
    diagram: Diagram,
    kinds: Vocabulary,
    limits: Sequence[Limit],
    events: Events,
    *,
    given: Sequence[Limit] = (),
) -> Iterator[LimitEdit]:
    """Every limit that a model with some limits lacks; and those of the given model, to be taken
    away.
    """
    places = places_of(diagram, kinds)
    present = {one.id for one in limits}
    for limit in limits:
        if limit in given:
            yield LimitEdit(limit.id, "remove", where(limit, places), diagram, {}, {}, limit, ({},))
    for limit in LIMITS:
        if limit.id not in present and applicable(limit, places):
            banks = _banks(limit, events)
            starts = tuple(
                {f"{limit.id}.{name}": value for name, value in zip(banks, values, strict=True)}
                for values in product(*banks.values())
            )
            named = {f"{limit.id}.{name}": bank for name, bank in banks.items()}
            yield LimitEdit(
                limit.id, "add", where(limit, places), diagram, named, {}, limit, starts
            )


def where(limit: Limit, places: Places | None) -> str:
    """The place in names of the program, and the form."""
    if places is None:
        return limit.words
    port = {"pll_freeze": places.pll, "command_limit": places.command}.get(
        limit.id, places.reference
    )
    return f"at {port}" + (f", {limit.words}" if limit.words else "")


def _banks(limit: Limit, events: Events) -> dict[str, tuple[float, ...]]:
    """Values to begin with: thresholds of voltage and current from what the records show."""
    size = [np.hypot(*record.v.T) for record in events.records]
    lowest, rest = (
        min(float(one.min()) for one in size),
        max(record.rest.v for record in events.records),
    )
    resting = max(float(np.hypot(*record.i_rest)) for record in events.records)
    most = max(float(np.hypot(*record.i.T).max()) for record in events.records)
    voltages = lowest + (rest - lowest) * np.linspace(0.08, 0.95, LEVELS)
    shown: dict[str, np.ndarray] = {
        "v_freeze": voltages,
        "v_block": voltages,
        "i_max": np.geomspace(
            max(1.01 * resting, 0.05), max(1.1 * most, 1.2 * resting, 0.1), LEVELS
        ),
        "u_max": rest
        * np.geomspace(
            0.86, 1.45, 14
        ),  # at rest the command may lie below the voltage at the terminals
    }
    return {
        name: tuple(
            float(one) for one in np.clip(shown.get(name, limit.banks[name]), box.low, box.high)
        )
        for name, box in limit.parameters.items()
    }
