"""The JSON that ibrid writes, as published schemas (2020-12) beside this file, and what in a
document of others breaks one.
"""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from ibrid.ranges import finite_number

_TYPES = {
    "number": "a finite number",
    "integer": "a whole number",
    "string": "text",
    "array": "a list",
    "object": "a table",
    "boolean": "true or false",
    "null": "null",
}
_SHOWN = 60


def schema(name: str) -> dict[str, Any]:
    """The schema of record, gap, compare or state-space."""
    return json.loads(files(__name__).joinpath(f"{name}-1.json").read_text(encoding="utf-8"))


def json_word(value: Any) -> str:
    """What a value read from JSON is, in words: "a list", "null"."""
    if isinstance(value, bool):
        return _TYPES["boolean"]
    words = {
        dict: "object",
        list: "array",
        str: "string",
        int: "number",
        float: "number",
        type(None): "null",
    }
    return _TYPES[words[type(value)]]


def breach(data: Any, name: str) -> str | None:
    """Where plain data first break the schema of that name, as the rest of a sentence that begins
    with what they are.

    Numbers are finite and whole ones written so; texts can be written as UTF-8. None: the data are
    whole.
    """
    error = first_error(_validator(name), data)
    if error is None:
        return None if writable(data) else "holds text that cannot be written as UTF-8"
    where = ", ".join(str(one)[:_SHOWN] for one in error.absolute_path)
    wanted, instance = error.validator_value, error.instance
    if error.validator == "required":
        lacking = [one for one in wanted if one not in instance]
        return f"{f'lacks, in {where}, ' if where else 'lacks '}{', '.join(lacking)}"
    if error.validator == "type":
        words = " or ".join(
            _TYPES[one] for one in ([wanted] if isinstance(wanted, str) else wanted)
        )
    elif error.validator in ("enum", "const"):
        words = " or ".join(map(repr, wanted)) if error.validator == "enum" else repr(wanted)
    else:
        words = f"as the schema says ({error.validator} {str(wanted)[:_SHOWN]})"
    shown = "null" if instance is None else repr(instance)[:_SHOWN]
    return f"has {where or 'content'} that must be {words}, found {shown}"


@cache
def _validator(name: str) -> Any:
    return validator(schema(name))


def validator(schema: Mapping[str, Any]) -> Any:
    """Of jsonschema, for which numbers are finite and whole ones written so."""
    from jsonschema import Draft202012Validator
    from jsonschema.validators import extend

    types = Draft202012Validator.TYPE_CHECKER.redefine_many(
        {
            "number": _is_number,
            "integer": lambda _, one: isinstance(one, int) and _is_number(_, one),
        }
    )
    return extend(Draft202012Validator, type_checker=types)(schema)


def first_error(checks: Any, data: Any) -> Any:
    """What jsonschema finds most telling of all that is wrong with data; None where nothing is."""
    from jsonschema.exceptions import best_match

    error = best_match(checks.iter_errors(data))
    while error is not None and error.context:
        error = max(error.context, key=lambda one: len(one.absolute_path))
    return error


def _is_number(_: Any, value: Any) -> bool:
    return finite_number(value) is not None


def writable(data: Any) -> bool:
    """Whether all text in plain data can be written as UTF-8: JSON can spell half a surrogate pair,
    which cannot.
    """
    try:
        json.dumps(data, ensure_ascii=False).encode()
    except (TypeError, ValueError, RecursionError):
        return False
    return True
