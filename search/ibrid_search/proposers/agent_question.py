"""With what an agent's turn begins: the rules, its memory, and what every proposer is told about the parent."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ibrid.errors import IbridError
from ibrid_search.context import prompt
from ibrid_search.proposal import Context
from ibrid_search.proposers.agent_memory import remembered
from ibrid_search.proposers.agent_view import View
from ibrid_search.proposers.chat import Message, estimated_tokens
from ibrid_search.tool import Tool, listed
from ibrid_search.tools import Tools

SUBMIT = Tool(
    "submit_edit",
    "Ends the turn: the edit of the parent program is evaluated, and its outcome begins the next turn.",
    {
        "edit": {"type": "string", "maxLength": 100_000, "description": "SEARCH/REPLACE blocks for the parent program"},
        "change": {"type": "string", "maxLength": 2_000, "description": "what changes and why, in a line"},
        "diagnosis": {
            "type": "string",
            "maxLength": 20_000,
            "description": "one paragraph: what the record shows, what is missing or wrong, what the edit changes and what "
            "you expect of it",
        },
    },
    dict,
    ("edit", "diagnosis"),
)

RULES = """
# Turns
You work in turns. A turn begins with the outcome of your last edit. In it you may use tools, at most {calls} calls:
{tools}
End the turn with submit_edit(edit, diagnosis): SEARCH/REPLACE blocks for the parent program, and one paragraph that says
what the record shows, which layer is missing or wrong, what the edit changes and what you expect of it. The paragraphs are
kept and shown to you later: they are your notebook. The edit is then evaluated, and its outcome begins the next turn.
Where you cannot call tools, write one call as a JSON object {{"tool": NAME, "arguments": {{...}}}} in a code fence and wait
for the answer; end the turn with the blocks as text and a paragraph that begins with "Diagnosis:".
"""


@dataclass(frozen=True)
class AgentSettings:
    """`tokens` : of all that the model is shown, as estimated. `memory`, `context` : shares of them for earlier turns and
    for the parent with its surroundings; the rest is for what happens in the turn. `answers` : of the model in a turn.
    `calls` : of tools in a turn. `longest` : characters of a tool's answer."""

    tokens: int = 24_000
    memory: float = 0.25
    context: float = 0.5
    answers: int = 12
    calls: int = 12
    longest: int = 5_000

    def __post_init__(self) -> None:
        if min(self.tokens, self.answers, self.longest) < 1 or self.calls < 0:
            raise IbridError(
                "an agent needs at least 1 token, 1 answer, 1 character and 0 calls; leave them out for the defaults"
            )
        if not (self.memory >= 0 and self.context > 0 and self.memory + self.context < 1):
            raise IbridError(
                f"memory and context must be shares that leave room for the turn, found {self.memory} and {self.context}"
            )


def question(context: Context, view: View, settings: AgentSettings, *, author: str) -> list[dict[str, Any]]:
    """Messages with alternating roles: system, then earlier turns, the last with what is asked now."""
    rules = RULES.format(calls=settings.calls, tools=listed(Tools(context.study, view).reading))
    room = int(settings.tokens * settings.context) - estimated_tokens(rules)
    system, *asked = prompt(context, limit_tokens=room)
    memory = remembered(view.steps, int(settings.tokens * settings.memory), author=author)
    return _merged([{"role": "system", "content": f"{system['content']}\n{rules}"}, *memory, *asked])


def _merged(messages: Sequence[Message]) -> list[dict[str, Any]]:
    """Neighbours of one role become one message; some models take strict turns only."""
    merged: list[dict[str, Any]] = []
    for one in messages:
        if merged and merged[-1]["role"] == one["role"]:
            merged[-1]["content"] += f"\n\n{one['content']}"
        else:
            merged.append(dict(one))
    return merged
