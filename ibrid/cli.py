"""`ibrid ...`: parse, call one command, say what went wrong.

Exit status 0: the answer was given; 2: the input was wrong; 3: a limit ended it before it was
finished, what was found is kept; 130: an interrupt ended it, what was found is kept; 1: anything
else. With IBRID_DEBUG=1 an unforeseen error shows its traceback.
"""

import argparse
import os
import re
import sys
import tomllib
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from errno import ELOOP, ENAMETOOLONG
from functools import partial
from importlib.resources import files
from importlib.util import find_spec
from typing import Any, NoReturn

from ibrid import __version__
from ibrid.commands import inputs
from ibrid.commands.outputs import INTERRUPTED, UNFINISHED
from ibrid.errors import AT_THE_PROMPT, IbridError, UnfinishedError, UnforeseenError, near
from ibrid.interrupts import hearing_interrupts
from ibrid.lazy import MATPLOTLIB
from ibrid.own_files import writing_as
from ibrid.streams import bordered_streams, complain, why_output_failed, worded_warnings

WRONG_INPUT, ANYTHING_ELSE = 2, 1
#: Commands that were once told how many seconds they may take.
WERE_TIMED = ("evaluate", "gap", "mcp", "fleet")
#: What names a file or folder that a command writes, as argparse calls it.
OUTPUTS = ("out", "json", "report", "equivalent", "picture")
_NEGATIVE = re.compile(r"-\.?\d")

_EXAMPLES = """\
for a start:
  ibrid start paper_like                        a first answer: what is odd, which shipped diagram fits, what next
  ibrid modules                                 the blocks that diagrams are made of
  ibrid inspect paper_like                      a first look at the shipped benchmark
  ibrid evaluate gfl_pll_filter_exact paper_like --json out.json --report out.html
  ibrid gap gfl paper_like --out out/gap        which physical effect a model lacks
  ibrid search paper_like --out out/run         find the hidden controller from the data alone
  ibrid predict out.json --op p=0.8,q=0 --out predicted.csv
  ibrid stability out.json --scr 1.5:10         from which grid strength on it is stable
  ibrid export out.json --op p=1,q=0.3 --format control-json --out model.json

`ibrid COMMAND --help` tells the options of a command.
"""


class _CommandParser(argparse.ArgumentParser):
    """argparse whose complaints are one sentence."""

    def __init__(self, **options) -> None:
        super().__init__(**{"allow_abbrev": False, **options})
        self._topics: dict[str, list[argparse.Action]] = {}

    def add_to_topic(self, topic: str, action: argparse.Action) -> None:
        """Leave an option out of `--help`, and show it in `--help-TOPIC`."""
        if topic not in self._topics:
            self.add_argument(
                f"--help-{topic}",
                action=_TopicHelp,
                help=f"the options of {topic}",
            )
        self._topics.setdefault(topic, []).append(action)

    def format_help(self) -> str:
        """The help without the options of topics, which have a help of their own."""
        return self._help_without([one for those in self._topics.values() for one in those])

    def topic_help(self, topic: str) -> str:
        """The help of the options of a topic alone."""
        chosen = self._topics[topic]
        formatter = self._get_formatter()
        formatter.start_section(f"{self.prog}, options of {topic}")
        formatter.add_arguments(chosen)
        formatter.end_section()
        return formatter.format_help()

    def _help_without(self, hidden: Sequence[argparse.Action]) -> str:
        words = [action.help for action in hidden]
        for action in hidden:
            action.help = argparse.SUPPRESS
        try:
            return super().format_help()
        finally:
            for action, told in zip(hidden, words, strict=True):
                action.help = told

    def error(self, message: str) -> NoReturn:
        raise IbridError(f"{message}; see {self.prog} --help")


