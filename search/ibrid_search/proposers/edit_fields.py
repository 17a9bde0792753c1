"""An edit as fields of JSON, for servers that hold an answer to a schema: one of the diagnosis by
its number, or what goes, what comes, and which program it is of.

Lines that go are named among those that are there, kinds among those that exist, so that little can
be written that is no edit.
"""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.program import program_text
from ibrid_search.blocks import split_lines
from ibrid_search.edits import edit_between
from ibrid_search.proposal import Evaluated
from ibrid_search.run.parsed import mapping_in

#: Lines that an answer may take out and put in, and characters of a text.
MOST, LONGEST = 24, 300
#: What such an edit consists of.
LISTS = ("remove", "add", "connect")
_END = {"type": "string", "pattern": r"^[A-Za-z_][A-Za-z0-9_]{0,40}(\.[A-Za-z0-9_]{1,40})?$"}
_NAME = {"type": "string", "pattern": r"^[A-Za-z_][A-Za-z0-9_]{0,40}$"}


def edit_schema(
    programs: Sequence[Evaluated], kinds: Vocabulary, ranked: int = 0, *, own: bool = True
) -> dict[str, Any]:
    """JSON schema of an edit of one of these programs. ranked : edits of the diagnosis that may be
    taken by number instead.
    own : False where there are such edits and no other is wanted.
    """
    statements = (
        line.strip() for one in programs for line in split_lines(program_text(one.diagram))
    )
    lines = list(dict.fromkeys(line for line in statements if line.startswith("g.")))
    added = _object(
        {"kind": {"type": "string", "enum": [kind.name for kind in kinds]}, "name": _NAME}
    )
    joined = _object({"source": _END, "target": _END})
    written = _object(
        {
            "step": {"type": "integer", "enum": [one.step for one in programs]},
            "remove": {
                "type": "array",
                "items": {"type": "string", "enum": lines},
                "maxItems": MOST,
            },
            "add": {"type": "array", "items": added, "maxItems": MOST},
            "connect": {"type": "array", "items": joined, "maxItems": MOST},
        }
    )
    taken = _object({"take": {"type": "integer", "enum": list(range(1, ranked + 1))}})
    edit = written if not ranked else {"anyOf": [taken, written]} if own else taken
    return _object({"change": {"type": "string", "maxLength": LONGEST}, "edit": edit})


def read_fields(text: str) -> Mapping[str, Any] | None:
    """The fields of the edit in an answer, and its `change`; None where it is no such JSON."""
    answer = mapping_in(
        text.strip().removeprefix("```json").removeprefix("```").removesuffix("```")
    )
    edit = answer.get("edit")
    if not isinstance(edit, dict) or not ("take" in edit or writes(edit)):
        return None
    return {**edit, "change": answer.get("change", "")}


def writes(fields: Mapping[str, Any]) -> bool:
    """Whether fields hold an edit of their own."""
    return all(isinstance(fields.get(name), list) for name in LISTS)


def blocks_of(fields: Mapping[str, Any], base: Evaluated) -> str:
    """SEARCH/REPLACE blocks that carry `LISTS` out on a program; modules come before connections.

    What is no name is written as it is, for the grammar to refuse it.
    """
    before = split_lines(program_text(base.diagram))
    gone = {one.strip() for one in fields["remove"][:MOST] if isinstance(one, str)}
    kept = [line for line in before if line.strip() not in gone]
    modules = [_call("add", one, ("kind", "name")) for one in fields["add"][:MOST]]
    wires = [_call("connect", one, ("source", "target")) for one in fields["connect"][:MOST]]
    place = (
        max((k for k, line in enumerate(kept) if line.strip().startswith("g.add(")), default=0) + 1
    )
    after = [*kept[:place], *modules, *kept[place:], *(wire for wire in wires if wire not in kept)]
    return edit_between("\n".join(before) + "\n", "\n".join(after) + "\n")


def _call(name: str, one: Any, arguments: tuple[str, str]) -> str:
    given = one if isinstance(one, Mapping) else {}
    words = (
        json.dumps(re.sub(r"[^\w.]", "_", str(given.get(argument, "")))[:100])
        for argument in arguments
    )
    return f"    g.{name}({', '.join(words)})"


def _object(properties: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": dict(properties),
        "required": [*properties],
        "additionalProperties": False,
    }
