"""The vocabulary: all kinds in the order of Table I, then the extended ones."""

from collections.abc import Sequence

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError, near
from ibrid.modules.behaviour import Element
from ibrid.modules.branch import DC_LINK, SHUNT_RC
from ibrid.modules.control import INTEGRATOR, LPF1, LPF1_DQ, PI, PI_DQ
from ibrid.modules.converter import DEAD_TIME, TURN, ZERO_ORDER_HOLD
from ibrid.modules.delay import DELAY, PADE2_DQ, PADE3_DQ, PADE4_DQ
from ibrid.modules.kind import ModuleKind
from ibrid.modules.operating_point import (
    J_MUL_OMEGA,
    MAGNITUDE,
    PQ_CALC,
    REF_PQ,
    ROT_I,
    ROT_V,
    SHARE,
)
from ibrid.modules.plant import L_FILTER, LCL
from ibrid.modules.plant_variants import LCL_R, LCL_RC, LCL_SATURATED, LCL_TRAP, LL_FILTER
from ibrid.modules.residual import NOTCH, PADE1, PADE1_DQ
from ibrid.modules.sequence import (
    DDSRF_DQ,
    DSOGI_DQ,
    DSOGI_FIXED,
    PI_NEGATIVE_DQ,
    RESONANT_DQ,
    SOGI_DQ,
    SOGI_FIXED,
)
from ibrid.modules.static import (
    CONST_ZERO,
    GAIN,
    GAIN_DQ,
    J_MUL,
    NEGATE,
    NEGATE_DQ,
    PACK_DQ,
    SLICE_D,
    SLICE_Q,
)
from ibrid.modules.synchronisation import DVOC, PLL_FREQUENCY, SRF_PLL, SRF_PLL_P, SRF_PLL_REF
from ibrid.signals import Signal

Vocabulary = tuple[ModuleKind, ...]

#: The 23 kinds of the paper's appendix.
PAPER_VOCABULARY: Vocabulary = (
    LCL,
    L_FILTER,
    PI,
    PI_DQ,
    LPF1,
    LPF1_DQ,
    INTEGRATOR,
    SRF_PLL,
    ROT_V,
    ROT_I,
    PQ_CALC,
    GAIN,
    GAIN_DQ,
    NEGATE,
    NEGATE_DQ,
    PACK_DQ,
    SLICE_D,
    SLICE_Q,
    J_MUL,
    CONST_ZERO,
    PADE1,
    PADE1_DQ,
    NOTCH,
)

#: The default: the paper's kinds and the extended ones.
VOCABULARY: Vocabulary = (
    *PAPER_VOCABULARY,
    J_MUL_OMEGA,
    DELAY,
    MAGNITUDE,
    LCL_R,
    LCL_RC,
    LL_FILTER,
    SHUNT_RC,
    DC_LINK,
    PLL_FREQUENCY,
    DVOC,
    SHARE,
    DEAD_TIME,
    TURN,
    ZERO_ORDER_HOLD,
    SOGI_DQ,
    DSOGI_DQ,
    DDSRF_DQ,
    RESONANT_DQ,
    REF_PQ,
    LCL_TRAP,
    SOGI_FIXED,
    DSOGI_FIXED,
    LCL_SATURATED,
    SRF_PLL_P,
    SRF_PLL_REF,
    PADE2_DQ,
    PADE3_DQ,
    PADE4_DQ,
    PI_NEGATIVE_DQ,
)

NAMED_VOCABULARIES = {"paper": PAPER_VOCABULARY, "extended": VOCABULARY}


@takes_kinds
def choose_vocabulary(vocabulary: str | Sequence[ModuleKind]) -> Vocabulary:
    """`"paper"`, `"extended"` or kinds of one's own, such as `VOCABULARY + (MINE,)`, as a tuple of
    kinds.

    Raises DiagramError for an unknown name and for two kinds of one name.
    """
    if isinstance(vocabulary, str):
        if vocabulary not in NAMED_VOCABULARIES:
            raise DiagramError(
                f"no vocabulary is called {vocabulary!r}; {near(vocabulary, NAMED_VOCABULARIES)}"
            )
        return NAMED_VOCABULARIES[vocabulary]
    kinds = tuple(vocabulary)
    names = [kind.name for kind in kinds]
    if twice := {name for name in names if names.count(name) > 1}:
        raise DiagramError(
            f"the vocabulary has two kinds called {sorted(twice)[0]}; rename one of them"
        )
    return kinds


@takes_kinds
def find_kind(name: str, vocabulary: Sequence[ModuleKind]) -> ModuleKind:
    """The kind of that name; DiagramError with near names otherwise."""
    for kind in vocabulary:
        if kind.name == name:
            return kind
    hint = (
        "one of your own comes with --kinds FILE.py; "
        f"{near(name, (kind.name for kind in vocabulary))}"
    )
    raise DiagramError(f"the vocabulary has no kind {name!r}; {hint}")


def usual_kind(
    element: Element, signal: Signal | None = None, kinds: Sequence[ModuleKind] = VOCABULARY
) -> ModuleKind:
    """The kind that a new block of this element gets: the first of `kinds`, the one that ships
    where they have none.

    signal : what it carries, where there is one of it for scalars and one for dq vectors.
    """
    return next(
        kind
        for kind in (*kinds, *VOCABULARY)
        if kind.element is element and (signal is None or kind.signal is signal)
    )
