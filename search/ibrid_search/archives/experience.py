"""What finished searches teach about the ideas of control practice, and how that ranks the looks of
the next search.

Law: a look with the error e_l speaks for a fit with ln(e) = ln(e_l) +- tau, and an idea that was
kept k times of n is right with probability (k + m p) / (n + m), p that of all ideas; so looks rank
by ln(e_l) + price - tau ln(that / p). tau is the spread of ln(fit) - ln(look) over the same
searches. What nobody tried keeps the rank that the data give it.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log
from pathlib import Path

import numpy as np

from ibrid.errors import IbridError
from ibrid.foreign_data import json_in
from ibrid.frozen import Frozen
from ibrid.writing import inside, write_whole
from ibrid_search.run.run_folder import ARCHIVE, SELECTION
from ibrid_search.run.selection import read_selection
from ibrid_search.run.store import Store
from ibrid_search.step import Status, line

#: The file of an experience, its schema, and how many tries the mean of all ideas weighs.
FILE, SCHEMA, PRIOR = "experience.json", "ibrid.experience/1", 4.0
#: Largest tau: beyond it looks would count for nothing.
MOST = 1.0


@dataclass(frozen=True)
class TriedEdit:
    """An edit that a search tried.

    `kept` : it is in the answer. `beyond` : ln(fit) - ln(look), None where no look was told.
    """

    part: str
    kept: bool
    beyond: float | None


@dataclass(frozen=True)
class Experience(Frozen):
    """`tried`, `kept` : of each idea. `tau` : spread of what a fit finds beyond a look, in
    ln(error).
    """

    tried: Mapping[str, int]
    kept: Mapping[str, int]
    tau: float

    def bonus(self, part: str) -> float:
        """What a look at an edit of this idea is better than its error says, in ln(error)."""
        mean = (sum(self.kept.values()) + 0.5) / (sum(self.tried.values()) + 1.0)
        own = (self.kept.get(part, 0) + PRIOR * mean) / (self.tried.get(part, 0) + PRIOR)
        return self.tau * log(own / mean)

    def write(self, folder: Path) -> None:
        """Keep it in a folder."""
        told = {
            "schema": SCHEMA,
            "tau": self.tau,
            "tried": dict(self.tried),
            "kept": dict(self.kept),
        }
        write_whole(inside(folder, FILE), json.dumps(told, indent=1, sort_keys=True) + "\n")


def read_experience(folder: Path) -> Experience:
    """The experience in a folder; IbridError, one sentence, for anything else."""
    path = inside(folder, FILE)
    try:
        content = json_in(path.read_text(encoding="utf-8"))
        tried, kept = (
            {str(part): int(n) for part, n in content[name].items()} for name in ("tried", "kept")
        )
        whole = Experience(tried, kept, float(content["tau"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise IbridError(
            f"{path}: is no experience; make one with ibrid policy train --from RUN --out DIR"
        ) from None
    counts = all(0 <= kept.get(part, 0) <= n for part, n in tried.items()) and {*kept} <= {*tried}
    if content.get("schema") != SCHEMA or not counts or not 0 <= whole.tau <= MOST:
        raise IbridError(
            f"{path}: holds numbers that no searches give; make it again with ibrid policy train "
            "--from RUN"
        )
    return whole


def experience_of(folders: Sequence[str | Path]) -> Experience:
    """What finished searches teach; IbridError where none of them has tried an idea, or a folder
    holds no finished run.
    """
    edits = [one for folder in folders for one in tried_edits(Path(folder))]
    if not edits:
        raise IbridError(
            "these runs tried no idea of control practice; give runs of --proposer diagnosis or "
            "rules"
        )
    beyond = [one.beyond for one in edits if one.beyond is not None]
    tau = min(float(np.std(beyond)), MOST) if len(beyond) > 1 else 0.0
    return Experience(
        Counter(one.part for one in edits), Counter(one.part for one in edits if one.kept), tau
    )


def tried_edits(folder: Path) -> Iterator[TriedEdit]:
    """The ideas that a finished run has tried."""
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        steps = list(store.steps())
    chosen = read_selection(inside(folder, SELECTION))
    if chosen is None or chosen.answer is None:
        raise IbridError(
            f"{folder}: holds no finished run, which alone teaches; finish it with ibrid search "
            "--resume"
        )
    inherited = {step.number for step in line({step.number: step for step in steps}, chosen.answer)}
    for step in steps:
        if (
            step.status is Status.OK
            and step.nrmse is not None
            and (part := step.usage.get("family"))
        ):
            fit, look = step.nrmse, step.usage.get("look")
            beyond = (
                log(fit / look)
                if isinstance(look, float) and isfinite(look) and look > 0 and fit > 0
                else None
            )
            yield TriedEdit(str(part), step.number in inherited, beyond)
