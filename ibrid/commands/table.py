"""The table `commands.toml`: every command and what it takes, told to argparse."""

import tomllib
from argparse import ArgumentParser
from collections.abc import Callable, Mapping
from importlib.resources import files
from types import MappingProxyType
from typing import Any

_TABLES: dict[str, dict[str, Any]] = tomllib.loads(
    (files("ibrid.commands") / "commands.toml").read_text(encoding="utf-8")
)
#: What several commands say of their inputs.
WORDS: Mapping[str, str] = _TABLES["words"]
_NOTHING: Mapping[str, Any] = MappingProxyType({})


def declare_command(
    commands: Any, name: str, run: Callable[..., int], instead: Mapping[str, Mapping[str, Any]] = _NOTHING
) -> None:
    """Add a command of the table to the parser. instead : arguments in the place of one in the table."""
    takes = dict(_TABLES[name])
    parser = commands.add_parser(name, help=takes.pop("help"))
    for argument, told in takes.items():
        for one, keywords in instead.get(argument, {argument: told}).items():
            add_argument(parser, one, keywords)
    parser.set_defaults(run=run)


def add_argument(parser: ArgumentParser, argument: str, told: Mapping[str, Any] = _NOTHING) -> None:
    """Let a command take an argument, as told or as it is shared."""
    from ibrid.commands import inputs  # which takes words from here

    keywords = dict(told or _TABLES["shared"][argument])
    if isinstance(kind := keywords.get("type"), str):
        keywords["type"] = getattr(inputs, kind)
    keywords["help"] = keywords["help"].format(**WORDS)
    parser.add_argument(argument, **keywords)
