"""Proposers of the search as suggesters of the gap workflow: what might be missing where the
catalogue has no name.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.results.suggested_edits import Suggest, Suggestion, SuggestionRequest
from ibrid.measurement.sweeps.amplitudes import evenly
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study
from ibrid_search.edits import EditError, apply_edit
from ibrid_search.evaluated import SCALES, Evaluated
from ibrid_search.proposal import Complaint, Context, Proposer
from ibrid_search.settings import SearchSettings

#: Suggestions that a language model is asked for, and whoever answers at once.
FEW, MANY = 12, 100
#: Frequencies of a measured transfer that a language model is told.
TOLD = 12


def suggestions_of(proposer: Proposer, number: int = FEW, seed: int = 0) -> Suggest:
    """What a proposer suggests, `number` questions of all three scales in turn; an answer that is
    no program is passed over after its second attempt.
    """

    def suggest(question: SuggestionRequest) -> Iterator[Suggestion]:
        rng = np.random.default_rng(seed)
        scales = SearchSettings().scales
        study = Study(question.sweep, vocabulary=question.kinds)
        parent = Evaluated(0, question.diagram, question.record)
        remark = "\n".join(told(one) for one in question.ports[:3])
        for _ in range(number):
            scale = str(rng.choice(SCALES, p=[scales[one] for one in SCALES]))
            found = _answer(proposer, Context(study, parent, scale=scale, remark=remark), rng)
            if found is not None:
                yield found

    return suggest


def _answer(proposer: Proposer, context: Context, rng: np.random.Generator) -> Suggestion | None:
    for _ in range(max(proposer.attempts, 1)):
        proposal = proposer.propose(context, rng)
        if not proposal.edit:
            return None
        try:
            text = apply_edit(proposal.edit, program_text(context.parent.diagram))
            return Suggestion(
                parse_program(text), proposal.note or "an edit without a note", proposer.name
            )
        except (EditError, IbridError) as error:
            context = replace(context, complaint=Complaint(proposal.edit, str(error)))
    return None


def told(fit: PortFit) -> str:
    """A place where one unknown transfer Delta explains everything, and its curve, for a language
    model.
    """
    rows = "; ".join(
        f"{fit.frequency[k]:.4g} Hz: {np.abs(fit.transfer[k]):.3g} at "
        f"{np.degrees(np.angle(fit.transfer[k])):.0f} deg "
        f"(+- {fit.deviation[k]:.2g})"
        for k in evenly(len(fit.frequency), TOLD)
    )
    return (
        f"At {fit.port.words} an unknown transfer, added to what the model has there, explains the "
        f"measurement: {rows}."
    )
