"""Which structures are worth a look: read from the run's selection.json, or the plain front where
that is not there yet.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.fit.adequacy import BETTER
from ibrid.foreign_data import json_in
from ibrid.schemas import breach
from ibrid_search.run.trajectory import ROUNDING, best_step, eligible
from ibrid_search.step import Step


@dataclass(frozen=True)
class Choice:
    """A structure of the front.

    `holdout` : error where it was not fitted. `more` : other numbers, by their name.
    """

    step: int
    nrmse: float | None
    order: int | None
    free: int | None
    stable: bool | None = None
    holdout: float | None = None
    more: Mapping[str, float | None] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Selection:
    """`front` : candidates that nothing simpler beats.

    `equally_good` : steps that fit as well as the answer. `why` : a sentence. `residual` : modules
    of the answer that stand for no physics. `rivals` : sentences about structures that the data
    cannot tell from the answer, and what would; `rival_steps` : their numbers.
    """

    front: tuple[Choice, ...] = ()
    equally_good: tuple[int, ...] = ()
    answer: int | None = None
    why: str = ""
    residual: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    rival_steps: tuple[int, ...] = ()


def read_selection(path: Path) -> Selection | None:
    """The selection of a run, None where it has none yet; IbridError, one sentence, for a file that
    is damaged.
    """
    try:
        content = json_in(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError):
        raise IbridError(
            f"{path}: must be the JSON of a selection; it cannot be read, finish the run again"
        ) from None
    if broken := breach(content, "selection"):
        raise IbridError(f"{path}: {broken}; finish the run again")
    rivals = content.get("rivals") or ()
    return Selection(
        front=tuple(map(_choice, content["front"])),
        equally_good=tuple(content.get("equally_good") or ()),
        answer=content.get("answer"),
        why=content.get("why") or "",
        residual=tuple(content.get("residual_modules") or ()),
        rivals=tuple(rival["words"] for rival in rivals),
        rival_steps=tuple(rival["step"] for rival in rivals),
    )


def plain_selection(steps: Iterable[Step]) -> Selection:
    """What the steps alone tell: the eligible candidates that no other beats in error, order and
    free parameters at once.
    """
    fit = [step for step in steps if eligible(step)]
    best = best_step(fit)
    if best is None:
        return Selection()
    front: dict[tuple[float, ...], Step] = {}
    for step in sorted(fit, key=lambda one: (_merits(one), one.number)):
        if not any(
            all(a <= b for a, b in zip(other, _merits(step), strict=True)) for other in front
        ):
            front[_merits(step)] = step
    limit = (1 + BETTER.tie) * _merits(best)[0]
    return Selection(
        front=tuple(
            Choice(one.number, one.nrmse, one.order, one.free, one.stable) for one in front.values()
        ),
        equally_good=tuple(one.number for one in fit if _merits(one)[0] <= limit),
        answer=best.number,
    )


def _merits(step: Step) -> tuple[float, float, float]:
    """Error, order and free parameters; errors that are rounding are alike."""
    nrmse = math.inf if step.nrmse is None else step.nrmse
    return max(nrmse, ROUNDING), float(step.order or 0), float(step.free or 0)


def _choice(entry: Mapping[str, Any]) -> Choice:
    known = {"step", "nrmse", "order", "free_parameters", "stable", "holdout", "note"}
    own = (entry.get(name) for name in ("nrmse", "order", "free_parameters", "stable", "holdout"))
    more = {
        name: value
        for name, value in entry.items()
        if name not in known and type(value) in (int, float)
    }
    return Choice(entry["step"], *own, more=more, note=entry.get("note") or "")
