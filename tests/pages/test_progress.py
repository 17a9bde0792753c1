"""Live progress: one line that is rewritten in a terminal, plain lines elsewhere, one output in a
notebook.
"""

import io
import json
import os
import pty
import re
import select
import subprocess
import sys

import pytest
from ibrid_search.recursion.progress import (
    WIDEST,
    Progress,
    Snapshot,
    clock_time,
    milestone_head,
    milestone_row,
    printable,
    progress_line,
)
from ibrid_search.run.tally import Tally
from ibrid_search.run.trajectory import Milestone

from ibrid.display import NOTEBOOK_WIDTH, WIDTH
from ibrid.errors import IbridError

TALLY = Tally(valid=70, duplicate=12, unchanged=4, refused=14)
HALFWAY = Snapshot(step=100, evaluations=70, best=0.0123, tally=TALLY)
NOTE = "LCL filter instead of the L filter, control of the converter current"
STEP = Milestone(17, 20, NOTE, 0.42, 0.166, "500-2000", 0.00986, 0.00123)


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Terminal:
    """A pseudo-terminal of some width; `text` is what was written to it so far."""

    def __init__(self, columns: int) -> None:
        import fcntl
        import struct
        import termios

        self._reader, writer = pty.openpty()
        settings = termios.tcgetattr(writer)
        settings[1] &= ~termios.OPOST  # what is written comes out as it is
        termios.tcsetattr(writer, termios.TCSANOW, settings)
        fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.stream = os.fdopen(writer, "w", encoding="utf-8")

    @property
    def text(self) -> str:
        found = b""
        while select.select([self._reader], [], [], 0.0)[0]:
            found += os.read(self._reader, 65536)
        return found.decode()

    def close(self) -> None:
        self.stream.close()
        os.close(self._reader)


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    found = Terminal(60)
    yield found
    found.close()


def screen(text: str) -> list[str]:
    """The lines that a terminal shows after `text`, with \\r, \\n, "up", "erase this line" and
    colours as commands.
    """
    lines, row, column = [""], 0, 0
    for part in re.findall(r"\x1b\[\??\d*[A-Za-z]|[\r\n]|[^\x1b\r\n]+", text):
        if part == "\r":
            column = 0
        elif part == "\n":
            row, column = row + 1, 0
            lines += [""] * (row == len(lines))
        elif part.endswith("A"):
            row -= 1
        elif part.endswith("K"):
            lines[row] = ""
        elif not part.startswith("\x1b"):
            lines[row] = lines[row].ljust(column)[:column] + part + lines[row][column + len(part) :]
            column += len(part)
    return [line.rstrip() for line in lines]


def test_a_budget_below_what_a_run_has_is_no_share_of_it():
    line = progress_line(Snapshot(20, 16, 0.3), 12, None)
    assert line.startswith("16 evaluations, step 20")
    assert "/12" not in line


def test_line_tells_evaluations_step_best_rate_time_and_shares():
    line = progress_line(HALFWAY, 500, 14.3333)
    for part in (
        "70/500 evaluations",
        "step 100",
        "best 0.0123",
        "14.3/s",
        "ETA 0:30",
        "valid 70%",
        "duplicate 12%",
        "unchanged 4%",
        "refused 14%",
    ):
        assert part in line
    assert "failed" not in line


def test_line_is_honest_about_what_is_not_known_yet():
    line = progress_line(Snapshot(), None, None)
    assert line.startswith("0 evaluations, step 0, best -")
    assert "ETA" not in line
    assert "/s" not in line
    assert "failed 50%" in progress_line(Snapshot(2, 2, None, Tally(valid=1, failed=1)), 10, 1.0)


def test_line_tells_what_language_models_have_taken():
    line = progress_line(Snapshot(2, 2, 0.5, spent="12,345 tokens, cost 0.42"), 10, 1.0)
    assert "ETA 0:08, 12,345 tokens, cost 0.42 |" in line


@pytest.mark.parametrize("width", [1, 20, 60, 79, 99, 130])
def test_line_keeps_to_the_width_and_gives_up_words_first_and_shares_last(width):
    line = progress_line(HALFWAY, 500, 14.3333, width)
    assert len(line) <= width
    assert line.startswith("70/500"[:width])
    assert ("valid 70%" in line) == (width == 130)
    assert ("val 70%" in line) == (width in (79, 99))
    assert ("step 100" in line) == (width in (60, 99, 130))


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0, "0:00"), (59.6, "1:00"), (3599, "59:59"), (3600, "1:00:00"), (864_000, "10 days")],
)
def test_durations_are_read_as_on_a_clock(seconds, words):
    assert clock_time(seconds) == words


def test_terminal_line_is_rewritten_in_place_within_the_width(terminal):
    clock = Clock()
    progress = Progress(stream=terminal.stream, out=terminal.stream, clock=clock)
    progress.start(500)
    for number in range(1, 4):
        clock.now += 1.0
        progress.update(Snapshot(number, number, 10.0**-number, TALLY))
    text = terminal.text
    shown, bar = screen(text)
    assert shown.startswith("3/500 evaluations, step 3, best 0.00100, 1/s, ETA 8:17")
    assert set(bar) == {"━", "╺"} or set(bar) == {"━"}
    assert len(shown) < 60
    assert len(bar) < 60
    progress.finish()
    assert screen(text + terminal.text) == [
        shown,
        "",
    ]  # the bar has gone, the cursor is on a line of its own