class _TopicHelp(argparse.Action):
    """Prints the options of a topic, and ends."""

    def __init__(self, option_strings: Sequence[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, **options)

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        print(parser.topic_help(str(option).removeprefix("--help-")), end="")
        parser.exit()


class _Completion(argparse.Action):
    """Prints what a shell completes commands, options and files by, and ends."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: str | None = None) -> None:
        import shtab

        for action in _actions_of(parser):
            if action.option_strings and action.metavar is None:
                continue
            if action.choices is None and action.nargs != 0:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, values))
        parser.exit()


def _actions_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """The arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions_of(command)


#: What an operating system says of names that no file can have.
NO_NAMES = (ENAMETOOLONG, ELOOP)


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    whole = _CommandParser(
        prog="ibrid",
        description="Opens black-box inverters: from measured 2x2 dq admittance to a named, fitted "
        "block diagram "
        "and a state-space model.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    whole.add_argument("--version", action="version", version=f"ibrid {__version__}")
    whole.add_argument(
        "--completion",
        choices=("bash", "zsh", "tcsh"),
        action=_Completion,
        help='print what completes ibrid in that shell: eval "$(ibrid --completion bash)"',
    )
    commands = whole.add_subparsers(metavar="COMMAND", parser_class=_CommandParser)
    _declare(commands)
    whole.set_defaults(run=None, names=tuple(commands.choices))
    return whole


def _declare(commands: Any) -> None:
    """Add every command of `commands.toml`, with what it takes; the file that runs it is imported
    when it is called.
    """
    tables = tomllib.loads((files("ibrid.commands") / "commands.toml").read_text(encoding="utf-8"))
    words, shared = tables.pop("words"), tables.pop("shared")
    for name, takes in tables.items():
        command = commands.add_parser(name, help=takes.pop("help"))
        command.set_defaults(run=partial(_called, takes.pop("run")))
        called: dict[str, str] = {}
        for argument, told in takes.items():
            if "needs" in told and find_spec(told["needs"]) is None:
                continue
            for option, own in (
                _called(told["those"]) if "those" in told else {argument: told}
            ).items():
                keywords = dict(shared[option] if set(own) <= {"group", "topic"} else own)
                if isinstance(kind := keywords.get("type"), str):
                    keywords["type"] = getattr(inputs, kind)
                keywords["help"] = keywords["help"].format(**words)
                keywords.pop("group", None)
                keywords.pop("topic", None)
                group, topic = told.get("group"), told.get("topic")
                names = (option, *keywords.pop("also", ()))
                action = _group(command, group).add_argument(*names, **keywords)
                if topic is not None:
                    command.add_to_topic(topic, action)
                called[action.dest] = (
                    option if option.startswith("-") else str(action.metavar or action.dest)
                )
        command.set_defaults(called=called)
        if "overwrite" not in called:
            command.set_defaults(overwrite=None)


def _group(command: Any, title: str | None) -> Any:
    """The group of options of that title, made when it is first asked for."""
    if title is None:
        return command
    known = [one for one in command._action_groups if one.title == title]
    return known[0] if known else command.add_argument_group(title)


def _called(place: str, *arguments: argparse.Namespace) -> Any:
    """What a function of commands answers."""
    from ibrid.plugins import command  # which looks through all that is installed

    return command(place)(*arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    token = AT_THE_PROMPT.set(True)
    try:
        with bordered_streams(), worded_warnings():
            return _status(words)
    finally:
        AT_THE_PROMPT.reset(token)


def _status(words: list[str]) -> int:
    try:
        with hearing_interrupts():
            status = _run(words)
            if sys.stdout is not None:  # closed by the caller, who wants no words
                sys.stdout.flush()
    except UnforeseenError as error:
        return _unforeseen(error.__cause__ if isinstance(error.__cause__, Exception) else error)
    except IbridError as error:
        complain(str(error))
        return UNFINISHED if isinstance(error, UnfinishedError) else WRONG_INPUT
    except KeyboardInterrupt as interrupt:
        return _stopped(interrupt)
    except BrokenPipeError:
        _drop_output()  # the reader left; the last flush must not complain
        return ANYTHING_ELSE
    except Exception as error:
        return _unforeseen(error)
    if (why := why_output_failed()) is not None:
        _drop_output()
        complain(
            f"standard output took not all of the answer ({why}); files are written, print to "
            "another place"
        )
        return ANYTHING_ELSE
    return status


def _stopped(interrupt: KeyboardInterrupt) -> int:
    complain(
        str(interrupt)
        or "stopped by the keyboard before the answer was there; run the same command again"
    )
    return INTERRUPTED


def _run(words: list[str]) -> int:
    whole = parser()
    names = whole.get_default("names")
    for word in words:
        if word.startswith("--") and word.endswith("=--"):  # of which argparse makes an empty list
            raise IbridError(
                f"{word.removesuffix('=--')[:80]}: a value must follow, found --; see --help"
            )
    if words and not words[0].startswith("-") and words[0] not in names:
        raise IbridError(f"there is no command {words[0][:80]!r}; {near(words[0][:80], names)}")
    try:
        arguments, unknown = whole.parse_known_args(_with_values(words))
    except SystemExit as finished:  # --help and --version
        return int(finished.code or 0)
    if set(words[:1]) & set(WERE_TIMED) and any(
        word.split("=")[0] == "--seconds" for word in unknown
    ):
        raise IbridError(
            "--seconds is gone, since what a clock decides differs from machine to machine; say "
            "--effort low, normal or high"
        )
    if unknown:
        command = f"ibrid {words[0]}" if words[0] in names else "ibrid"
        raise IbridError(f"unrecognized arguments: {' '.join(unknown)[:200]}; see {command} --help")
    if arguments.run is None:
        whole.print_help()
        return 0
    if _without_a_folder():
        raise IbridError(
            "the working folder does not exist any more; change to another one and call this again"
        )
    words_read = [
        (name, getattr(arguments, dest))
        for dest, name in arguments.called.items()
        if dest not in OUTPUTS
    ]
    named = [told for dest in OUTPUTS if isinstance(told := getattr(arguments, dest, None), str)]
    files_read, folders_read = inputs.files_named(words_read), inputs.folders_named(words_read)
    if os.path.exists(MATPLOTLIB):
        from ibrid.report.look.figure import load_drawing

        load_drawing()
    with writing_as(words[0], files_read, arguments.overwrite, named, folders_read, words):
        return arguments.run(arguments)


def _with_values(words: list[str]) -> list[str]:
    """Options and the values behind them that begin like a negative number as one word: `--scr
    -1:10` as `--scr=-1:10`.

    argparse takes such a value for an option that it does not know.
    """
    joined: list[str] = []
    for word in words:
        option = joined[-1] if joined else ""
        if (
            _NEGATIVE.match(word)
            and option.startswith("--")
            and len(option) > 2
            and "=" not in option
        ):
            joined[-1] = f"{option}={word}"
        else:
            joined.append(word)
    return joined


def _unforeseen(error: Exception) -> int:
    if isinstance(error, OSError) and error.errno in NO_NAMES:
        complain(
            f"{str(error.filename or 'a name')[:80]}: {error.strerror}; give the name of a file "
            "that can be"
        )
        return WRONG_INPUT
    if os.environ.get("IBRID_DEBUG") == "1":
        traceback.print_exc()
    what = str(error) or "no further word"
    complain(f"{type(error).__name__}: {what}; run again with IBRID_DEBUG=1 for the traceback")
    try:
        sys.stdout.flush()
    except (
        OSError,
        ValueError,
        AttributeError,
    ):  # full or closed: what is buffered is lost, also at exit
        _drop_output()
    return ANYTHING_ELSE


def _without_a_folder() -> bool:
    """Whether the working folder was deleted while the terminal stayed in it."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return True
    return False


def _drop_output() -> None:
    """Send what is still buffered for standard output nowhere; one that is closed already stays
    so.
    """
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
