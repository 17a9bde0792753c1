"""Names and texts of others within generated source: of each language the characters that mean
nothing in it anywhere.

A measurement file, a record or a kind of one's own may carry any name. Letters, digits and the
marks of a language's list pass, whether they end up in a comment, a string or an attribute; every
other character becomes "_".
"""

import keyword
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from ibrid.analysis.models.linear_model import LinearModel
from ibrid.errors import IbridError

P = ParamSpec("P")
T = TypeVar("T")

#: Characters of a text that are written; compilers and readers have limits of their own.
LONGEST = 400


@dataclass(frozen=True)
class Language:
    """`marks` : what may pass beside letters and digits."""

    marks: str

    def text(self, words: str) -> str:
        """Words of others, as they may stand in the source."""
        return "".join(
            one if one.isalnum() or one in self.marks else "_" for one in words[:LONGEST]
        )

    def model(self, model: LinearModel) -> LinearModel:
        """A model whose every name and text may stand in the source."""
        return replace(
            model, **{one.name: self._worded(getattr(model, one.name)) for one in fields(model)}
        )

    def _worded(self, value: Any) -> Any:
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, tuple):
            return tuple(map(self._worded, value))
        if isinstance(value, Mapping):
            return {self.text(name): number for name, number in value.items()}
        return value


_PLAIN = " _-+=.,:;()[]|#~^!'"
#: Neither the ends of comments and strings, nor escapes, trigraphs, formats and continued lines.
C = Language(_PLAIN)
#: A string, also one that is read as HTML: neither quotes and escapes nor markup.
MODELICA = Language(_PLAIN + "*/?@%${}")
#: A text in three quotes, and names within strings.
PYTHON = Language(_PLAIN.replace("'", "") + "*/@%")
#: The library escapes what is markup; what is not text is no XML.
XML = Language(_PLAIN + '*/?@%${}<>&"\\`')


#: Words that mean something of their own in the languages that are written.
MODELICA_WORDS = frozenset(
    """
    algorithm and annotation block break class connect connector constant constrainedby der discrete each else elseif
    elsewhen encapsulated end enumeration equation expandable extends external false final flow for function if import
    impure in initial inner input loop model not operator or outer output package parameter partial protected public
    pure record redeclare replaceable return stream then true type when while within time
    Real Integer Boolean String StateSelect RealInput RealOutput
    """.split()  # noqa: SIM905
)
_C_WORDS = frozenset(
    """
    auto bool break case char const continue default do double else enum extern float for goto if inline int long main
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    abs acos asin atan calloc ceil cos div exp fabs floor fmax fmin fmod free index ldexp log main malloc memcpy memset pow
    printf rand remove rename round signal sin size_t sqrt strcmp strcpy strlen system tan time
    """.split()  # noqa: SIM905
)


def identifier(name: str) -> str:
    """A name for a class, a module and its functions, the same in C, Modelica, Python and files.

    Raises IbridError unless it is a letter and up to 31 letters, digits or underscores, and no word
    of these languages.
    """
    if re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,31}", name) is None:
        raise IbridError(
            "a name must be a letter and at most 31 letters of a-z, digits or underscores, found "
            f"{name[:60]!r}; for instance "
            "east_park"
        )
    if name in MODELICA_WORDS | _C_WORDS or keyword.iskeyword(name):
        raise IbridError(
            f"{name} means something in C, Modelica or Python; choose another name, for instance "
            f"{name}_1"
        )
    return name


def written_in(
    language: Language,
) -> Callable[[Callable[Concatenate[LinearModel, P], T]], Callable[Concatenate[LinearModel, P], T]]:
    """For a function that writes source from a model: the model that it sees holds no other name
    than may stand there.
    """

    def decorate(
        write: Callable[Concatenate[LinearModel, P], T],
    ) -> Callable[Concatenate[LinearModel, P], T]:
        @wraps(write)
        def written(model: LinearModel, *args: P.args, **options: P.kwargs) -> T:
            return write(language.model(model), *args, **options)

        return written

    return decorate
