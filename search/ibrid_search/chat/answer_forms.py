"""How a server is told that an answer must follow a schema, and what each server has refused.

schema   response_format with a JSON schema: OpenAI, vLLM, SGLang, llama.cpp, Ollama
tool     a tool whose arguments follow it, which must be called
gbnf     a grammar in the form of llama.cpp, in the field `grammar`
text     nothing: the answer is written freely
"""

import json
from collections.abc import Mapping
from typing import Any

#: Forms in the order in which a server is asked for them.
FORMS = ("schema", "tool", "gbnf", "text")
#: What a forced tool is called.
TOOL = "submit_edit"
#: (address, model) -> names of the request that it does not take, for as long as the process runs.
_REFUSED: dict[tuple[str, str], set[str]] = {}


def refused(url: str, model: str) -> set[str]:
    """Forms and parameters that a server has refused; add to it what it refuses."""
    return _REFUSED.setdefault((url, model), set())


def form_of(wanted: str, url: str, model: str) -> str:
    """The form to ask for: the wanted one, or, for "auto", the first that the server has not
    refused.
    """
    known = refused(url, model)
    return next(one for one in FORMS if one not in known) if wanted == "auto" else wanted


def fields_of(form: str, schema: Mapping[str, Any]) -> dict[str, Any]:
    """What a request has beside its messages."""
    if form == "schema":
        wanted = {"name": TOOL, "schema": dict(schema), "strict": True}
        return {"response_format": {"type": "json_schema", "json_schema": wanted}}
    if form == "tool":
        function = {"name": TOOL, "description": "hand in the edit", "parameters": dict(schema)}
        return {
            "tools": [{"type": "function", "function": function}],
            "tool_choice": {"type": "function", "function": {"name": TOOL}},
        }
    return {"grammar": gbnf(schema)} if form == "gbnf" else {}


def gbnf(schema: Mapping[str, Any]) -> str:
    """A grammar of llama.cpp for the JSON of a schema of objects with all their properties in
    order, lists, choices and texts.
    """
    rules = {
        "char": r'[^"\\\x7F\x00-\x1F] | "\\" ["\\/bfnrt]',
        "word": "[A-Za-z_] [A-Za-z0-9_]{0,40}",
        "port": 'word ("." [A-Za-z0-9_]{1,40})?',
    }
    rules["root"] = _rule(schema, "root", rules)
    return (
        "\n".join(
            f"{name} ::= {text}"
            for name, text in sorted(rules.items(), key=lambda one: one[0] != "root")
        )
        + "\n"
    )


def _rule(schema: Mapping[str, Any], name: str, rules: dict[str, str]) -> str:
    if "enum" in schema:
        return " | ".join(json.dumps(json.dumps(one)) for one in schema["enum"])
    if "anyOf" in schema:
        return " | ".join(_rule(one, name, rules) for one in schema["anyOf"])
    if schema["type"] == "object":
        parts = []
        for key, one in schema["properties"].items():
            rules[f"{name}-{key}"] = _rule(one, f"{name}-{key}", rules)
            parts.append(f"{json.dumps(json.dumps(key) + ':')} {name}-{key}")
        return f'"{{" {json.dumps(",").join(f" {part} " for part in parts)} "}}"'
    if schema["type"] == "array":
        rules[f"{name}-item"] = _rule(schema["items"], f"{name}-item", rules)
        return f'"[" ({name}-item ("," {name}-item){{0,{schema.get("maxItems", 100) - 1}}})? "]"'
    if "pattern" in schema:
        return r'"\"" port "\""' if r"\." in schema["pattern"] else r'"\"" word "\""'
    return rf'"\"" char{{0,{schema.get("maxLength", 300)}}} "\""'
