"""Where the progress of some work is shown: lines that are rewritten in a terminal, plain lines, a
notebook, or nowhere.

A stream that is closed or whose reader has gone is silently left alone: work does not end because
nobody looks.
"""

import os
import sys
from html import escape
from typing import Any, TextIO

from ibrid.errors import IbridError
from ibrid.foreign_text import show_controls
from ibrid.streams import bare

#: Width where no terminal says how wide it is, of the output of a notebook, and of a bar at most.
WIDTH, NOTEBOOK_WIDTH, BAR = 80, 100, 60
WAYS = ("terminal", "plain", "notebook", "silent")


class Display:
    """Shows nothing. `pause` : least time between two states, in s. `width` : characters of a state
    at most, None for any.
    `columns` : characters of a row for which there is room. `kept` : whether the last state stays
    for whoever reads later.
    """

    pause = float("inf")
    kept = False
    width: int | None = None
    columns = WIDTH

    def state(self, text: str, share: float | None = None) -> None:
        """Show how things stand, in place of what was shown before where that can be; `share` : of
        the work that is done.
        """

    def row(self, text: str) -> None:
        """Show a line that stays."""

    def close(self) -> None:
        """Leave the cursor on a new line."""


def make_display(show: str, stream: TextIO | None, out: TextIO | None, every: float) -> Display:
    """A display of one of `WAYS`, or "auto" for what suits: a notebook's kernel, a terminal, plain
    lines, or nothing at all; "interactive" is the same without plain lines.

    stream, out : for states and for rows. every : seconds between plain lines. Raises IbridError
    for any other word.
    """
    if show not in ("auto", "interactive", *WAYS):
        raise IbridError(f"progress must be shown as auto, {', '.join(WAYS)}, found {show!r}")
    way = _suitable(stream, out) if show in ("auto", "interactive") else show
    stream, out = bare(stream), bare(out)
    way = "silent" if show == "interactive" and way == "plain" else way
    if way == "terminal":
        return TerminalDisplay(stream, out)
    if way == "plain":
        return PlainDisplay(stream, out, every)
    return NotebookDisplay() if way == "notebook" else Display()


class PlainDisplay(Display):
    """States on `stream`, rows on `out`, each on a line of its own."""

    def __init__(self, stream: TextIO | None, out: TextIO | None, every: float) -> None:
        self.pause, self._stream, self._out = every, Quiet(stream), Quiet(out)

    @property
    def columns(self) -> int:
        """Those of the terminal that the rows go to."""
        return self._out.columns

    def state(self, text: str, share: float | None = None) -> None:
        self._stream.write(f"{show_controls(text)}\n")

    def row(self, text: str) -> None:
        self._out.write(f"{show_controls(text)}\n")


class TerminalDisplay(PlainDisplay):
    """The state and a bar are rewritten in place on `stream`; rows scroll by above them, or go to a
    file that `out` is.
    """

    def __init__(self, stream: TextIO | None, out: TextIO | None) -> None:
        from rich.console import Console  # as for the bar: only who looks at a terminal needs it
        from rich.live import Live

        super().__init__(stream, out, every=0.1)
        self._console = Console(
            file=self._stream,  # type: ignore[arg-type]
            force_terminal=True,
            highlight=False,
            markup=False,
            emoji=False,
        )
        self._live = Live(
            console=self._console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False
        )
        self._text = ""

    @property
    def width(self) -> int:
        """One less than the terminal has, since a full line would wrap."""
        return max(1, self._stream.columns - 1)

    def state(self, text: str, share: float | None = None) -> None:
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.text import Text

        self._console.width = self._stream.columns  # a window may change
        self._text = show_controls(text)[: self.width]
        bar = (
            []
            if share is None
            else [
                ProgressBar(
                    1.0, share, min(BAR, self.width), complete_style="cyan", finished_style="cyan"
                )
            ]
        )
        self._live.update(Group(Text(self._text, no_wrap=True), *bar))
        if not self._live.is_started:
            self._live.start()
            self._console.show_cursor(True)  # whoever is killed leaves a terminal with a cursor
        self._live.refresh()

    def row(self, text: str) -> None:
        if self._live.is_started and self._out.terminal_columns:
            self._console.print(show_controls(text), soft_wrap=True)
        else:
            super().row(text)

    def close(self) -> None:
        if self._live.is_started:
            self.state(self._text)  # the bar has done its work
            self._live.stop()


class NotebookDisplay(Display):
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
        self._state, self._share = show_controls(text), share
        self._show()

    def row(self, text: str) -> None:
        self._rows.append(show_controls(text))
        self._show()

    def _show(self) -> None:
        from IPython.display import display

        text = "\n".join([*self._rows, *([self._state] if self._state else [])])
        bar = (
            ""
            if self._share is None
            else f'<progress value="{self._share:.4f}" style="width:60ch"></progress>'
        )
        parts = ("\n".join(self._rows), bar, self._state)
        html = "".join(
            part if part is bar else f"<pre>{escape(part)}</pre>" for part in parts if part
        )
        bundle = {"text/plain": text, "text/html": html}
        if self._handle is None:
            self._handle = display(bundle, raw=True, display_id=True)
        else:
            self._handle.update(bundle, raw=True)


class Quiet:
    """A stream to write to, whoever listens. `columns` : characters in a line of its terminal."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream, self.encoding = stream, getattr(stream, "encoding", None) or "utf-8"

    @property
    def terminal_columns(self) -> int:
        """Characters in a line of a terminal; 0 for any other stream, and for one that does not
        say.
        """
        try:
            return (
                0 if self._stream is None else os.get_terminal_size(self._stream.fileno()).columns
            )
        except (OSError, ValueError, AttributeError):  # no terminal, closed, or no file at all
            return 0

    @property
    def columns(self) -> int:
        """The same, `WIDTH` where nothing says how wide it is."""
        return self.terminal_columns or WIDTH

    def write(self, text: str) -> None:
        if self._stream is None:
            return
        try:
            self._stream.write(text)
            self._stream.flush()
        except UnicodeEncodeError:
            self.write(text.encode("ascii", "backslashreplace").decode())
        except (OSError, ValueError):  # the reader has gone, or the stream is closed
            pass

    def flush(self) -> None:
        """`write` has done it."""


def _suitable(stream: TextIO | None, out: TextIO | None) -> str:
    """The way that suits both streams; IPython is not imported to find out whether this is a
    notebook's kernel.
    """
    if stream is None and out is None:
        return "silent"
    interactive = getattr(sys.modules.get("IPython"), "get_ipython", None)
    if getattr(interactive and interactive(), "kernel", None) is not None:
        return "notebook"
    try:
        return (
            "terminal"
            if stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"
            else "plain"
        )
    except ValueError:  # closed
        return "plain"
