"""The table `commands.toml`: every command, what it takes and what runs it, told to argparse."""

import tomllib
from argparse import Namespace
from functools import partial
from importlib import import_module
from importlib.resources import files
from typing import Any

from ibrid.commands import inputs

_TABLES: dict[str, dict[str, Any]] = tomllib.loads(
    (files("ibrid.commands") / "commands.toml").read_text(encoding="utf-8")
)
_WORDS, _SHARED = _TABLES.pop("words"), _TABLES.pop("shared")


def declare_commands(commands: Any) -> None:
    """Add every command to the parser; the file that runs it is imported when it is called."""
    for name, table in _TABLES.items():
        takes = dict(table)
        parser = commands.add_parser(name, help=takes.pop("help"))
        parser.set_defaults(run=partial(_called, takes.pop("run")))
        for argument, told in takes.items():
            for option, own in (_called(told["those"]) if "those" in told else {argument: told}).items():
                keywords = dict(own or _SHARED[option])
                if isinstance(kind := keywords.get("type"), str):
                    keywords["type"] = getattr(inputs, kind)
                keywords["help"] = keywords["help"].format(**_WORDS)
                parser.add_argument(option, **keywords)


def _called(place: str, *arguments: Namespace) -> Any:
    """What a function of this folder answers."""
    file, _, function = place.partition(".")
    return getattr(import_module(f"ibrid.commands.{file}"), function)(*arguments)
