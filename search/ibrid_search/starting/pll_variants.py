"""Grid-following library diagrams with their PLL replaced by another kind of PLL.

Screened where no library diagram explains a sweep: a PLL with a steady-state angle error leaves
voltage on its q axis, which no other part of a grid-following control can represent.
"""

from collections.abc import Iterator, Sequence

from ibrid.errors import DiagramError
from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import NotInVocabulary
from ibrid.parts.editing.view import views_of
from ibrid.parts.frames.pll_static_error import KINDS, exchange_pll
from ibrid.structure.diagrams.library import published_names, published_values
from ibrid.study import Study
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.edit_screening import EditScreener, ScreeningFit, rank_fits

#: The PLL kind with most parameters. It contains the others: the usual PLL with a zero reference,
#: the type-1 PLL with a small integral gain.
MOST_GENERAL_PLL = max(KINDS, key=lambda kind: len(KINDS[kind]))


def screen_pll_variants(
    screener: EditScreener, library_fits: Sequence[ScreeningFit], number: int
) -> list[ScreeningFit]:
    """Screen library diagrams with other PLLs than their own, and return the best.

    All diagrams are screened with the most general PLL, the best of them with every kind.

    Parameters
    ----------
    library_fits : Sequence[ScreeningFit]
        Of library diagrams; those without a PLL are skipped.
    number : int
        Diagrams that are screened with every kind, and screening fits returned at most.
    """
    general_fits = rank_fits(
        fit
        for library_fit in library_fits
        for fit in _screen_with_pll(screener, library_fit, MOST_GENERAL_PLL)
    )[:number]
    best_diagrams = [fit.edit.source.partition(" with ")[0] for fit in general_fits]
    special_plls = [kind for kind in KINDS if kind != MOST_GENERAL_PLL]
    special_fits = [
        fit
        for library_fit in library_fits
        if library_fit.edit.source in best_diagrams
        for kind in special_plls
        for fit in _screen_with_pll(screener, library_fit, kind)
    ]
    return rank_fits([*general_fits, *special_fits])[:number]


def _screen_with_pll(
    screener: EditScreener, library_fit: ScreeningFit, pll_kind: str
) -> Iterator[ScreeningFit]:
    """Screen a library diagram with another kind of PLL, from its published values if any."""
    name = library_fit.edit.source
    values = published_values(name) if name in published_names() else {}
    for edit in _replace_pll(library_fit.edit, screener.study, pll_kind):
        yield screener.screen_from_scratch(edit, values)


def _replace_pll(
    library_edit: CandidateEdit, study: Study, pll_kind: str
) -> Iterator[CandidateEdit]:
    """Yield a library diagram with its PLL replaced, for each device that has exactly one PLL of
    another kind.
    """
    for view in views_of(library_edit.diagram, study.kinds):
        plls = view.draft.having(Element.PLL)
        if len(plls) != 1 or view.shipped(plls[0]) == pll_kind:
            continue
        try:
            edited = view.drawn(lambda draft, pll=plls[0]: exchange_pll(draft, pll, pll_kind))
        except (NotInVocabulary, DiagramError):
            continue
        diagram = edited.diagram
        if not study.examined(diagram, diagram.name).violations:
            source = f"{library_edit.source} with {pll_kind}"
            yield CandidateEdit(diagram, f"the shipped diagram {source}", source, {})
