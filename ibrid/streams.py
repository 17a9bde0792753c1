"""Standard output and the error stream of a command: foreign text is shown escaped, and a full disk
ends no work.

Characters that the encoding of a stream lacks are written as escapes too, so that nothing is lost
where only ASCII is shown.
"""

import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from ibrid.foreign_text import cut, cut_words, show_controls
from ibrid.interrupts import was_interrupted

#: Characters of a sentence that are shown.
LONGEST_SENTENCE = 4000
#: Reasons against one program that are told.
MOST_REASONS = 50


class Bordered:
    """A stream that shows what it is given and obeys nothing in it. `bare` : the stream; `failed` :
    why it took no more.

    What compiled code says of an interrupt that reached it is dropped: the command says itself that
    it stopped.
    """

    def __init__(self, bare: TextIO) -> None:
        self.bare = bare
        self.failed: OSError | None = None

    def write(self, text: str) -> int:
        """Write, or keep why not."""
        if was_interrupted():
            return len(text)
        encoding = self.bare.encoding or "utf-8"
        shown = show_controls(text).encode(encoding, "backslashreplace").decode(encoding)
        self._attempt(lambda: self.bare.write(shown))
        return len(text)

    def flush(self) -> None:
        """Hand on what is buffered, or keep why not."""
        self._attempt(self.bare.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.bare, name)

    def _attempt(self, write: Any) -> None:
        try:
            write()
        except BrokenPipeError:
            raise  # nobody reads on
        except OSError as error:
            self.failed = error


def complain(sentence: str) -> None:
    """One line on the error stream; words and sentences of foreign lengths are cut."""
    if sys.stderr is not None:  # closed by the caller
        print(
            f"ibrid: {cut(' '.join(cut_words(sentence).split()), LONGEST_SENTENCE)}",
            file=sys.stderr,
        )


def complain_of_program(source: str, reasons: Iterable[str]) -> None:
    """What is wrong with a program, a line each; of very many the first."""
    for reason in (told := list(reasons))[:MOST_REASONS]:
        complain(f"{source}{', ' if reason.startswith('line ') else ': '}{reason}")
    if len(told) > MOST_REASONS:
        complain(f"{source}: {len(told) - MOST_REASONS} violations more")


@contextmanager
def worded_warnings() -> Iterator[None]:
    """Within, what Python code warns of is a sentence on the error stream; what NumPy says of its
    own numbers is for IBRID_DEBUG=1: whatever matters of it is said by who computes.
    """

    def say(message: Warning | str, category: type[Warning], *_: object) -> None:
        if os.environ.get("IBRID_DEBUG") == "1" or not issubclass(
            category, RuntimeWarning | DeprecationWarning
        ):
            complain(str(message))

    with warnings.catch_warnings():
        warnings.showwarning = say
        yield


@contextmanager
def bordered_streams() -> Iterator[None]:
    """Within, what is printed passes the border; a stream that the caller closed stays so."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = map(_bordered, before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def bare(stream: TextIO | None) -> TextIO | None:
    """The stream itself, for whoever draws with sequences of his own and escapes the text in
    them.
    """
    return getattr(stream, "bare", stream)


def why_output_failed() -> str | None:
    """Why standard output took no more of what was printed; None where it took all."""
    failed = getattr(sys.stdout, "failed", None)
    return None if failed is None else failed.strerror or str(failed)


def _bordered(stream: Any) -> Any:
    return stream if stream is None or isinstance(stream, Bordered) else Bordered(stream)
