"""Generic models by name: of which blocks they are made, and how they are played."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.generic.block import Constant, LawBlock
from ibrid.generic.dialect import Dialect
from ibrid.generic.reec_a import REEC_A
from ibrid.generic.regc_a import REGC_A
from ibrid.generic.simulate import play_current_source

Rest = tuple[float, float, float]
Played = Callable[
    [Mapping[str, float], Dialect, np.ndarray, np.ndarray, np.ndarray, Rest], np.ndarray
]


@dataclass(frozen=True)
class GenericModel:
    """`play` : values, dialect, time, v, told, rest -> current. `starts` : values beside the
    typical ones at which a fit begins too, since least squares does not get there from them.
    """

    name: str
    blocks: tuple[LawBlock, ...]
    play: Played
    starts: tuple[Mapping[str, float], ...] = ()

    @property
    def typical(self) -> dict[str, float]:
        """Values of all blocks by name."""
        return {name: value for block in self.blocks for name, value in block.typical.items()}

    @property
    def constants(self) -> tuple[Constant, ...]:
        """Of all blocks, in their order."""
        return tuple(constant for block in self.blocks for constant in block.constants)


#: A converter that keeps its active current in a dip.
_WHOLE_IN_DIPS = {"Lvpnt1": 0.25, "Lvpnt0": 0.05, "Imax": 1.6}
MODELS = {
    model.name: model
    for model in (
        GenericModel(
            "wecc_regc_a+reec_a", (REGC_A, REEC_A), play_current_source, (_WHOLE_IN_DIPS,)
        ),
    )
}


def model_named(name: str) -> GenericModel:
    """A model; the prefix wecc_ may be left out. IbridError where no model has the name."""
    known = {**MODELS, **{key.removeprefix("wecc_"): model for key, model in MODELS.items()}}
    if name.lower() not in known:
        raise IbridError(f"no generic model is called {name!r}; {near(name, MODELS)}")
    return known[name.lower()]
