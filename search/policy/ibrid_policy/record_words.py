"""A question as words: the setting, the scale that is asked for, the residual in few levels, and
the diagram.
"""

import numpy as np

from ibrid.fit.objective import BAND_NAMES
from ibrid.measurement.sweeps.sweep import ENTRIES
from ibrid.modules.vocabulary import PAPER_VOCABULARY, Vocabulary
from ibrid.structure.reading.wiring import split_port
from ibrid_policy.diagram_words import diagram_words
from ibrid_policy.numbering import Numbered
from ibrid_policy.residual import ResidualMeans
from ibrid_policy.tokens import (
    ANSWER,
    BOUND,
    ERROR_LEVELS,
    MOST_POINTS,
    SECTORS,
    SHARE_LEVELS,
    SIZE_LEVELS,
    TOTAL_LEVELS,
    module_word,
)

#: Relative errors at which a level ends.
ERROR_EDGES = (0.003, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.1)
SHARE_EDGES = (0.05, 0.2, 0.5, 0.8)
#: Below this error, or this likeness between frequencies, the phase of a residual says nothing.
TELLING_ERROR, TELLING_LIKENESS = 0.01, 0.6
#: Numbers at an end of their box that are told, at most.
MOST_BOUNDS = 6


def question_words(
    view: Numbered, residual: ResidualMeans, scale: str, setting: tuple[str, str, str]
) -> list[str]:
    """All words of a question.

    setting : vocabulary ("paper" or "extended"), equilibrium, parameters.
    """
    vocabulary, equilibrium, parameters = setting
    return [
        f"vocabulary:{vocabulary}",
        f"equilibrium:{equilibrium}",
        f"parameters:{parameters}",
        *residual_words(residual),
        *_bounds(view, residual),
        *diagram_words(view),
        f"scale:{scale}",
        ANSWER,
    ]


def vocabulary_word(kinds: Vocabulary) -> str:
    """ "paper" where only kinds of the paper may be used, else "extended"."""
    return (
        "paper"
        if {kind.name for kind in kinds} <= {kind.name for kind in PAPER_VOCABULARY}
        else "extended"
    )


def residual_words(residual: ResidualMeans) -> list[str]:
    """The levels of a residual: the whole, the bands, then each band and entry."""
    words = [f"points:{min(residual.points, MOST_POINTS)}", f"total:{total_level(residual.total)}"]
    for band in range(len(BAND_NAMES)):
        words.append(f"share:{band}:{_level(residual.share[band], SHARE_EDGES, SHARE_LEVELS)}")
        for column, entry in enumerate(ENTRIES):
            error, size = residual.error[band, column], residual.size[band, column]
            if np.isnan(error):
                continue
            part = f"{band}:{entry}"
            words.append(f"error:{part}:{_level(error, ERROR_EDGES, ERROR_LEVELS)}")
            if error > TELLING_ERROR and abs(residual.turn[band, column]) > TELLING_LIKENESS:
                words.append(f"turn:{part}:{sector(residual.turn[band, column])}")
            words.append(f"size:{part}:{size_level(size)}")
            if abs(residual.angle[band, column]) > TELLING_LIKENESS:
                words.append(f"angle:{part}:{sector(residual.angle[band, column])}")
    return words


def total_level(error: float) -> int:
    """Five levels a decade, from 1e-4 to 2."""
    return int(np.clip(np.floor(5 * np.log10(max(error, 1e-9))) + 20, 0, TOTAL_LEVELS - 1))


def size_level(size: float) -> int:
    """Two levels a decade, from 1e-3 to 100 per unit."""
    return int(np.clip(np.round(2 * np.log10(max(size, 1e-9))) + 6, 0, SIZE_LEVELS - 1))


def sector(value: complex) -> int:
    """Which eighth of a turn a phase is nearest to."""
    return int(np.round(np.angle(value) / (2 * np.pi / SECTORS))) % SECTORS


def _level(value: float, edges: tuple[float, ...], levels: int) -> int:
    return min(int(np.searchsorted(edges, value, side="right")), levels - 1)


def _bounds(view: Numbered, residual: ResidualMeans) -> list[str]:
    words: list[str] = []
    for name in residual.at_bound[:MOST_BOUNDS]:
        owner, parameter = split_port(name)
        number = view.place.get(owner)
        if number is not None and parameter in view.kinds[number].parameters:
            words += [BOUND, module_word(number), f"@{parameter}"]
    return words
