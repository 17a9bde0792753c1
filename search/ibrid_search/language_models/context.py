"""The prompt of a language model: the four parts of the paper's context (section V.B), the edit
asked for, the history.

1. objective and metric, 2. language, vocabulary and grammar, 3. the parent with its record, 4.
   engineering priors. The
first, second and fourth stay the same in a run and form the system turn. Text that came from a
model is data: it is fenced, and cannot close its fence or speak for another turn.
"""

from collections.abc import Callable
from itertools import zip_longest

from ibrid.errors import IbridError
from ibrid.modules.vocabulary import Vocabulary
from ibrid.study import Study
from ibrid_search.blocks import write_block
from ibrid_search.chat.chat import Message, estimated_tokens
from ibrid_search.language_models.language import kinds_text, rules_text, words
from ibrid_search.language_models.quoting import fenced, quoted
from ibrid_search.language_models.record_view import record_facts
from ibrid_search.proposal import Context
from ibrid_search.step import Step


def prompt(
    context: Context, *, limit_tokens: int, count: Callable[[str], int] = estimated_tokens
) -> list[Message]:
    """System and user turn for the next edit of `context.parent`.

    Parameters
    ----------
    limit_tokens : of both turns together. What does not fit is left out: first candidates and
    failures of the history,
        then details of vocabulary and record. count : tokens of a text, by default an estimate.

    Raises IbridError when even the shortest form is longer.
    """
    for short in (False, True):
        system, question = system_text(context.study, short=short), _question(context, short)
        used = count(system) + count(question)
        if used <= limit_tokens:
            history = _history(context, limit_tokens - used, count)
            user = f"{history}\n\n{question}" if history else question
            return [{"role": "system", "content": system}, {"role": "user", "content": user}]
    raise IbridError(
        f"the shortest prompt for this program has about {used} tokens, but the limit is "
        f"{limit_tokens}; raise it"
    )


def system_text(study: Study, *, short: bool = False) -> str:
    """What does not change in a run: role and objective, language and grammar, priors, form of an
    answer.
    """
    modules = kinds_text(study.kinds, study.equilibrium, short=short)
    return words(
        "system.md", **system_facts(study), modules=modules, example=example_edit(study.kinds)
    )


def system_facts(study: Study) -> dict[str, str]:
    """What a system turn says of the study: points, whether values are shared, when a diagram is
    legal.
    """
    points = "; ".join(
        f"{quoted(one.op.name)} (p = {one.op.p:.3g}, q = {one.op.q:.3g}, v = {one.op.v:.3g}): "
        f"{len(one.frequency)} "
        f"frequencies from {one.frequency[0]:.4g} to {one.frequency[-1]:.4g} Hz"
        for one in study.sweep.points
    )
    shared = (
        "one value at all operating points"
        if study.parameters == "shared"
        else "values of its own at every point"
    )
    return {"points": points, "shared": shared, "rules": rules_text(study.kinds, study.equilibrium)}


def example_edit(kinds: Vocabulary) -> str:
    """An edit that is about no inverter: a block put into a wire."""
    plainest = sorted(kinds, key=lambda one: (one.order, -len(one.parameters)))
    fitting = (
        one.name for one in plainest if [*one.inputs] == ["in_"] and [*one.outputs] == ["out"]
    )
    kind = next(fitting, "KIND")
    inserted = (
        f'    g.add("{kind}", "new")\n    g.connect("a.out", "new.in_")\n    g.connect("new.out", '
        '"b.in_")'
    )
    return write_block(['    g.connect("a.out", "b.in_")'], inserted.split("\n"))


def _question(context: Context, short: bool) -> str:
    return words(
        "question.md",
        parent=context.parent,
        last=context.last,
        remark=context.remark,
        scale=context.scale,
        complaint=context.complaint,
        **record_facts(context.parent.record, short=short),
    )


def _history(context: Context, room: int, count: Callable[[str], int]) -> str:
    """The best candidates and the last failures in turn, as many as there is room for."""
    best = [one for one in context.best if one.step != context.parent.step]
    goods, bads = "# The best so far\n", "# What failed lately\n"
    kept: tuple[list[str], list[str]] = ([], [])
    room -= count(goods) + count(bads) + 4
    for pair in zip_longest(
        (words("candidate.md", one=one) for one in best), map(_failure, context.failures)
    ):
        for text, texts in zip(pair, kept, strict=True):
            needed = count(text) + 2 if text is not None else 0
            if text is not None and needed <= room:
                texts.append(text)
                room -= needed
    return "\n\n".join(
        heading + "\n\n".join(texts)
        for heading, texts in zip((goods, bads), kept, strict=True)
        if texts
    )


def _failure(step: Step) -> str:
    what = f", {quoted(step.note)}" if step.note else ""
    edit = f"\n{fenced(step.edit)}" if step.edit else ""
    return (
        f"Step {step.number} ({step.status}{what}): "
        f"{quoted(step.reason) or 'no reason given'}{edit}"
    )
