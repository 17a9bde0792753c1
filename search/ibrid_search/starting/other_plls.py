"""Grid-following diagrams with another PLL in place of theirs, looked at where none as it ships
explains a sweep.
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
from ibrid_search.screening.edit_screening import EditScreener, ScreeningFit

#: The one of most numbers contains the others: without a reference the usual one, with next to no
#: integral gain the type-1 PLL.
WIDEST = max(KINDS, key=lambda kind: len(KINDS[kind]))


def looks_with_other_plls(
    screener: EditScreener, looks: Sequence[ScreeningFit], few: int
) -> list[ScreeningFit]:
    """The best few of shipped diagrams with other PLLs than their own, by looks.

    All are looked at with the widest kind, then the best of them with each.
    looks : of shipped diagrams, the best first; those without a PLL are passed by.
    """
    widest = [look for shipped in looks for look in _looks_with(screener, shipped, WIDEST)]
    widest.sort(key=lambda look: look.worth)
    names = [look.edit.source.partition(" with ")[0] for look in widest[:few]]
    chosen = [look for look in looks if look.edit.source in names]
    narrower = [kind for kind in KINDS if kind != WIDEST]
    others = [
        look
        for shipped in chosen
        for kind in narrower
        for look in _looks_with(screener, shipped, kind)
    ]
    return sorted([*widest[:few], *others], key=lambda look: look.worth)[:few]


def _looks_with(screener: EditScreener, shipped: ScreeningFit, kind: str) -> Iterator[ScreeningFit]:
    name = shipped.edit.source
    known = published_values(name) if name in published_names() else {}
    for edit in _with(shipped.edit, screener.study, kind):
        yield screener.screen_from_scratch(edit, known)


def _with(shipped: CandidateEdit, study: Study, kind: str) -> Iterator[CandidateEdit]:
    """A shipped diagram of one PLL of another kind with that kind."""
    for view in views_of(shipped.diagram, study.kinds):
        plls = view.draft.having(Element.PLL)
        if len(plls) != 1 or view.shipped(plls[0]) == kind:
            continue
        try:
            drawn = view.drawn(lambda draft, pll=plls[0]: exchange_pll(draft, pll, kind)).diagram
        except (NotInVocabulary, DiagramError):
            continue
        if not study.examined(drawn, drawn.name).violations:
            part = f"{shipped.part} with {kind}"
            yield CandidateEdit(drawn, f"the shipped diagram {part}", part, {})
