"""Where the progress of a search is shown: a line that is rewritten in a terminal, plain lines, a notebook, or nowhere.

A stream that is closed or whose reader has gone is silently left alone: a search does not end because nobody looks.
"""

import os
import sys
from html import escape
from typing import Any, Protocol, TextIO

#: Width where no terminal says how wide it is, and of the output of a notebook.
WIDTH, NOTEBOOK_WIDTH = 80, 100
WAYS = ("terminal", "plain", "notebook", "silent")


class Display(Protocol):
    """`pause` : least time between two states, in s. `width` : characters of a state at most, None for any. `columns` :
    characters of a row for which there is room. `kept` : whether the last state stays for whoever reads later."""

    pause: float
    kept: bool

    @property
    def width(self) -> int | None: ...
    @property
    def columns(self) -> int: ...
    def state(self, text: str, share: float | None = None) -> None:
        """Show how things stand, in place of what was shown before where that can be; `share` : of the work that is done."""
        ...

    def row(self, text: str) -> None:
        """Show a line that stays."""
        ...

    def close(self) -> None:
        """Leave the cursor on a new line."""
        ...


def choose_display(stream: TextIO | None, out: TextIO | None) -> str:
    """The way that suits: a notebook's kernel, a terminal, or plain lines; nothing when there is no stream at all."""
    if stream is None and out is None:
        return "silent"
    if _kernel():
        return "notebook"
    try:
        return "terminal" if stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb" else "plain"
    except ValueError:  # closed
        return "plain"


def make_display(way: str, stream: TextIO | None, out: TextIO | None, every: float) -> Display:
    """A display of one of `WAYS`; `every` : seconds between plain lines."""
    if way == "terminal":
        return TerminalDisplay(stream, out)
    if way == "plain":
        return PlainDisplay(stream, out, every)
    return NotebookDisplay() if way == "notebook" else SilentDisplay()


class SilentDisplay:
    """Shows nothing."""

    pause = float("inf")
    kept = False
    width = None
    columns = WIDTH

    def state(self, text: str, share: float | None = None) -> None:
        """Nothing."""

    def row(self, text: str) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class PlainDisplay:
    """States on `stream`, rows on `out`, each on a line of its own."""

    kept = False
    width = None

    def __init__(self, stream: TextIO | None, out: TextIO | None, every: float) -> None:
        self.pause, self._stream, self._out = every, stream, out

    @property
    def columns(self) -> int:
        """Those of the terminal that the rows go to."""
        return _columns(self._out)

    def state(self, text: str, share: float | None = None) -> None:
        _write(self._stream, f"{text}\n")

    def row(self, text: str) -> None:
        _write(self._out, f"{text}\n")

    def close(self) -> None:
        """Nothing is left to do."""


class TerminalDisplay:
    """The state is rewritten in place on `stream`; rows go to `out` and scroll by above it."""

    pause = 0.1
    kept = False

    def __init__(self, stream: TextIO | None, out: TextIO | None) -> None:
        self._stream, self._out, self._shown = stream, out, ""

    @property
    def width(self) -> int:
        """One less than the terminal has, since a full line would wrap."""
        return max(1, _columns(self._stream) - 1)

    @property
    def columns(self) -> int:
        """Those of the terminal that the rows go to."""
        return _columns(self._out)

    def state(self, text: str, share: float | None = None) -> None:
        text = text[: self.width]
        self._rewrite(text)
        self._shown = text

    def row(self, text: str) -> None:
        shown = self._shown
        self._rewrite("")
        _write(self._out, f"{text}\n")
        if shown:
            self.state(shown)

    def close(self) -> None:
        if self._shown:
            _write(self._stream, "\n")
        self._shown = ""

    def _rewrite(self, text: str) -> None:
        """Spaces wipe out what was longer; then the cursor stands behind the text."""
        rest = min(len(self._shown), self.width) - len(text)
        wiped = f"\r{text}{' ' * rest}\r{text}" if rest > 0 else f"\r{text}"
        _write(self._stream, wiped)
        self._shown = text


class NotebookDisplay:
    """One output of the cell that is updated: the rows, below them a bar and the state."""

    pause = 0.5
    kept = True
    width = NOTEBOOK_WIDTH
    columns = NOTEBOOK_WIDTH

    def __init__(self) -> None:
        self._rows: list[str] = []
        self._state = ""
        self._share: float | None = None
        self._handle: Any = None

    def state(self, text: str, share: float | None = None) -> None:
        self._state, self._share = text, share
        self._show()

    def row(self, text: str) -> None:
        self._rows.append(text)
        self._show()

    def close(self) -> None:
        """What is shown stays."""

    def _show(self) -> None:
        from IPython.display import display

        text = "\n".join([*self._rows, *([self._state] if self._state else [])])
        bar = "" if self._share is None else f'<progress value="{self._share:.4f}" style="width:60ch"></progress>'
        parts = ("\n".join(self._rows), bar, self._state)
        html = "".join(part if part is bar else f"<pre>{escape(part)}</pre>" for part in parts if part)
        bundle = {"text/plain": text, "text/html": html}
        if self._handle is None:
            self._handle = display(bundle, raw=True, display_id=True)
        else:
            self._handle.update(bundle, raw=True)


def _kernel() -> bool:
    """Whether this is the kernel of a notebook; IPython is not imported to find out."""
    interactive = getattr(sys.modules.get("IPython"), "get_ipython", None)
    shell = interactive() if interactive is not None else None
    return getattr(shell, "kernel", None) is not None


def _columns(stream: TextIO | None) -> int:
    """Characters in a line of a terminal; `WIDTH` for any other stream, and for one that does not say."""
    try:
        found = 0 if stream is None else os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError, AttributeError):  # no terminal, closed, or no file at all
        found = 0
    return found or WIDTH


def _write(stream: TextIO | None, text: str) -> None:
    if stream is None:
        return
    try:
        stream.write(text)
        stream.flush()
    except UnicodeEncodeError:
        _write(stream, text.encode("ascii", "replace").decode())
    except (OSError, ValueError):  # the reader has gone, or the stream is closed
        pass
