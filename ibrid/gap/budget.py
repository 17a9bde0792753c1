"""The effort of a search for a gap, counted in experiments, which are the same on every machine."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import Any

from ibrid.fit.settings import require_one_of

#: Experiments (fits and screening fits of edits) that a search may make, by the name of the effort.
#: With the whole catalogue: 70 to 90 where nothing is missing, 90 to 230 with a wrong label, 330
#: and 590 for two effects, 890 and 1,440 for the built-in sweeps with `gfl`, 2,155 for an effect
#: that the catalogue lacks, the most of these.
EXPERIMENTS: Mapping[str, float] = MappingProxyType({"low": 600, "normal": 10_000, "high": inf})


@dataclass
class Budget:
    """Experiments of one search for a gap, counted by its dataset even where results are cached.

    Parameters
    ----------
    effort : str
        A name of `EXPERIMENTS`.
    made : int
        Experiments so far.
    stopped : bool
        Whether more were wanted than the effort allows.
    """

    effort: str = "normal"
    made: int = 0
    stopped: bool = False

    def __post_init__(self) -> None:
        require_one_of("effort", self.effort, tuple(EXPERIMENTS))

    def spend(self, experiments: int = 1) -> None:
        """Count experiments that are made."""
        self.made += experiments

    def is_exhausted(self) -> bool:
        """Whether no further experiment may begin."""
        self.stopped = self.stopped or self.made >= EXPERIMENTS[self.effort]
        return self.stopped

    def summarise(self, sentence: str) -> dict[str, Any]:
        """Return the fields of a `Gap` that report the effort.

        sentence : of the result; it is extended where the search was stopped.
        """
        fields: dict[str, Any] = {"effort": self.effort, "experiments": self.made}
        if not self.stopped:
            return fields
        warning = (
            f"Stopped after {self.made} experiments (effort {self.effort}), when not everything "
            "was tried: this holds "
            "of what was; go on with a higher effort."
        )
        return {**fields, "complete": False, "sentence": f"Unfinished: {sentence} {warning}"}

    @contextmanager
    def without_counting(self) -> Iterator[None]:
        """Do not count experiments inside: those of intermediate results depend on the clock."""
        made = self.made
        stopped = self.stopped
        try:
            yield
        finally:
            self.made = made
            self.stopped = stopped
