"""Names and texts of others within generated source: of each language the characters that mean nothing in it anywhere.

A measurement file, a record or a kind of one's own may carry any name. Letters, digits and the marks of a language's list
pass, whether they end up in a comment, a string or an attribute; every other character becomes "_".
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from ibrid.analysis.linear_model import LinearModel

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
        return "".join(one if one.isalnum() or one in self.marks else "_" for one in words[:LONGEST])

    def model(self, model: LinearModel) -> LinearModel:
        """A model whose every name and text may stand in the source."""
        return replace(model, **{one.name: self._worded(getattr(model, one.name)) for one in fields(model)})

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
#: The library escapes what is markup; what is not text is no XML.
XML = Language(_PLAIN + '*/?@%${}<>&"\\`')


def written_in(
    language: Language,
) -> Callable[[Callable[Concatenate[LinearModel, P], T]], Callable[Concatenate[LinearModel, P], T]]:
    """For a function that writes source from a model: the model that it sees holds no other name than may stand there."""

    def decorate(write: Callable[Concatenate[LinearModel, P], T]) -> Callable[Concatenate[LinearModel, P], T]:
        @wraps(write)
        def written(model: LinearModel, *args: P.args, **options: P.kwargs) -> T:
            return write(language.model(model), *args, **options)

        return written

    return decorate
