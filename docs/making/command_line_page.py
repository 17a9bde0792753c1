"""The page about the command line, from the parser itself."""

import argparse
import re
from collections.abc import Iterator
from textwrap import wrap

_TOP = """\
# Command line

Made from the program's own parser by `python docs/making/write_pages.py`; a test compares the two. In a terminal
`ibrid COMMAND --help` says the same.

**Exit status** 0: the answer was given, whatever it is (any verdict of `gap`, `check` of a legal program); 2: the input was
wrong, and one sentence on standard error says what must hold, what was found and what to try (also `check` of an illegal
program); 3: a limit ended it before it was finished, what was found is kept; 130: Ctrl-C ended it, what was found is kept;
1: anything else. `IBRID_DEBUG=1` shows the traceback of an unforeseen error. Ctrl-C stops long work cleanly at any moment, and a
search says how to resume.

**Files** are written whole or not at all, and no input is ever replaced. A file that you name is (`--json fit.json`). In a folder
(`--out DIR`) a command replaces files that it wrote itself and nobody changed since; `.ibrid-files`, a list there, tells which.
With `--overwrite` it replaces others too, and it never writes through a link to a file (the folder may be one). Earlier versions
left no such list: their searches and fleets go on with `--resume` as before, other answers are replaced with `--overwrite`, once.

**Effort.** `--effort low|normal|high` says how much work a command makes, counted in starts, steps and experiments: no clock
decides, so that one file and one seed have one answer on a busy machine and on a free one. What is written says the effort
and the work.

**Names in place of files.** PROGRAM is a file or the name of a textbook diagram; DATA is a sweep file or the name of a shipped
sweep. A file of that name goes first. `--freq A:B:N` is N logarithmically spaced frequencies in Hz, both ends included.
"""


def command_line_page(whole: argparse.ArgumentParser) -> str:
    """Markdown with a section for each command: its usage, and a table of what it takes."""
    commands = next(one for one in whole._actions if isinstance(one, argparse._SubParsersAction))
    words = {one.dest: one.help or "" for one in commands._choices_actions}
    rows = "".join(f"| [`ibrid {name}`](#ibrid-{name}) | {_cell(words[name])} |\n" for name in commands.choices)
    parts = [_TOP, f"| command | |\n| --- | --- |\n{rows}"]
    parts += ["\n".join(_section(name, words[name], one)) for name, one in commands.choices.items()]
    return "\n".join(parts)


def _section(name: str, words: str, command: argparse.ArgumentParser) -> Iterator[str]:
    yield f"## ibrid {name}\n"
    yield f"{words[:1].upper()}{words[1:]}.\n"
    taken = [one for one in command._actions if not isinstance(one, argparse._HelpAction)]
    yield f"```text\n{_usage(command)}\n```\n"
    if taken:
        yield "| | |\n| --- | --- |"
        yield from (f"| {_written(one)} | {_cell(one.help or '')} |" for one in taken)
        yield ""


def _usage(command: argparse.ArgumentParser) -> str:
    """The usage in lines of a hundred columns, no option torn from its value."""
    words = " ".join(command.format_usage().removeprefix("usage:").split()).replace("[-h] ", "")
    whole = re.sub(r"\[[^]]*(?:\[[^]]*\][^]]*)*\]", lambda found: found[0].replace(" ", "\0"), words)
    lines = wrap(whole, 100, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace("\0", " ")


def _written(one: argparse.Action) -> str:
    """How an argument is typed."""
    value = one.metavar if isinstance(one.metavar, str) else one.dest.upper()
    if not one.option_strings:
        return f"`{value}`"
    if one.nargs == 0:
        return f"`{one.option_strings[-1]}`"
    return f"`{one.option_strings[-1]} {f'[{value}]' if one.nargs == '?' else value}`".replace("|", r"\|")


def _cell(words: str) -> str:
    return " ".join(words.replace("%%", "%").split()).replace("|", r"\|").replace("*", r"\*")
