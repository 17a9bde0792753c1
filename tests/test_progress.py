"""Live progress: one line that is rewritten in a terminal, plain lines elsewhere, one output in a notebook."""

import io
import json
import os
import pty
import select
import subprocess
import sys

import pytest

from ibrid.errors import IbridError
from search.progress import HEAD, Progress, Snapshot, clock_time, milestone_row, printable, progress_line
from search.tally import Tally
from search.trajectory import Milestone

TALLY = Tally(valid=70, duplicate=12, unchanged=4, refused=14)
HALFWAY = Snapshot(step=100, evaluations=70, best=0.0123, tally=TALLY)


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
    """The lines that a terminal shows after `text`, with only \\r and \\n as commands."""
    lines = []
    for line in text.split("\n"):
        cells: list[str] = []
        for part in line.split("\r"):
            cells[: len(part)] = part
        lines.append("".join(cells).rstrip())
    return lines


def test_line_tells_evaluations_step_best_rate_time_and_shares():
    line = progress_line(HALFWAY, 500, 14.3333)
    for part in ("70/500 evaluations", "step 100", "best 0.0123", "14.3/s", "ETA 0:30", "valid 70%", "duplicate 12%",
                 "unchanged 4%", "refused 14%"):  # fmt: skip
        assert part in line
    assert "failed" not in line


def test_line_is_honest_about_what_is_not_known_yet():
    line = progress_line(Snapshot(), None, None)
    assert line.startswith("0 evaluations, step 0, best -")
    assert "ETA" not in line
    assert "/s" not in line
    assert "failed 50%" in progress_line(Snapshot(2, 2, None, Tally(valid=1, failed=1)), 10, 1.0)


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
    assert "\n" not in text
    (shown,) = screen(text)
    assert shown.startswith("3/500 evaluations, step 3, best 0.00100, 1/s, ETA 8:17")
    assert len(shown) < 60
    progress.finish()
    assert terminal.text == "\n"


def test_milestones_scroll_by_above_the_line_which_comes_back(terminal):
    progress = Progress(stream=terminal.stream, out=terminal.stream, clock=Clock())
    progress.start(500)
    progress.update(HALFWAY)
    progress.milestone("first row")
    progress.milestone("second")
    lines = screen(terminal.text)
    assert lines[:2] == [HEAD, "-" * len(HEAD)]
    assert lines[2:4] == ["first row", "second"]
    assert lines[4].startswith("70/500, best 0.0123")
    progress.finish()


def test_a_shorter_line_leaves_nothing_of_a_longer_one(terminal):
    clock = Clock()
    progress = Progress(stream=terminal.stream, clock=clock)
    progress.update(Snapshot(10**9, 10**9, 1.2345e-9, TALLY))
    clock.now = 1.0
    progress.update(Snapshot(1, 1, 0.5, Tally()))
    (shown,) = screen(terminal.text)
    assert shown == progress_line(Snapshot(1, 1, 0.5, Tally()), None, None, 59)


def test_terminal_is_redrawn_at_most_ten_times_a_second_and_at_the_end(terminal):
    clock = Clock()
    progress = Progress(stream=terminal.stream, clock=clock)
    progress.start(1000)
    for number in range(1, 1001):
        clock.now += 0.001
        progress.update(Snapshot(number, number, 0.5, TALLY))
    text = terminal.text
    assert 10 <= text.count("\r") <= 24  # two returns where something is wiped out
    progress.finish()
    assert "1000/1000" in terminal.text


def test_streams_that_are_no_terminal_get_a_line_now_and_then():
    clock, stream, out = Clock(), io.StringIO(), io.StringIO()
    progress = Progress(stream=stream, out=out, every=10.0, clock=clock)
    progress.start(100)
    for number in range(1, 36):
        clock.now += 1.0
        progress.update(Snapshot(number, number, 0.5, TALLY))
    progress.milestone("a row")
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert [line.split("/")[0] for line in lines] == ["1", "11", "21", "31", "35"]
    assert "\r" not in stream.getvalue()
    assert out.getvalue().splitlines() == [HEAD, "-" * len(HEAD), "a row"]


