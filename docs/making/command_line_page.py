"""The page about the command line, from the parser itself; an option of several commands is
explained once.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator

_TOP = """\
# Command line

Made from the parser by `python docs/making/write_pages.py`; a test compares the two.
`ibrid COMMAND --help` prints the same in a terminal.

**Exit status** 0: an answer was given, whatever it is (any verdict of `gap`, `check` of a legal
program); 2: wrong input, with one sentence on standard error that says what must hold, what was
found and what to try (also `check` of an illegal program); 3: a limit ended it early, results so
far are kept; 130: Ctrl-C, also of `watch`, results so far are kept; 1: anything else.
`IBRID_DEBUG=1` shows the traceback of an unexpected error. Ctrl-C stops long work cleanly at any
moment, and a search prints how to resume.

**Files** are written completely or not at all, and no input is ever replaced. A named output file
(`--json fit.json`) is overwritten. In a folder (`--out DIR`) a command replaces files that it wrote
itself and that were not changed since (listed in `.ibrid-files`); with `--overwrite` others too. It
never writes through a link to a file (the folder may be a link). Folders of versions without that
list continue with `--resume` if they hold a search or fleet; other answers need `--overwrite` once.

**Effort.** `--effort low|normal|high` sets the amount of work, counted in starts, steps and
experiments: no clock decides, so a file and a seed give the same answer on a busy and on a free
machine. Results state the effort and the work.

**Names instead of files.** PROGRAM is a file or the name of a reference diagram; DATA is a sweep
file or the name of a built-in sweep. A file of that name takes precedence. `--freq A:B:N` is N
logarithmically spaced frequencies in Hz, both ends included.
"""
#: An option with the same words in this many commands is common.
_COMMON = 3


def command_line_page(whole: argparse.ArgumentParser) -> str:
    """Return Markdown: an overview, the common options, and a section for each command."""
    commands = next(
        action for action in whole._actions if isinstance(action, argparse._SubParsersAction)
    )
    summaries = {action.dest: action.help or "" for action in commands._choices_actions}
    common = _common_arguments(commands.choices.values())
    rows = "".join(
        f"| [`ibrid {name}`](#ibrid-{name}) | {_cell(summaries[name])} |\n"
        for name in commands.choices
    )
    parts = [
        _TOP,
        f"| command | |\n| --- | --- |\n{rows}",
        f"## Common options\n\n{_table(common.values())}",
    ]
    for name, command in commands.choices.items():
        parts.append("\n".join(_section(name, summaries[name], command, common)))
    return "\n".join(parts)


def _common_arguments(
    commands: Iterable[argparse.ArgumentParser],
) -> dict[tuple[str, str], argparse.Action]:
    """Return the arguments that several commands explain alike, by how they are written and
    explained.
    """
    arguments = [action for command in commands for action in _arguments(command)]
    counts = Counter(_meaning(action) for action in arguments)
    common = {
        _meaning(action): action for action in arguments if counts[_meaning(action)] >= _COMMON
    }
    names = Counter(written for written, _ in common)
    return {meaning: action for meaning, action in common.items() if names[meaning[0]] == 1}


def _arguments(command: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in command._actions if not isinstance(action, argparse._HelpAction)]


def _meaning(action: argparse.Action) -> tuple[str, str]:
    return _written(action), _cell(action.help or "")


def _section(
    name: str,
    summary: str,
    command: argparse.ArgumentParser,
    common: dict[tuple[str, str], argparse.Action],
) -> Iterator[str]:
    yield f"## ibrid {name}\n"
    yield f"{summary[:1].upper()}{summary[1:]}.\n"
    arguments = _arguments(command)
    yield f"```text\n{_usage(command, arguments)}\n```\n"
    own = [action for action in arguments if _meaning(action) not in common]
    shared = [_written(action) for action in arguments if _meaning(action) in common]
    if own:
        yield _table(own)
    if shared:
        yield f"Common: {', '.join(shared)}.\n"


def _usage(command: argparse.ArgumentParser, arguments: list[argparse.Action]) -> str:
    """Return the command with its required options and positional arguments."""
    required = [
        f"{action.option_strings[-1]} {_value(action)}"
        for action in arguments
        if _is_required(action)
    ]
    optional = any(action.option_strings and not action.required for action in arguments)
    positional = [_positional(action) for action in arguments if not action.option_strings]
    return " ".join([command.prog, *positional, *required, *(["[options]"] if optional else [])])


def _is_required(action: argparse.Action) -> bool:
    return bool(action.option_strings) and action.required


def _positional(action: argparse.Action) -> str:
    value = _value(action)
    repeated = {"?": f"[{value}]", "+": f"{value} [{value} ...]", "*": f"[{value} ...]"}
    return repeated.get(str(action.nargs), value)


def _table(arguments: Iterable[argparse.Action]) -> str:
    rows = "".join(f"| {_written(action)} | {_cell(action.help or '')} |\n" for action in arguments)
    return f"| | |\n| --- | --- |\n{rows}"


def _value(action: argparse.Action) -> str:
    return action.metavar if isinstance(action.metavar, str) else action.dest.upper()


def _written(action: argparse.Action) -> str:
    """Return how an argument is typed, in Markdown."""
    value = _value(action)
    if not action.option_strings:
        return f"`{value}`"
    if action.nargs == 0:
        return f"`{action.option_strings[-1]}`"
    return (
        f"`{action.option_strings[-1]} {f'[{value}]' if action.nargs == '?' else value}`".replace(
            "|", r"\|"
        )
    )


def _cell(words: str) -> str:
    return " ".join(words.replace("%%", "%").split()).replace("|", r"\|").replace("*", r"\*")
