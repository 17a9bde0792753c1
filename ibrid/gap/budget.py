"""How much a search for a gap may do: experiments, which are the same on every machine, and no
seconds.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import Any

from ibrid.fit.settings import require_one_of

#: Experiments (looks at an edit, and refits) that a search for a gap may make, by the name of the
#: effort. Counted with the whole catalogue: 70 to 90 where nothing is missing, 90 to 230 beside a
#: wrong label, 330 and 590 for two effects, 890 and 1,440 for shipped sweeps beside `gfl`, 2,155
#: for an effect that the catalogue lacks, the most of these.
EXPERIMENTS: Mapping[str, float] = MappingProxyType({"low": 600, "normal": 10_000, "high": inf})


@dataclass
class Budget:
    """Experiments of one search for a gap, counted by its dataset even where results are cached.

    `effort` : a name of `EXPERIMENTS`. `made` : so many experiments. `stopped` : True once more
    were wanted than the effort has.
    """

    effort: str = "normal"
    made: int = 0
    stopped: bool = False

    def __post_init__(self) -> None:
        require_one_of("effort", self.effort, tuple(EXPERIMENTS))

    def spend(self, experiments: int = 1) -> None:
        """So many experiments are made."""
        self.made += experiments

    def is_exhausted(self) -> bool:
        """True when no further experiment may begin."""
        self.stopped = self.stopped or self.made >= EXPERIMENTS[self.effort]
        return self.stopped

    def summarise(self, sentence: str) -> dict[str, Any]:
        """What an answer with such a sentence says of it, as fields: unfinished where more was
        wanted.
        """
        spent: dict[str, Any] = {"effort": self.effort, "experiments": self.made}
        if not self.stopped:
            return spent
        short = (
            f"Stopped after {self.made} experiments (effort {self.effort}), when not everything "
            "was tried: this holds "
            "of what was; go on with a higher effort."
        )
        return {**spent, "complete": False, "sentence": f"Unfinished: {sentence} {short}"}

    @contextmanager
    def without_counting(self) -> Iterator[None]:
        """Experiments within are not counted: those of an answer on the way, which come by the
        clock.
        """
        made, stopped = self.made, self.stopped
        try:
            yield
        finally:
            self.made, self.stopped = made, stopped
