"""A tool as an agent sees it: declared once, so that a server and a proposer show and call the same thing."""

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.structure.diagram import Diagram
from ibrid_search.proposal import Evaluated
from ibrid_search.step import Step

#: Characters of JSON that an answer has at most; a program in it comes whole and has so many beside.
LONGEST_ANSWER, LONGEST_WHOLE = 4_000, 8_000
#: (items of a list, characters of a text) that are kept, tried in turn until an answer is short enough.
_CUTS = ((40, 3_000), (24, 2_000), (16, 1_000), (10, 600), (6, 400), (3, 200), (1, 100), (1, 30))
#: Where an answer says what is not in it.
LEFT_OUT = "left_out"

_TYPES: Mapping[str, tuple[type, ...]] = {
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "array": (list, tuple),
    "object": (Mapping,),
}

#: The argument that names a step.
STEP = {"type": "integer", "minimum": 0, "description": "number of an evaluated step"}


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
    """`description` : what it answers and when to use it, for a model. `arguments` : name -> JSON schema.
    `required` : those that must be given. `function` : called with them by name, answers with plain data."""

    name: str
    description: str
    arguments: Mapping[str, Mapping[str, Any]]
    function: Callable[..., Mapping[str, Any]]
    required: tuple[str, ...] = ()

    @property
    def schema(self) -> dict[str, Any]:
        """JSON schema of all arguments."""
        return {
            "type": "object",
            "properties": {name: dict(one) for name, one in self.arguments.items()},
            "required": list(self.required),
            "additionalProperties": False,
        }

    def call(self, arguments: Any, *, longest: int = LONGEST_ANSWER) -> dict[str, Any]:
        """The answer, at most `longest` characters as JSON; {"error": one sentence} for a wrong call, never an exception
        for what a caller can do wrong."""
        given = {} if arguments is None else arguments
        try:
            wrong = complaint(given, self.schema, f"the arguments of {self.name}")
            if wrong is not None:
                raise IbridError(wrong)
            return capped(self.function(**given), longest)
        except (IbridError, TimeoutError) as error:
            return failed(str(error))


def call_by_name(tools: Sequence[Tool], name: Any, arguments: Any, *, longest: int = LONGEST_ANSWER) -> dict[str, Any]:
    """Call the tool of that name; an unknown one is an answer with the near names."""
    for tool in tools:
        if tool.name == name:
            return tool.call(arguments, longest=longest)
    return failed(f"there is no tool {str(name)[:60]!r}; {near(str(name)[:60], (tool.name for tool in tools))}")


def failed(sentence: str) -> dict[str, Any]:
    """The answer to a call that cannot be answered."""
    return {"error": _text(" ".join(sentence.split())[:2_000])}


def complaint(value: Any, schema: Mapping[str, Any], what: str) -> str | None:
    """What is wrong with a value under a JSON schema (types, enum, bounds, lengths, properties); None when nothing is."""
    names = schema.get("type", tuple(_TYPES))
    wanted = (names,) if isinstance(names, str) else tuple(names)
    if not any(_is(value, name) for name in wanted):
        return f"{what} must be of type {' or '.join(wanted)}, found {_shown(value)}"
    if "enum" in schema and value not in schema["enum"]:
        return f"{what} must be one of {', '.join(map(str, schema['enum']))}, found {_shown(value)}"
    if isinstance(value, Mapping):
        return _complaint_of_object(value, schema, what)
    if isinstance(value, list | tuple):
        found = (complaint(one, schema.get("items", {}), f"entry {k} of {what}") for k, one in enumerate(value, 1))
        return next((one for one in found if one is not None), None)
    if isinstance(value, str):
        most = schema.get("maxLength", math.inf)
        return None if len(value) <= most else f"{what} must have at most {most} characters, found {len(value)}"
    return _complaint_of_number(value, schema, what)


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


def capped(answer: Mapping[str, Any], longest: int = LONGEST_ANSWER) -> dict[str, Any]:
    """The answer as plain data; long lists and texts are cut where it is longer than `longest`, and a field `left_out` says
    where and how much. A field `program` is kept whole, up to `LONGEST_WHOLE`: half a program is none."""
    whole = plain(answer)
    if _length(whole) <= longest:
        return whole
    program = whole.get("program")
    if isinstance(program, str) and _length(program) <= LONGEST_WHOLE:
        rest = {key: value for key, value in whole.items() if key != "program"}
        return capped(rest, longest - min(_length(program), longest // 2)) | {"program": program}
    for items, characters in _CUTS:
        left = dict(whole.get(LEFT_OUT, {})) if isinstance(whole.get(LEFT_OUT), dict) else {}
        shorter = {key: _cut(one, items, characters, key, left) for key, one in whole.items() if key != LEFT_OUT}
        if _length(shorter | {LEFT_OUT: left}) <= longest:
            return shorter | {LEFT_OUT: left}
    return failed(f"the answer has {_length(whole)} characters, more than {longest}; ask for less")


def _is(value: Any, name: str) -> bool:
    if isinstance(value, bool):
        return name == "boolean"
    return isinstance(value, _TYPES[name])


def _complaint_of_object(value: Mapping[str, Any], schema: Mapping[str, Any], what: str) -> str | None:
    known: Mapping[str, Any] = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            return f"{what} lack {name!r}"
    for name, one in value.items():
        if name not in known:
            return f"{what} have no {str(name)[:60]!r}; {near(str(name)[:60], known)}"
        if (found := complaint(one, known[name], f"{name!r}")) is not None:
            return found
    return None


def _complaint_of_number(value: Any, schema: Mapping[str, Any], what: str) -> str | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    low, high = schema.get("minimum", -math.inf), schema.get("maximum", math.inf)
    return None if low <= value <= high else f"{what} must lie within {low:g} and {high:g}, found {_shown(value)}"


def _shown(value: Any) -> str:
    text = repr(value if isinstance(value, str | int | float | bool | None) else type(value).__name__)
    return text if len(text) <= 60 else text[:57] + "..."


def _text(value: Any) -> str:
    """Text that UTF-8 can carry."""
    return str(value).encode("utf-8", "replace").decode("utf-8")


def _length(answer: Any) -> int:
    return len(json.dumps(answer, ensure_ascii=False))


def _cut(value: Any, items: int, characters: int, where: str, left: dict[str, str]) -> Any:
    """The beginning of what is long; `left` takes what is missing, by its place."""
    if isinstance(value, dict):
        return {key: _cut(one, items, characters, f"{where}.{key}", left) for key, one in value.items()}
    if isinstance(value, list):
        if len(value) > items:
            left[where] = f"{len(value) - items} of {len(value)}"
        return [_cut(one, items, characters, where, left) for one in value[:items]]
    if isinstance(value, str) and len(value) > characters:
        left[where] = f"{len(value) - characters} of {len(value)} characters"
        return value[:characters]
    return value


def listed(tools: Iterable[Tool]) -> str:
    """The tools as lines for a prompt: name, arguments, and the description up to its first stop."""
    return "\n".join(
        f"- {tool.name}({', '.join(name if name in tool.required else name + '?' for name in tool.arguments)}): "
        f"{re.split(r'[.:] ', tool.description)[0]}"
        for tool in tools
    )
