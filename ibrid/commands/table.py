"""The table `commands.toml`: every command and what it takes, told to argparse."""

import tomllib
from collections.abc import Callable, Mapping
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from ibrid.commands import inputs

_TABLES: dict[str, dict[str, Any]] = tomllib.loads(
    (files("ibrid.commands") / "commands.toml").read_text(encoding="utf-8")
)
_NOTHING: Mapping[str, Any] = MappingProxyType({})


def declare_command(
    commands: Any, name: str, run: Callable[..., int], instead: Mapping[str, Mapping[str, Any]] = _NOTHING
) -> None:
    """Add a command of the table to the parser. instead : arguments in the place of one in the table."""
    takes = dict(_TABLES[name])
    parser = commands.add_parser(name, help=takes.pop("help"))
    for argument, told in takes.items():
        for one, own in instead.get(argument, {argument: told}).items():
            keywords = dict(own or _TABLES["shared"][one])
            if isinstance(kind := keywords.get("type"), str):
                keywords["type"] = getattr(inputs, kind)
            keywords["help"] = keywords["help"].format(**_TABLES["words"])
            parser.add_argument(one, **keywords)
    parser.set_defaults(run=run)
