"""Ctrl-C at any moment ends a command with 130 or with its whole answer, and in Python with
KeyboardInterrupt.
"""

import ctypes
import random
import signal
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import casadi as ca
import pytest
from sharing import shared
from signalled import Ended, signalled
from small_commands import command

import ibrid
from ibrid import cli
from ibrid.commands import vocabulary
from ibrid.errors import ModuleError
from ibrid.interrupts import forget_interrupt, hearing_interrupts, heed_interrupt, undisturbed
from ibrid.lazy import imported_by_need
from ibrid.modules.own_law import call_law
from ibrid.streams import bordered_streams, complain
from ibrid.writing import write_whole

#: Moments of each command, drawn evenly from the processor time that it takes.
MOMENTS = 3


class Interrupting:
    """A number in whose conversion by CasADi an interrupt arrives: what is raised there is
    dropped.
    """

    def __DM__(self) -> ca.DM:
        signal.raise_signal(signal.SIGINT)
        return ca.DM(1.0)

    def __SX__(self) -> ca.SX:
        return ca.SX(1.0)


def lose_an_interrupt() -> ca.DM:
    return ca.sin(Interrupting())


def warn_of_what_is_dropped() -> None:
    """An error within a function that compiled code calls, which Python can but mention."""
    ctypes.CFUNCTYPE(None)(lose_and_break_off)()


def lose_and_break_off() -> None:
    lose_an_interrupt()
    raise NotImplementedError("Wrong number or type of arguments for overloaded function")


def assert_interrupted(work: Callable[[], object]) -> None:
    with pytest.raises(KeyboardInterrupt), hearing_interrupts():
        work()


# --- what is lost in compiled code


def test_casadi_drops_an_interrupt_that_arrives_while_it_converts_a_number():
    heard = []
    with hearing_interrupts(
        lambda number, frame: heard.append(number) or signal.default_int_handler(number, frame)
    ):
        lose_an_interrupt()
        forget_interrupt()
    assert heard == [signal.SIGINT]


def test_an_interrupt_that_was_dropped_is_raised_at_the_end():
    assert_interrupted(lose_an_interrupt)


def test_what_compiled_code_says_of_an_interrupt_is_not_shown_and_what_the_command_says_is(capsys):
    with bordered_streams():
        print("before", file=sys.stderr)

        def work() -> None:
            lose_an_interrupt()
            print("CasADi - WARNING: KeyboardInterrupt", file=sys.stderr)
            warn_of_what_is_dropped()

        assert_interrupted(work)
        complain("stopped")
    assert capsys.readouterr().err == "before\nibrid: stopped\n"


def test_an_interrupt_that_was_dropped_is_raised_where_it_is_heeded():
    reached = []

    def work() -> None:
        lose_an_interrupt()
        heed_interrupt()
        reached.append("further")

    assert_interrupted(work)
    assert not reached


def test_an_error_that_was_made_of_an_interrupt_is_one_again():
    assert_interrupted(lose_and_break_off)


def test_an_error_without_an_interrupt_stays_what_it_is():
    with pytest.raises(SystemError), hearing_interrupts():
        raise SystemError("returned NULL without setting an exception")


def test_an_own_law_that_breaks_off_because_of_an_interrupt_is_not_at_fault():
    def trial() -> None:
        with suppress(ModuleError):  # as a screening of candidates does it
            call_law("Own", lose_and_break_off)

    assert_interrupted(trial)


@pytest.mark.slow
def test_an_evaluation_in_python_that_loses_an_interrupt_is_interrupted(
    monkeypatch: pytest.MonkeyPatch,
):
    home = import_module("ibrid.evaluation.evaluate")
    real = home.symbolic_model

    def interrupted(*given, **options):
        lose_an_interrupt()
        return real(*given, **options)

    monkeypatch.setattr(home, "symbolic_model", interrupted)
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    with pytest.raises(KeyboardInterrupt):
        ibrid.evaluate(ibrid.textbook("gfl_exact"), sweep)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_nothing_is_written_after_an_interrupt(tmp_path: Path):
    def work() -> None:
        lose_an_interrupt()
        write_whole(tmp_path / "answer.json", "{}")

    assert_interrupted(work)
    assert not list(tmp_path.iterdir())


