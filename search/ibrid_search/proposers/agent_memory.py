"""What an agent remembers of its earlier turns: a function of the stored steps alone, so that a resumed run goes on alike.

The latest turns are there as a conversation, edit and diagnosis against outcome. Older ones shrink to a line with the
diagnosis; when even those are too many, the oldest go.
"""

from collections.abc import Iterator, Mapping, Sequence

from ibrid_search.proposers.chat import Message, estimated_tokens
from ibrid_search.quoting import fenced, quoted
from ibrid_search.step import Status, Step

#: Characters of a diagnosis, and of a reason for a refusal, that are kept.
LONGEST_DIAGNOSIS, LONGEST_REASON = 1_500, 400
#: Share of the tokens of the memory that the notebook of older turns may take.
NOTEBOOK = 0.5

_BEGIN = "Begin. Look at the record of the parent, use the tools where they help, then submit an edit with a diagnosis."


def paragraph(text: str) -> str:
    """A diagnosis as one paragraph of bounded length that cannot speak for another turn."""
    return quoted(text, longest=LONGEST_DIAGNOSIS)


def outcome(step: Step, parent: Step | None = None) -> str:
    """How a step ended, in a sentence; compared with its parent where that is known."""
    which = f"Step {step.number}, an edit of step {step.parent}," if step.parent is not None else f"Step {step.number}"
    if step.nrmse is None or step.status is not Status.OK:
        why = f": {quoted(step.reason, longest=LONGEST_REASON)}" if step.reason else ""
        return f"{which} ended as {step.status}{why}."
    size = f"order {step.order}, {step.free} free parameters"
    stable = "stable" if step.stable else "UNSTABLE, so no answer"
    return f"{which} has NRMSE {step.nrmse:.4g}{_against(step.nrmse, parent)}; {size}, {stable}."


def remembered(steps: Sequence[Step], limit_tokens: int, *, author: str) -> list[Message]:
    """Messages for the turns of `author` among the steps, oldest first, that end with the outcome of the last.

    Roles alternate and begin with the user; the caller's question belongs to the last message. At most `limit_tokens`
    tokens as estimated.
    """
    known = {one.number: one for one in steps}
    turns = [one for one in steps if one.proposer == author and one.status is not Status.PENDING]
    budget, recent = limit_tokens * (1 - NOTEBOOK), len(turns)
    while recent > 0 and (cost := _cost(turns[recent - 1], known)) <= budget:
        budget -= cost
        recent -= 1
    notebook = _notebook(turns[:recent], known, int(limit_tokens * NOTEBOOK))
    messages: list[dict[str, str]] = [{"role": "user", "content": notebook or _BEGIN}]
    for turn in turns[recent:]:
        messages.append({"role": "assistant", "content": _said(turn)})
        messages.append({"role": "user", "content": _result(turn, known)})
    return list(messages)


def _against(nrmse: float, parent: Step | None) -> str:
    if parent is None or parent.nrmse is None:
        return ""
    word = "better than" if nrmse < parent.nrmse else "worse than" if nrmse > parent.nrmse else "the same as"
    return f", {word} its parent's {parent.nrmse:.4g}"


def _said(turn: Step) -> str:
    diagnosis = paragraph(turn.diagnosis) or "(none)"
    return f"Diagnosis: {diagnosis}\n\n{fenced(turn.edit) if turn.edit.strip() else '(no edit)'}"


def _result(turn: Step, known: Mapping[int, Step]) -> str:
    return outcome(turn, known.get(turn.parent) if turn.parent is not None else None)


def _cost(turn: Step, known: Mapping[int, Step]) -> int:
    return estimated_tokens(_said(turn)) + estimated_tokens(_result(turn, known))


def _notebook(turns: Sequence[Step], known: Mapping[int, Step], limit_tokens: int) -> str:
    """Lines of the older turns, oldest first, the newest of them that fit."""
    if not turns:
        return ""
    kept: list[str] = []
    left = limit_tokens - estimated_tokens(_HEAD)
    for line in _lines(turns, known):
        left -= estimated_tokens(line + "\n")
        if left < 0:
            break
        kept.append(line)
    dropped = len(turns) - len(kept)
    head = _HEAD + (f" ({dropped} older ones left out)" if dropped else "")
    return "\n".join([head + ":", *reversed(kept)])


_HEAD = "Your notebook of earlier turns, oldest first, with the diagnosis that you wrote before you knew the outcome"


def _lines(turns: Sequence[Step], known: Mapping[int, Step]) -> Iterator[str]:
    for turn in reversed(turns):
        yield f"- {_result(turn, known)} Diagnosis: {paragraph(turn.diagnosis) or '(none)'}"
