"""What is told of each update, in the store and on the page of a run."""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from ibrid_search.policy_package import UPDATES
from ibrid_search.step import REFUSED, Status

from ibrid_policy.learning.advantages import Rewarded

#: The text of the store that holds the updates.
META = UPDATES


@dataclass(frozen=True)
class Update:
    """A batch and what was learnt from it.

    `first`, `last` : its steps. `reward`, `best_reward` : mean and largest. Shares of the answers:
    `valid` (fitted, twins included), `unchanged`, `duplicates` (known before the batch), `siblings`
    (same structure as an earlier answer of the batch), `refused` (no usable or no legal edit),
    `failed` (no fit). `lost` : answers without a reward. `dropped` : contexts that taught nothing.
    `gain` : mean of what the answers gain on their parents, where they are compared by it. `tokens`
    : of an answer, mean. The rest as `trainer.Trained` has it, None where nothing was scored;
    `probe` : drift after the update; `handed` : the share of it that the served weights have, see
    `probe`, None where that cannot be told. `remark` : a sentence when something is wrong.
    """

    number: int
    first: int
    last: int
    reward: float | None
    best_reward: float | None
    valid: float
    unchanged: float
    duplicates: float
    siblings: float
    refused: float
    failed: float
    lost: int
    dropped: int
    tokens: float
    gain: float | None = None
    entropy: float | None = None
    divergence: float | None = None
    weight: float | None = None
    largest_weight: float | None = None
    clipped: float | None = None
    drift: float | None = None
    gradient: float | None = None
    probe: float | None = None
    handed: float | None = None
    updated: bool = False
    seconds_sampling: float = 0.0
    seconds_update: float = 0.0
    remark: str = ""


def counted(found: Sequence[Rewarded]) -> dict[str, Any]:
    """Rewards and shares of an update, by the names of its fields."""
    known = [one.reward for one in found if one.reward is not None]
    ends = Counter(_place(one) for one in found)
    return {
        "reward": mean_of_known(known),
        "best_reward": max(known, default=None),
        **{
            name: ends[name] / len(found)
            for name in ("valid", "unchanged", "duplicates", "refused", "failed")
        },
        "siblings": sum(one.sibling for one in found) / len(found),
        "lost": len(found) - len(known),
    }


def mean_of_known(values: Iterable[float | None]) -> float | None:
    """The mean of those that are not None; None where there are none."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def updates_json(updates: Sequence[Update]) -> str:
    """Text for the store."""
    return json.dumps([asdict(one) for one in updates], separators=(",", ":"))


def read_updates(text: str) -> tuple[Update, ...]:
    """The updates in a text of the store; none where it cannot be read.

    Fields of a later version are left out.
    """
    try:
        rows = json.loads(text) if text else []
        names = {one.name for one in fields(Update)}
        return tuple(
            Update(**{name: value for name, value in row.items() if name in names}) for row in rows
        )
    except (ValueError, TypeError, AttributeError, RecursionError):
        return ()


def _place(one: Rewarded) -> str:
    names: Mapping[Status, str] = {
        Status.OK: "valid",
        Status.UNCHANGED: "unchanged",
        Status.DUPLICATE: "duplicates",
        Status.LOST: "lost",
    }
    return names.get(one.status, "refused" if one.status in REFUSED else "failed")
