"""The question to a language model as an engineer would want it asked: data, what they say, the
best programs with their records and diagnosis, what was tried; the model chooses which program it
edits and how much of it.

The paper's own question is `ibrid_search.language_models.context`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.quality.sequence_view import sequence_view
from ibrid.measurement.sweeps.amplitudes import evenly
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep
from ibrid.structure.comparison.compare import difference
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study
from ibrid_search.chat.chat import Message, estimated_tokens
from ibrid_search.language_models.context import example_edit, system_facts
from ibrid_search.language_models.language import kinds_text, words
from ibrid_search.language_models.physics_in_words import physics_in_words
from ibrid_search.language_models.record_view import port_view, record_facts
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.screening.edit_screening import ScreeningFit

#: Tokens of a question, where nobody says how many.
TOKENS = 6_000
#: Operating points whose impedances are shown.
POINTS = 2


@dataclass(frozen=True)
class Detail:
    """How much is told.

    `rows` : frequencies of a point. `others` : best programs beside the parent. `ranked` : edits of
    the diagnosis. `recent` : last steps. `whole` : the record with parameters and parts. `ports` :
    of the port map.
    """

    rows: int
    others: int
    ranked: int
    recent: int
    whole: bool
    ports: int = 0


#: From all that helps to what is needed.
DETAILS = (
    Detail(16, 4, 8, 8, True, 3),
    Detail(12, 2, 6, 8, True, 2),
    Detail(10, 2, 6, 6, False, 1),
    Detail(8, 1, 5, 4, False),
    Detail(6, 0, 4, 2, False),
    Detail(3, 0, 2, 1, False),
)


def engineer_question(
    context: Context,
    *,
    limit_tokens: int | None = None,
    count: Callable[[str], int] = estimated_tokens,
    fields: bool = False,
) -> list[Message]:
    """System and user turn; as much of what `DETAILS` lists as stays within `limit_tokens` of both
    together.

    limit_tokens : None for `TOKENS`, or the shortest form where that is longer, as for two large
    devices in one program.
    fields : the answer is asked for as JSON (`ibrid_search.proposers.edit_fields`), not as blocks.

    Raises IbridError when even the shortest form is longer than a limit that was given.
    """
    system, ranked = engineer_system(context.study, fields=fields), ranked_edits(context)
    used = 0
    for detail in DETAILS:
        user = _asked(context, ranked, detail)
        used = count(system) + count(user)
        if used <= (limit_tokens or TOKENS) or (limit_tokens is None and detail is DETAILS[-1]):
            return [{"role": "system", "content": system}, {"role": "user", "content": user}]
    raise IbridError(
        f"the shortest prompt for this program has about {used} tokens, but the limit is "
        f"{limit_tokens}; raise it"
    )


def engineer_system(study: Study, *, fields: bool = False) -> str:
    """What does not change in a run."""
    facts = {
        **system_facts(study),
        "modules": kinds_text(study.kinds, study.equilibrium, short=True),
    }
    return words("engineer.md", **facts, example=example_edit(study.kinds), fields=fields)


def shown_programs(context: Context) -> tuple[Evaluated, ...]:
    """What an answer may edit: the parent first, then the best others."""
    return (context.parent, *(one for one in context.best if one.step != context.parent.step))


def ranked_edits(context: Context) -> list[ScreeningFit]:
    """What an answer may take of the diagnosis, in the order of the numbers that the question gives
    them.
    """
    return context.lacks(DETAILS[0].ranked)


def _asked(context: Context, ranked: list[ScreeningFit], detail: Detail) -> str:
    parent, data = context.parent, context.study.fitted

    def changed(one: Evaluated) -> list[str]:
        lines = difference(program_text(parent.diagram), program_text(one.diagram))
        return [line for line in lines if line[:1] in ("+", "-")]

    return words(
        "engineer_question.md",
        said=(*physics_in_words(data), *sequence_view(data).sentences),
        entries=ENTRIES,
        points=data.points[:POINTS],
        further=len(data.points) - POINTS,
        shown=lambda point: evenly(len(point.frequency), detail.rows),
        impedances=_impedances,
        parent=parent,
        **record_facts(parent.record, short=not detail.whole),
        ranked=ranked[: detail.ranked],
        ports=[port_view(one) for one in context.ports[: detail.ports]] if detail.ports else [],
        others=shown_programs(context)[1 : 1 + detail.others],
        changed=changed,
        recent=context.recent[: detail.recent],
        remark=context.remark,
        complaint=context.complaint,
    )


def _impedances(point: PointSweep, k: int) -> str:
    impedance = -np.linalg.inv(point.admittance[k])
    cells = (
        f"{abs(impedance[place]):.3g}/{np.degrees(np.angle(impedance[place])):.0f}"
        for place in ENTRIES.values()
    )
    return " ".join(cells)
