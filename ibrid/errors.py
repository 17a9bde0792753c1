"""What goes wrong, as sentences: every error names what must hold, what was found and the next
step.
"""

import re
from collections.abc import Iterable
from contextvars import ContextVar
from difflib import get_close_matches

from ibrid.foreign_text import cut_words, show_controls


class IbridError(Exception):
    """A wrong input.

    The message is one sentence for the user; the command line prints it and exits with status 2.
    """

    def __str__(self) -> str:
        return cut_words(show_controls(super().__str__()))


class ProgramError(IbridError):
    """Program text that cannot be read."""


class DiagramError(IbridError):
    """A diagram that the grammar refuses, or a use of it that has no meaning."""


class ModuleError(IbridError):
    """A module kind whose declaration contradicts itself."""


class SweepError(IbridError):
    """Measured data that cannot be read or used."""


class ImpossibleValueError(SweepError):
    """Data that were read and that no device can have: a base or a unit was meant otherwise."""


class OperatingPointError(IbridError):
    """An operating point that does not exist or was not given."""


class UnforeseenError(IbridError):
    """Arguments that a public function cannot take, as showed in its midst: `__cause__` says where.

    The command line exits with status 1.
    """


class UnfinishedError(IbridError):
    """A limit ended the work before it was finished; what was found is kept.

    The command line exits with status 3.
    """


#: Whether a command is at work, whose options errors name; else functions are called.
AT_THE_PROMPT: ContextVar[bool] = ContextVar("at the prompt", default=False)
#: A command from `ibrid import` to `;`, which stays as it is, or an option that functions have too,
#: with its value if one follows.
_OPTION = re.compile(
    r"\bibrid [a-z]+ [^;]*"
    r"|(?<![^\s(])--(map|channels|ratio|from|to|unit|base|current|q-axis|voltage-axis|frame-deg"
    r"|power-node|f0-hz|decimal|polar|quantity|sequence-frequency|op|[pqv]|parameters|equilibrium"
    r"|labels|holdout-op|network|port)\b"
    r"(?: (?!(?:and|are|beside|is|if|must|multiplies|needs|of|or|says)\b)"
    r"""("[^"]*"|'[^']*'|[^\s"']+))?"""
)
#: A value without the punctuation of the sentence behind it; `..` and a mark alone belong to it.
_WITHOUT_MARKS = re.compile(r"^(.+?(?:\.\.)?)[.,;:)]*$")
#: Options that a call names otherwise, and those whose placeholder is no text.
_KEYS, _NUMBERS = {"from": "begin", "to": "end", "port": "network"}, ("p", "q", "v")
#: What a replaced option begins with until all are, so that neighbours are joined.
_ARGUMENT = "\0"
_SAID_TWICE = re.compile(rf'{_ARGUMENT}(\w+)=("[^"]*") {_ARGUMENT}\1=("[^"]*")')
_NEIGHBOURS = re.compile(rf'({_ARGUMENT}\w+=(?:"[^"]*"|[^\s"]*\w)) (?={_ARGUMENT})')
_NUMBER = re.compile(r"-?[\d.]+")


def in_python(sentence: str) -> str:
    """A sentence with options of the command line as the arguments of a call: `--unit pu --p P` is
    unit="pu", p=P; an option said twice is a list.
    """

    def argument(said: re.Match[str]) -> str:
        if said[1] is None:
            return said[0]
        key = said[1].replace("-", "_")
        key = _KEYS.get(key, key)
        if said[2] is None:
            return key
        value = _WITHOUT_MARKS.sub(r"\1", said[2])
        is_plain = key in _NUMBERS or _NUMBER.fullmatch(value)
        shown = value if is_plain else '"' + value.strip("\"'") + '"'
        return f"{_ARGUMENT}{key}={shown}{said[2][len(value) :]}"

    text = _OPTION.sub(argument, sentence)
    # functions in place of templates, for which the library imports a module: readers of hostile
    # text, whose sentences these are, import nothing
    text = _SAID_TWICE.sub(lambda said: f"{said[1]}=[{said[2]}, {said[3]}]", text)
    text = _NEIGHBOURS.sub(lambda said: f"{said[1]}, ", text)
    return text.replace(_ARGUMENT, "")


def where_it_is_said(sentence: str) -> str:
    """A sentence that is kept with data, with options at the prompt and arguments in Python."""
    return sentence if AT_THE_PROMPT.get() else in_python(sentence)


def near(name: object, known: Iterable[str]) -> str:
    """A clause that names the known names close to `name`, or all of them when there are few."""
    names = sorted(set(known))
    close = get_close_matches(name, names, n=3, cutoff=0.5) if isinstance(name, str) else []
    if close:
        return f"did you mean {' or '.join(close)}?"
    if len(names) <= 12:
        return f"known are: {', '.join(names)}" if names else "there is none"
    return f"there are {len(names)}, for instance {', '.join(names[:5])}"


def some(names: Iterable[str], most: int = 4) -> str:
    """The first few names as a list."""
    listed = list(names)
    return ", ".join(listed[:most]) + (
        f" and {len(listed) - most} more" if len(listed) > most else ""
    )