def test_an_interrupt_leaves_a_terminal_with_its_cursor_on_a_new_line(terminal):
    def interrupted():
        with Progress(stream=terminal.stream, out=terminal.stream) as progress:
            progress.start(500)
            progress.update(HALFWAY)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    text = terminal.text
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")
    assert screen(text)[-1] == ""


def test_milestones_scroll_by_above_the_line_which_comes_back(terminal):
    progress = Progress(stream=terminal.stream, out=terminal.stream, clock=Clock())
    progress.start(500)
    progress.update(HALFWAY)
    progress.milestone(STEP)
    progress.milestone(STEP)
    lines = screen(terminal.text)
    row = milestone_row(STEP, 60)
    assert tuple(lines[: 2 + 2 * len(row)]) == (*milestone_head(60), *row, *row)
    assert lines[2 + 2 * len(row)].startswith("70/500, best 0.0123")
    progress.finish()


def test_a_shorter_line_leaves_nothing_of_a_longer_one(terminal):
    clock = Clock()
    progress = Progress(stream=terminal.stream, clock=clock)
    progress.update(Snapshot(10**9, 10**9, 1.2345e-9, TALLY))
    clock.now = 1.0
    progress.update(Snapshot(1, 1, 0.5, Tally()))
    shown = screen(terminal.text)
    assert shown == [progress_line(Snapshot(1, 1, 0.5, Tally()), None, None, 59)]


def test_terminal_is_redrawn_at_most_ten_times_a_second_and_at_the_end(terminal):
    clock = Clock()
    progress = Progress(stream=terminal.stream, clock=clock)
    progress.start(1000)
    for number in range(1, 1001):
        clock.now += 0.001
        progress.update(Snapshot(number, number, 0.5, TALLY))
    text = terminal.text
    assert 10 <= text.count("/1000") <= 12
    progress.finish()
    assert "1000/1000" in terminal.text


def test_streams_that_are_no_terminal_get_a_line_now_and_then():
    clock, stream, out = Clock(), io.StringIO(), io.StringIO()
    progress = Progress(stream=stream, out=out, every=10.0, clock=clock)
    progress.start(100)
    for number in range(1, 36):
        clock.now += 1.0
        progress.update(Snapshot(number, number, 0.5, TALLY))
    progress.milestone(STEP)
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert [line.split("/")[0] for line in lines] == ["1", "11", "21", "31", "35"]
    assert "\r" not in stream.getvalue()
    assert tuple(out.getvalue().splitlines()) == (
        *milestone_head(WIDTH),
        *milestone_row(STEP, WIDTH),
    )


def test_the_end_is_shown_once():
    stream = io.StringIO()
    with Progress(stream=stream, out=stream) as progress:
        progress.start(100)
        progress.update(HALFWAY)
    progress.finish()
    assert stream.getvalue().count("70/100") == 1


def test_rate_is_that_of_this_sitting_and_of_late():
    clock, stream = Clock(), io.StringIO()
    progress = Progress("plain", stream=stream, every=0.0, clock=clock)
    progress.start(2000, done=1000)  # resumed
    for number in range(1, 61):
        clock.now += 1.0
        progress.update(Snapshot(number, 1000 + 2 * number, 0.5, TALLY))
    assert ", 2/s, ETA 7:20" in stream.getvalue().splitlines()[-1]
    for number in range(1, 61):
        clock.now += 1.0
        progress.update(Snapshot(60 + number, 1120 + 10 * number, 0.5, TALLY))
    assert ", 10/s, ETA 0:28" in stream.getvalue().splitlines()[-1]


def test_rate_falls_while_nothing_ends():
    clock, stream = Clock(), io.StringIO()
    progress = Progress("plain", stream=stream, every=0.0, clock=clock)
    progress.start(100)
    clock.now = 1.0
    progress.update(Snapshot(1, 10, 0.5, TALLY))
    clock.now = 20.0
    progress.update(Snapshot(2, 10, 0.5, TALLY))
    assert ", 0.5/s" in stream.getvalue().splitlines()[-1]


def test_no_time_left_is_told_of_few_evaluations_or_uneven_ones():
    clock, stream = Clock(), io.StringIO()
    progress = Progress("plain", stream=stream, every=0.0, clock=clock)
    progress.start(100)
    for number, wait in enumerate((10.0, 10.0, 10.0, 90.0, 1.0), 1):
        clock.now += wait
        progress.update(Snapshot(number, number, 0.5, TALLY))
    told = ["ETA" in line for line in stream.getvalue().splitlines()]
    assert told == [False, False, True, False, False]
    assert "ETA 16:10" in stream.getvalue()  # 97 of 10 s each