def test_the_end_is_shown_once():
    stream = io.StringIO()
    with Progress(stream=stream, out=stream) as progress:
        progress.start(10)
        progress.update(HALFWAY)
    progress.finish()
    assert stream.getvalue().count("70/10") == 1


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


def test_silent_writes_nothing(capsys):
    with Progress("silent") as progress:
        progress.start(10)
        progress.update(HALFWAY)
        progress.milestone("row")
    captured = capsys.readouterr()
    assert captured.out + captured.err == ""


def test_an_unknown_way_to_show_is_one_sentence():
    with pytest.raises(IbridError, match="must be shown as auto, terminal, plain, notebook, silent"):
        Progress("loud")


class Gone(io.StringIO):
    """A pipe that nobody reads any more."""

    def write(self, _: str) -> int:
        raise BrokenPipeError


def test_a_reader_that_has_gone_does_not_end_the_search():
    with Progress("plain", stream=Gone(), out=Gone(), every=0.0) as progress:
        progress.start(10)
        progress.update(HALFWAY)
        progress.milestone("row")
    closed = io.StringIO()
    closed.close()
    Progress(stream=closed, out=closed).say("nobody hears this")


def test_a_stream_of_ascii_gets_question_marks_for_other_letters():
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    Progress("plain", stream=stream, out=stream).say("größer 漢")
    stream.flush()
    assert raw.getvalue() == b"gr??er ?\n"


def test_notes_cannot_move_the_cursor():
    out = io.StringIO()
    one = Milestone(7, 9, "wipe\x1b[2J\r\nall\x07", 0.9, 0.5)
    Progress("plain", stream=out, out=out).milestone(milestone_row(one))
    assert not set("\x1b\r\x07") & set(out.getvalue())
    assert len(out.getvalue().splitlines()) == 3
    assert printable("a\tb\u202ec") == "a b c"


def test_milestone_row_tells_evaluation_change_error_and_band_within_the_width():
    note = "add a phase-locked loop with both of its rotations"
    row = milestone_row(Milestone(17, 20, note, 0.42, 0.166, 4, 0.42, "5-50", 0.948, 0.335))
    shown = "17  add a phase-locked loop with both o...  0.420 -> 0.166          5-50 Hz, 0.948 -> 0.335"
    assert row.strip() == shown
    assert len(row) <= 110
    first = milestone_row(Milestone(0, 0, "the start", None, 0.997))
    assert first.split() == ["0", "the", "start", "0.997"]
    assert row.index("0.420") == first.index("0.997") == HEAD.index("NRMSE")


def test_a_notebook_shows_one_output_that_is_updated(tmp_path):
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient")
    code = (
        "from search.progress import Progress, Snapshot\n"
        "progress = Progress()\nprogress.start(10)\nprogress.update(Snapshot(1, 1, 0.5))\n"
        "progress.milestone('a <row>')\nprogress.update(Snapshot(2, 2, 0.25))\nprogress.finish()\n"
    )
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    client.NotebookClient(book, timeout=60, kernel_name="python3").execute()
    (output,) = book.cells[0].outputs
    assert output["data"]["text/plain"].splitlines()[:3] == [HEAD, "-" * len(HEAD), "a <row>"]
    assert output["data"]["text/plain"].splitlines()[3].startswith("2/10 evaluations, step 2, best 0.250")
    assert "a &lt;row&gt;" in output["data"]["text/html"]


def test_importing_progress_loads_no_notebook_and_no_plotting_library():
    code = "import json, sys, search.progress; print(json.dumps(sorted(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], check=True, timeout=60, capture_output=True, text=True)
    assert not {"IPython", "matplotlib"} & set(json.loads(found.stdout))