# --- whose interrupt it is


def test_a_handler_that_does_without_raising_is_not_overruled():
    heard = []
    with hearing_interrupts(lambda number, frame: heard.append(number)):
        signal.raise_signal(signal.SIGINT)
        heed_interrupt()
    assert heard == [signal.SIGINT]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_ignores_interrupts_goes_on_ignoring_them():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with hearing_interrupts():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_interrupt_within_is_raised_without_and_forgotten_then():
    assert_interrupted(hearing_interrupts()(lose_an_interrupt))
    with hearing_interrupts():
        heed_interrupt()


def test_who_was_ended_by_an_interrupt_as_usual_goes_on():
    with hearing_interrupts():
        lose_an_interrupt()
        forget_interrupt()


def test_cleaning_up_after_an_interrupt_is_not_interrupted_by_the_same():
    cleaned = []

    def work() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            heed_interrupt()
            cleaned.append("all")

    assert_interrupted(work)
    assert cleaned == ["all"]


def test_another_thread_neither_hears_nor_installs_anything():
    ended = []

    def work() -> None:
        with hearing_interrupts():
            assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        ended.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ended


# --- commands


def test_a_command_that_loses_an_interrupt_ends_with_130(monkeypatch: pytest.MonkeyPatch, capsys):
    def table(_: object) -> str:
        return str(lose_an_interrupt())

    monkeypatch.setattr(vocabulary, "vocabulary_table", table)
    assert cli.main(["modules"]) == 130
    assert "stopped by the keyboard" in capsys.readouterr().err


@pytest.mark.slow
def test_a_command_that_is_interrupted_in_the_middle_ends_with_130(tmp_path: Path):
    ended = interrupted("import", tmp_path, 0.6)
    assert ended.status == 130
    assert ended.err.startswith("ibrid: stopped by the keyboard")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "start",
        "gap",
        "search",
        "import",
        "fleet",
        pytest.param("evaluate", marks=pytest.mark.nightly),
    ],
)
def test_a_command_that_is_interrupted_at_any_moment_ends_with_130_or_its_answer(
    name: str, tmp_path: Path
):
    drawn = random.Random(name)
    for number in range(MOMENTS):
        folder = tmp_path / str(number)
        folder.mkdir()
        ended = interrupted(name, folder, drawn.random())
        assert ended.status in (130, whole(name).status), ended.err
        assert "Traceback" not in ended.err
        assert not ended.left
        assert not list(folder.rglob("*.part"))


def interrupted(name: str, folder: Path, part: float) -> Ended:
    """A command after that part of the processor time which it takes."""
    return signalled(command(name, folder), folder, after=part * whole(name).worked)


@shared
def whole(name: str) -> Ended:
    """The same command left alone."""
    with tempfile.TemporaryDirectory() as folder:
        return signalled(command(name, Path(folder)), Path(folder), after=float("inf"))


def test_an_interrupt_that_python_drops_in_a_callback_is_not_printed_and_not_lost(
    capsys: pytest.CaptureFixture[str],
):
    called = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt), hearing_interrupts():
        called()
    assert "ignored" not in capsys.readouterr().err


def test_an_interrupt_while_a_package_is_imported_is_answered_when_it_is_whole(
    tmp_path, monkeypatch
):
    (tmp_path / "slow_to_import.py").write_text(
        "import signal\nsignal.raise_signal(signal.SIGINT)\nwhole = 5\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    attribute = imported_by_need("ibrid", {"whole": "slow_to_import"})
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            attribute("whole")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert sys.modules["slow_to_import"].whole == attribute("whole") == 5
    finally:
        signal.signal(signal.SIGINT, before)
        del sys.modules["slow_to_import"]


@pytest.mark.parametrize("answer", [signal.SIG_IGN, signal.SIG_DFL])
def test_what_ignores_interrupts_goes_on_ignoring_them_while_something_is_undisturbed(answer):
    before = signal.signal(signal.SIGINT, answer)
    try:
        with undisturbed():
            assert signal.getsignal(signal.SIGINT) is answer
    finally:
        signal.signal(signal.SIGINT, before)
