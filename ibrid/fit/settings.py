"""How much effort a fit makes, and what it minimises."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from numbers import Integral
from types import MappingProxyType
from typing import Any

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import IbridError
from ibrid.fit.objective import FINAL_OBJECTIVES

#: Least value of each count.
_LEAST = {
    **dict.fromkeys(
        ("restarts", "hops", "hops_in_noise", "most_hops", "iterations", "ipopt_iterations"), 0
    ),
    **dict.fromkeys(
        (
            "frequencies",
            "starts",
            "kept",
            "kept_misfit",
            "agreeing",
            "kicked",
            "warm",
            "warm_kept",
            "descents",
        ),
        1,
    ),
}
#: Names of the budgets of work that every command with a budget takes.
EFFORTS = ("low", "normal", "high")


def require_one_of(what: str, value: Any, known: Sequence[str]) -> None:
    """Raise IbridError, with the near ones, unless `value` is among the `known` words."""
    if value in known:
        return
    close = get_close_matches(str(value), known, cutoff=0.5)
    meant = f"; did you mean {' or '.join(close)}?" if close else ""
    raise IbridError(f"{what} must be one of {', '.join(known)}, found {value!r}{meant}")


@methods_take_kinds
@dataclass(frozen=True)
class FitSettings:
    """How much effort a fit makes: everything is counted, so that the same fit ends at the same
    place on every machine.

    `objective` : what is minimised in the end; None: `evaluate` chooses by the data. `frequencies`
    : of each operating point at most, on which minima are looked for; the end takes all of them.
    `starts` : screened per wave.
    `kept` : of them, those that descend. `halving` : (iterations, kept) per stage on the
    logarithmic residual.
    `restarts` : further waves at most. `agreeing` : finished starts within `agreement` (relative)
    of the best that end the search, from two waves. `solved` : root-mean-square relative error
    below which the fit is finished.
    `misfit` : above this the structure probably cannot fit, and more starts are carried to the end.
    `hops` : rounds without gain, in which `kicked` copies of the best answer get some coordinates
    moved or redrawn, that end a fit; `hops_in_noise` : of those where noise alone is left;
    `most_hops` : rounds at most, with gain or without. `iterations` : steps of a descent at most.
    `ipopt_iterations` : of Ipopt at the end. `warm`, `warm_kept` : draws of the numbers that known
    values lack, and how many of them descend.
    `descents` : of records of events alone, starts that are descended at most while none explains
    them.
    """

    objective: str | None = None
    frequencies: int = 24
    starts: int = 96
    kept: int = 8
    halving: tuple[tuple[int, int], ...] = ((8, 6), (8, 4))
    kept_misfit: int = 12
    restarts: int = 5
    agreeing: int = 3
    agreement: float = 1e-3
    solved: float = 1e-7
    misfit: float = 0.03
    hops: int = 4
    hops_in_noise: int = 2
    most_hops: int = 40
    kicked: int = 32
    warm: int = 24
    warm_kept: int = 4
    iterations: int = 80
    ipopt_iterations: int = 40
    descents: int = 3

    def __post_init__(self) -> None:
        require_kinds(self)
        require_one_of("objective", self.minimised, FINAL_OBJECTIVES)
        for name, least in _LEAST.items():
            value = getattr(self, name)
            if not isinstance(value, Integral) or value < least:
                raise IbridError(
                    f"{name} must be a whole number of {least} or more, found {value!r}"
                )
        for name in ("agreement", "solved", "misfit"):
            if not 0 <= getattr(self, name) < 1:
                raise IbridError(
                    f"{name} must be a relative error from 0 to below 1, found "
                    f"{getattr(self, name)!r}"
                )

    @property
    def minimised(self) -> str:
        """The objective; the paper's where none is chosen."""
        return "nrmse" if self.objective is None else self.objective

    @property
    def survivors(self) -> int:
        """How many starts of a wave are left where one of them fits."""
        return self.halving[-1][1] if self.halving else self.kept

    @property
    def effort(self) -> str:
        """The name of this much effort, "own" where it has none."""
        named = (
            name
            for name, known in FIT_EFFORTS.items()
            if replace(self, objective=known.objective) == known
        )
        return next(named, "own")


#: The effort of a fit by its name.
FIT_EFFORTS: Mapping[str, FitSettings] = MappingProxyType(
    {
        "low": FitSettings(starts=64, restarts=1, hops=1, hops_in_noise=1, kicked=16, descents=1),
        "normal": FitSettings(),
        "high": FitSettings(restarts=12, agreeing=5, hops=8, hops_in_noise=8, descents=6),
    }
)


def fit_settings(effort: str) -> FitSettings:
    """The effort of a fit by its name; IbridError for a name that there is not."""
    require_one_of("effort", effort, EFFORTS)
    return FIT_EFFORTS[effort]
