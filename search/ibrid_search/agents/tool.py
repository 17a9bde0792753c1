"""A tool as an agent sees it: declared once, so that a server and a proposer show and call the same
thing.
"""

import json
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.schemas import first_error, validator
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.writing import PlainData
from ibrid_search.language_models.language import words
from ibrid_search.proposal import Evaluated
from ibrid_search.step import Step

#: Characters of JSON that an answer has at most; a program in it comes whole and has so many
#: beside.
LONGEST_ANSWER, LONGEST_WHOLE = 4_000, 8_000
#: (items of a list, characters of a text) that are kept, tried in turn until an answer is short
#: enough.
_CUTS = ((40, 3_000), (24, 2_000), (16, 1_000), (10, 600), (6, 400), (3, 200), (1, 100), (1, 30))
#: Where an answer says what is not in it.
LEFT_OUT = "left_out"


class Steps(Protocol):
    """Where the tools find what was evaluated. `steps` : all, in their order, refused ones too."""

    @property
    def steps(self) -> Sequence[Step]: ...

    def record(self, number: int) -> Record:
        """The record of a fitted step; IbridError otherwise."""
        ...

    def best(self, count: int) -> Sequence[Evaluated]:
        """The best fitted steps, best first."""
        ...

    def met(self, diagram: Diagram) -> str | None:
        """Where a structure was met, such as "step 3"; None when it is new."""
        ...


@dataclass(frozen=True)
class Tool:
    """`description` : what it answers and when to use it, for a model. `arguments` : name -> JSON
    schema.
    `required` : those that must be given. `function` : called with them by name, answers with plain
    data.
    """

    name: str
    description: str
    arguments: Mapping[str, Mapping[str, Any]]
    function: Callable[..., Mapping[str, Any]]
    required: tuple[str, ...] = ()

    @property
    def schema(self) -> PlainData:
        """JSON schema of all arguments."""
        return {
            "type": "object",
            "properties": {name: dict(one) for name, one in self.arguments.items()},
            "required": list(self.required),
            "additionalProperties": False,
        }

    def call(self, arguments: Any, *, longest: int = LONGEST_ANSWER) -> PlainData:
        """The answer, at most `longest` characters as JSON; {"error": one sentence} for a wrong
        call, never an exception for what a caller can do wrong.
        """
        given = {} if arguments is None else arguments
        try:
            wrong = complaint(given, self.schema, f"the arguments of {self.name}")
            if wrong is not None:
                raise IbridError(wrong)
            return capped(self.function(**given), longest)
        except IbridError as error:
            return failed(str(error))


def tools_in(table: str, owner: object, **facts: Any) -> tuple[Tool, ...]:
    """The tools that a table of the folder `prompts` declares, each answered by the owner's method
    of its name.
    """
    declared = tomllib.loads(words(table, **facts))
    return tuple(
        Tool(
            name,
            one["description"],
            one.get("arguments", {}),
            getattr(owner, name),
            tuple(one.get("required", ())),
        )
        for name, one in declared.items()
    )


def call_by_name(
    tools: Sequence[Tool], name: Any, arguments: Any, *, longest: int = LONGEST_ANSWER
) -> PlainData:
    """Call the tool of that name; an unknown one is an answer with the near names."""
    for tool in tools:
        if tool.name == name:
            return tool.call(arguments, longest=longest)
    return failed(
        f"there is no tool {str(name)[:60]!r}; "
        f"{near(str(name)[:60], (tool.name for tool in tools))}"
    )


def failed(sentence: str) -> PlainData:
    """The answer to a call that cannot be answered."""
    return {"error": _text(" ".join(sentence.split())[:2_000])}


def complaint(value: Any, schema: Mapping[str, Any], what: str) -> str | None:
    """What is wrong with a value under a JSON schema (types, enum, bounds, lengths, properties);
    None when nothing is.
    """
    error = first_error(validator(schema), value)
    if error is None:
        return None
    path, where, instance, bounds = [*error.absolute_path], what, error.instance, error.schema
    if path:
        where = (
            f"entry {path[-1] + 1} of {path[-2]!r}" if isinstance(path[-1], int) else repr(path[-1])
        )
    if error.validator == "required":
        return f"{where} lack {next(name for name in bounds['required'] if name not in instance)!r}"
    if error.validator == "additionalProperties":
        name = next(name for name in instance if name not in bounds["properties"])
        return f"{where} have no {str(name)[:60]!r}; {near(str(name)[:60], bounds['properties'])}"
    return f"{where} must {_must(error.validator, bounds, instance)}"


