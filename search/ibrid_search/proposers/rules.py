"""The offline default: reads where the error lies, knows the textbook's blocks, and tries what an
engineer would try.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from ibrid.evaluation.record import Record
from ibrid.fit.objective import BAND_NAMES
from ibrid.modules.plant import L_FILTER, LCL
from ibrid.parts import FAMILIES, Family, Move, View, views_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid_search.proposal import Context, Proposal, Proposer
from ibrid_search.proposers.first_look import LOOKED_AT, LOOKS, first_look
from ibrid_search.screening.settings import SCREENING

#: Share of proposals that ignore where the error lies and how usual a family is.
CURIOSITY = 0.2
#: How much the scale that was asked for raises the weight of a family.
ASKED = 3.0
#: How much lighter everything else is while a part that every controller has is missing.
LATER = 0.05
#: Least part of a family's weight that the residual cannot take away.
LEAST_RELEVANCE = 0.1
#: Edits that a first look compares.
COMPARED = 6


class Rules(Proposer):
    """Textbook edits, weighted by the bands in which they usually show and by where the parent's
    error lies.

    One edit adds, replaces or removes at most one sub-loop. The scale that is asked for is a
    preference, not a fence: what an engineer misses most is tried first. Edits that lead to an
    illegal or already known structure are passed over. Of two devices behind one PCC one is edited
    at a time.

    Once the error is no longer gross, every other proposal is the best of several edits, drawn as
    always, that a first look at the data tells apart. Before that a wrong structure may gain more
    at once than the first part of the right one; and the right edit may look no better at first
    than none, so that the rest come as they are drawn. `looks` : how many; 1: no looks.
    """

    name = "rules"

    def __init__(self, families: Sequence[Family] = FAMILIES, *, looks: int = COMPARED) -> None:
        self.families, self.looks = tuple(families), looks

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of the parent that leads to a structure which the run has not met."""
        views = views_of(context.parent.diagram, context.study.kinds)
        if not views:
            return Proposal(
                "",
                failure=f"the rules know diagrams with an {LCL.name} or {L_FILTER.name}; use "
                "another proposer",
            )
        record = context.parent.record
        bands = residual_bands(record)
        gross = record.nrmse is None or record.nrmse > max(
            SCREENING.gross_error, SCREENING.gross_noise_ratio * (record.noise_floor or 0.0)
        )

        @cache
        def untried(family: Family) -> list[tuple[View, Move]]:
            """The moves of a family that are left, each with the view that it was found in."""
            return [(view, move) for view in views for move in family.moves(view)]

        families = [one for one in self.families if not one.first or untried(one)]
        number = 1 if gross or rng.random() >= LOOKED_AT else self.looks
        edits: list[tuple[Diagram, Proposal]] = []
        while families and len(edits) < number:
            family = _drawn(families, bands, context.scale, rng, gross=gross)
            if not (moves := untried(family)):
                families.remove(family)
                continue
            weights = np.array([one.weight for _, one in moves])
            view, move = moves.pop(int(rng.choice(len(moves), p=weights / weights.sum())))
            edited = view.after(move)
            if context.is_new(edited):
                usage = {"family": family.name}
                edits.append(
                    (edited, Proposal.between(view.whole, edited, view.words(move), usage=usage))
                )
        if not edits:
            return Proposal(
                "", failure="every edit that the rules know leads to a structure met before"
            )
        return edits[0][1] if len(edits) == 1 else _most_promising(edits, context, rng)


def _most_promising(
    edits: Sequence[tuple[Diagram, Proposal]], context: Context, rng: np.random.Generator
) -> Proposal:
    """The edit that a first look at all of them finds best. Their number is kept beside it."""
    worth = [first_look(diagram, context, rng).worth for diagram, _ in edits]
    _, proposal = edits[int(np.argmin(worth))]
    return replace(proposal, usage={**proposal.usage, LOOKS: len(edits)})


def residual_bands(record: Record) -> np.ndarray:
    """How much each frequency band matters (4,), adding up to 1: half its share of the squared
    error, half how badly the band itself is met.
    """
    share = np.array([_number(record.share_by_band, name) for name in BAND_NAMES])
    relative = np.array([_number(record.nrmse_by_band, name) for name in BAND_NAMES])
    total = np.zeros(len(BAND_NAMES))
    for part in (share, relative):
        if part.sum() > 0:
            total += part / part.sum()
    return total / total.sum() if total.sum() > 0 else np.full(len(BAND_NAMES), 1 / len(BAND_NAMES))


def _number(table: Mapping[str, float | None], name: str) -> float:
    value = table.get(name)
    return value if value is not None and np.isfinite(value) else 0.0


def _drawn(
    families: Sequence[Family],
    bands: np.ndarray,
    scale: str,
    rng: np.random.Generator,
    *,
    gross: bool,
) -> Family:
    """A family, by how usual it is, how much it matters where the error lies, and whether it has
    the scale asked for.
    """
    weights = np.array([ASKED if one.scale == scale else 1.0 for one in families])
    if rng.random() >= CURIOSITY:
        weights *= [
            one.readiness(gross=gross) * max(float(bands @ np.array(one.bands)), LEAST_RELEVANCE)
            for one in families
        ]
        if any(one.first for one in families):
            weights *= [1.0 if one.first or one.any_time else LATER for one in families]
    return families[int(rng.choice(len(families), p=weights / weights.sum()))]