def test_silent_writes_nothing(capsys):
    with Progress("silent") as progress:
        progress.start(10)
        progress.update(HALFWAY)
        progress.milestone(STEP)
    captured = capsys.readouterr()
    assert captured.out + captured.err == ""


def test_an_unknown_way_to_show_is_one_sentence():
    with pytest.raises(
        IbridError, match="must be shown as auto, terminal, plain, notebook, silent"
    ):
        Progress("loud")


class Gone(io.StringIO):
    """A pipe that nobody reads any more."""

    def write(self, _: str) -> int:
        raise BrokenPipeError


def test_a_reader_that_has_gone_does_not_end_the_search():
    with Progress("plain", stream=Gone(), out=Gone(), every=0.0) as progress:
        progress.start(10)
        progress.update(HALFWAY)
        progress.milestone(STEP)
    closed = io.StringIO()
    closed.close()
    Progress(stream=closed, out=closed).say("nobody hears this")


def test_a_stream_of_ascii_gets_escapes_for_other_letters():
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    Progress("plain", stream=stream, out=stream).say("größer 漢")
    stream.flush()
    assert raw.getvalue() == rb"gr\xf6\xdfer \u6f22" + b"\n"


def test_notes_cannot_move_the_cursor():
    out = io.StringIO()
    one = Milestone(7, 9, "wipe\x1b[2J\r\nall\x07", 0.9, 0.5)
    Progress("plain", stream=out, out=out).milestone(one)
    assert not set("\x1b\r\x07") & set(out.getvalue())
    assert len(out.getvalue().splitlines()) == 3
    assert printable("a\tb\u202ec") == "a b c"


@pytest.mark.parametrize("width", [80, 100, 120, WIDEST, 1000])
def test_a_milestone_tells_evaluation_change_error_and_band_within_the_width(width):
    lines = (*milestone_head(width), *milestone_row(STEP, width))
    assert all(len(line) <= min(width, WIDEST) for line in lines)
    names, rule, first, *more = lines
    assert len(rule) == min(width, WIDEST)
    assert first.split()[0] == "17"
    assert first.endswith("0.166      500-2000, 0.00986 -> 0.00123")
    assert first.index("0.166") == names.index("NRMSE")
    assert first.index("500-2000") == names.index("band (Hz)")
    start = names.index("what changed")
    note = " ".join(line[start:].strip() for line in (first[: names.index("NRMSE")], *more))
    assert note == NOTE  # nothing is cut
    assert all(not line[:start].strip() for line in more)


def test_a_wider_window_needs_fewer_lines():
    heights = [len(milestone_row(STEP, width)) for width in (20, 80, 100, WIDEST)]
    assert heights == [4, 3, 2, 1]


def test_a_milestone_without_a_band_or_a_note_is_a_line():
    assert milestone_row(Milestone(1, 0, "", None, 0.997), 80) == (f"{'1':>10}{'0.997':>35}",)


def test_a_note_of_any_length_takes_four_lines_at_most():
    lines = milestone_row(Milestone(1, 1, "word " * 10_000 + "x" * 10_000, 0.9, 0.5), 80)
    assert len(lines) == 4
    assert lines[-1].endswith("...")


@pytest.mark.slow
def test_a_notebook_shows_one_output_with_a_bar_that_is_updated():
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient")
    code = (
        "from ibrid_search.recursion.progress import Progress, Snapshot\nfrom "
        "ibrid_search.run.trajectory import Milestone\n"
        "progress = Progress()\nprogress.start(10)\nprogress.update(Snapshot(1, 1, 0.5))\n"
        "progress.milestone(Milestone(7, 9, 'a <row>', 0.9, 0.5))\nprogress.update(Snapshot(2, 2, "
        "0.25))\n"
    )
    cells = [nbformat.v4.new_code_cell(text) for text in (code, f"{code}progress.finish()\n")]
    book = nbformat.v4.new_notebook(cells=cells)
    client.NotebookClient(book, timeout=600, kernel_name="python3").execute()
    (during,), (after,) = (cell.outputs for cell in book.cells)
    lines = after["data"]["text/plain"].splitlines()
    row = milestone_row(Milestone(7, 9, "a <row>", 0.9, 0.5), NOTEBOOK_WIDTH)
    assert tuple(lines[:3]) == (*milestone_head(NOTEBOOK_WIDTH), *row)
    assert lines[3].startswith("2/10 evaluations, step 2, best 0.250")
    assert "ETA" not in lines[3]
    assert "a &lt;row&gt;" in after["data"]["text/html"]
    assert '<progress value="0.1000"' in during["data"]["text/html"]
    assert "<progress" not in after["data"]["text/html"]


@pytest.mark.slow
def test_importing_progress_loads_no_notebook_and_no_plotting_library():
    code = (
        "import json, sys, ibrid_search.recursion.progress; print(json.dumps(sorted(sys.modules)))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], check=True, timeout=600, capture_output=True, text=True
    )
    assert not {"IPython", "matplotlib", "rich", "jinja2"} & set(json.loads(found.stdout))