def _must(broken: str, bounds: Mapping[str, Any], instance: Any) -> str:
    if broken == "type":
        names = bounds["type"]
        return (
            f"be of type {names if isinstance(names, str) else ' or '.join(names)}, found "
            f"{_shown(instance)}"
        )
    if broken == "enum":
        return f"be one of {', '.join(map(str, bounds['enum']))}, found {_shown(instance)}"
    if broken == "maxLength":
        return f"have at most {bounds['maxLength']} characters, found {len(instance)}"
    low, high = bounds.get("minimum", -math.inf), bounds.get("maximum", math.inf)
    return f"lie within {low:g} and {high:g}, found {_shown(instance)}"


def plain(value: Any) -> Any:
    """Data that JSON can carry: numbers with six digits, None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value if value is None else _text(value)


def capped(answer: Mapping[str, Any], longest: int = LONGEST_ANSWER) -> PlainData:
    """The answer as plain data; long lists and texts are cut where it is longer than `longest`, and
    a field `left_out` says where and how much. A field `program` is kept whole, up to
    `LONGEST_WHOLE`: half a program is none.
    """
    whole = plain(answer)
    if _length(whole) <= longest:
        return whole
    program = whole.get("program")
    if isinstance(program, str) and _length(program) <= LONGEST_WHOLE:
        rest = {key: value for key, value in whole.items() if key != "program"}
        return capped(rest, longest - min(_length(program), longest // 2)) | {"program": program}
    for items, characters in _CUTS:
        left = dict(whole.get(LEFT_OUT, {})) if isinstance(whole.get(LEFT_OUT), dict) else {}
        shorter = {
            key: _cut(one, items, characters, key, left)
            for key, one in whole.items()
            if key != LEFT_OUT
        }
        if _length(shorter | {LEFT_OUT: left}) <= longest:
            return shorter | {LEFT_OUT: left}
    return failed(f"the answer has {_length(whole)} characters, more than {longest}; ask for less")


def left_out(what: str, shown: int, total: int) -> PlainData:
    """What an answer says of rows or steps that it does not show; nothing where it shows all."""
    return {LEFT_OUT: {what: f"{total - shown} of {total}"}} if shown < total else {}


def _shown(value: Any) -> str:
    text = repr(
        value if isinstance(value, str | int | float | bool | None) else type(value).__name__
    )
    return text if len(text) <= 60 else text[:57] + "..."


def _text(value: Any) -> str:
    """Text that UTF-8 can carry."""
    return str(value).encode("utf-8", "replace").decode("utf-8")


def _length(answer: Any) -> int:
    return len(json.dumps(answer, ensure_ascii=False))


def _cut(value: Any, items: int, characters: int, where: str, left: dict[str, str]) -> Any:
    """The beginning of what is long; `left` takes what is missing, by its place."""
    if isinstance(value, dict):
        return {
            key: _cut(one, items, characters, f"{where}.{key}", left) for key, one in value.items()
        }
    if isinstance(value, list):
        if len(value) > items:
            left[where] = f"{len(value) - items} of {len(value)}"
        return [_cut(one, items, characters, where, left) for one in value[:items]]
    if isinstance(value, str) and len(value) > characters:
        left[where] = f"{len(value) - characters} of {len(value)} characters"
        return value[:characters]
    return value


def listed(tools: Iterable[Tool]) -> str:
    """The tools as lines for a prompt: name, arguments, and the description up to its first
    stop.
    """
    return "\n".join(
        f"- {tool.name}({', '.join(name if name in tool.required else name + '?' for name in tool.arguments)}): "
        f"{re.split(r'[.:] ', tool.description)[0]}"
        for tool in tools
    )
