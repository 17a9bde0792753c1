"""The question to a language model as an engineer would want it asked: data, what they say, the best programs with their
records and diagnosis, what was tried; the model chooses which program it edits and how much of it.

The paper's own question is `ibrid_search.context`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.quantities import counted
from ibrid.measurement.sequence_view import sequence_view
from ibrid.measurement.sweep import ENTRIES, PointSweep
from ibrid.structure.compare import difference
from ibrid.structure.program import program_text
from ibrid.study import Study
from ibrid_search.context import complaint_text, example_edit, program_block, system_facts
from ibrid_search.diagnosis import RankedEdit
from ibrid_search.language import kinds_text, words
from ibrid_search.physics_in_words import physics_in_words
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.proposers.chat import Message, estimated_tokens
from ibrid_search.quoting import fenced, quoted
from ibrid_search.record_view import port_view, record_text, score_text
from ibrid_search.step import Status, Step

#: Tokens of a question, where nobody says how many.
TOKENS = 6_000
#: Operating points whose impedances are shown.
POINTS = 2


@dataclass(frozen=True)
class Detail:
    """How much is told. `rows` : frequencies of a point. `others` : best programs beside the parent. `ranked` : edits of the
    diagnosis. `recent` : last steps. `whole` : the record with parameters and parts. `ports` : of the port map."""

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
    """System and user turn; as much of what `DETAILS` lists as stays within `limit_tokens` of both together.

    limit_tokens : None for `TOKENS`, or the shortest form where that is longer, as for two large devices in one program.
    fields : the answer is asked for as JSON (`ibrid_search.proposers.edit_fields`), not as blocks.

    Raises IbridError when even the shortest form is longer than a limit that was given.
    """
    system, ranked = engineer_system(context.study, fields=fields), ranked_edits(context)
    used = 0
    for detail in DETAILS:
        user = "\n\n".join(_parts(context, ranked, detail))
        used = count(system) + count(user)
        if used <= (limit_tokens or TOKENS) or (limit_tokens is None and detail is DETAILS[-1]):
            return [{"role": "system", "content": system}, {"role": "user", "content": user}]
    raise IbridError(
        f"the shortest prompt for this program has about {used} tokens, but the limit is {limit_tokens}; raise it"
    )


def engineer_system(study: Study, *, fields: bool = False) -> str:
    """What does not change in a run."""
    facts = {**system_facts(study), "modules": kinds_text(study.kinds, study.equilibrium, short=True)}
    return words("engineer.md", **facts, example=example_edit(study.kinds), fields=fields)


def shown_programs(context: Context) -> tuple[Evaluated, ...]:
    """What an answer may edit: the parent first, then the best others."""
    return (context.parent, *(one for one in context.best if one.step != context.parent.step))


def ranked_edits(context: Context) -> list[RankedEdit]:
    """What an answer may take of the diagnosis, in the order of the numbers that the question gives them."""
    return context.lacks(DETAILS[0].ranked)


def _parts(context: Context, ranked: list[RankedEdit], detail: Detail) -> Iterator[str]:
    parent, study = context.parent, context.study
    said = (*physics_in_words(study.fitted), *sequence_view(study.fitted).sentences)
    yield "# The data, in words\n" + "\n".join(f"- {one}" for one in said)
    yield "\n".join(_data(study, detail.rows))
    yield f"# The best program (step {parent.step})\n{program_block(parent)}"
    yield f"# Its record\n{record_text(parent.record, short=not detail.whole)}"
    if ranked:
        rows = (
            f"{number}. {one.edit.words}: {one.error:.3g}, {counted(one.free, 'free parameter')}"
            for number, one in enumerate(ranked[: detail.ranked], 1)
        )
        yield (
            "# Diagnosis: what it lacks\nOf all edits that control practice knows these explain most of what is left; behind "
            "each the error that a few descent steps reach with it:\n" + "\n".join(rows)
        )
    if detail.ports and (ports := context.ports[: detail.ports]):
        yield (
            "# Where one unknown transfer would explain most\nFitted with the parameters, Delta in a signal 1 + Delta or on a "
            "path of its own; behind each port what is left over, 1 for noise alone, and Delta:\n"
            + "\n".join(f"- {_port(port_view(one))}" for one in ports)
        )
    if others := shown_programs(context)[1 : 1 + detail.others]:
        yield "# Other good programs, as lines that differ from it\n" + "\n\n".join(
            _other(one, parent) for one in others
        )
    if recent := context.recent[: detail.recent]:
        yield "# The last steps\n" + "\n".join(_outcome(step) for step in recent)
    if context.remark:
        yield f"# What else is known\n{fenced(context.remark)}"
    either = "Take an edit of the diagnosis by its number, or write" if ranked else "Write"
    yield f"# What to do\n{either} the edit that you believe in most."
    if context.complaint is not None:
        yield complaint_text(context.complaint)


def _port(told: Mapping[str, Any]) -> str:
    transfer = ", ".join(f"{value} at {hertz}" for hertz, value in told["transfer"].items()) or "not seen"
    return f"{told['port']} ({told['place']}): {told['chi2_per_number']:.3g}; {transfer}"


def _data(study: Study, rows: int) -> Iterator[str]:
    yield "# Impedance Z = -1/Y seen from the grid: size (pu) and angle (deg)"
    for point in study.fitted.points[:POINTS]:
        shown = np.unique(np.linspace(0, len(point.frequency) - 1, min(rows, len(point.frequency))).round().astype(int))
        yield f"{quoted(point.op.name)}, Hz: {' '.join(ENTRIES)} ({len(shown)} of {len(point.frequency)} frequencies)"
        yield from (_row(point, k) for k in shown)
    if left := len(study.fitted.points) - POINTS:
        yield f"({left} further points)" if left > 0 else ""


def _row(point: PointSweep, k: int) -> str:
    impedance = -np.linalg.inv(point.admittance[k])
    cells = (f"{abs(impedance[place]):.3g}/{np.degrees(np.angle(impedance[place])):.0f}" for place in ENTRIES.values())
    return f"{point.frequency[k]:.3g}: {' '.join(cells)}"


def _other(one: Evaluated, parent: Evaluated) -> str:
    lines = difference(program_text(parent.diagram), program_text(one.diagram))
    changed = [line for line in lines if line[:1] in ("+", "-")]
    return f"Step {one.step}: {score_text(one.record)}\n" + "\n".join(changed)


def _outcome(step: Step) -> str:
    what = f"step {step.number}" + (f", an edit of step {step.parent}" if step.parent is not None else "")
    said = f" ({quoted(step.note, longest=160)})" if step.note else ""
    if step.status is Status.OK and step.nrmse is not None:
        return f"- {what}{said}: NRMSE {step.nrmse:.3g}, {counted(step.free or 0, 'free parameter')}" + (
            "" if step.stable else ", UNSTABLE"
        )
    return f"- {what}{said}: {step.status}; {quoted(step.reason, longest=200) or 'no reason given'}"
