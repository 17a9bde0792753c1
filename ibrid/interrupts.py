"""Ctrl-C, however deep in compiled code it arrives.

CasADi calls Python while it converts numbers, and drops what is raised there or makes an error of
its own of it: every second interrupt among its calls is lost. So an interrupt is remembered before
it is raised, and raised again until it is heard.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import Any

Handler = Callable[[int, FrameType | None], object]


class _Memory:
    """Of the main thread, which alone gets signals.

    `listens` : within `hearing_interrupts`. `asked` : to stop.
    """

    listens = False
    asked = False


_memory = _Memory()


def heed_interrupt() -> None:
    """Raise KeyboardInterrupt where one was asked for and lost; call it where errors of compiled
    code are caught.

    While a KeyboardInterrupt is dealt with it was not lost, and cleaning up is not disturbed.
    """
    if _memory.asked and _in_main_thread() and not isinstance(sys.exception(), KeyboardInterrupt):
        raise KeyboardInterrupt


def was_interrupted() -> bool:
    """Whether an interrupt was asked for and is on its way: compiled code may have made another
    error of it, and speak of it.
    """
    return _memory.asked and _in_main_thread()


def forget_interrupt() -> None:
    """Go on after an interrupt, where it was the ordinary end of some work."""
    _memory.asked = False


@contextmanager
def hearing_interrupts(answer: Handler | None = None, *others: int) -> Iterator[None]:
    """Let no KeyboardInterrupt be lost within; an error that compiled code made of one becomes one
    again.

    answer : a handler in place of the present one, which may do without raising. others : signals
    beside SIGINT that it answers.

    A handler that somebody else installed is asked as before, and what ignores interrupts goes on
    ignoring them. In other threads, which get no signals, nothing happens.
    """
    if not _in_main_thread():
        yield
        return
    before = _installed(answer, others)
    listened, told = _memory.listens, sys.unraisablehook
    sys.unraisablehook = partial(_dropped, told)
    _memory.listens = True
    if not listened:
        _memory.asked = False
    try:
        yield
        heed_interrupt()
    except Exception:
        heed_interrupt()
        raise
    finally:
        sys.unraisablehook = told
        try:
            _end(before, listened)
        except KeyboardInterrupt:  # one that arrived just now
            _end(before, listened)
            raise


@contextmanager
def undisturbed() -> Iterator[None]:
    """Hold an interrupt until the end of what must not be left half done; it is answered then as it
    would have been.

    The import of a package is such: Python keeps parts of what was imported so far, with which no
    later import succeeds, and in a notebook the kernel lives on. In other threads, which get no
    signals, nothing happens.
    """
    answer = signal.getsignal(signal.SIGINT)
    if not (_in_main_thread() and callable(answer)):
        yield
        return
    held: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: held.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, answer)
        if held:
            answer(*held[0])


def _dropped(told: Callable[[Any], object], unraisable: Any) -> None:
    """An error that Python drops, as in a function that compiled code calls; an interrupt is heeded
    later, and no error.
    """
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        _memory.asked = True
    elif not _memory.asked:
        told(unraisable)


def _in_main_thread() -> bool:
    return threading.get_ident() == threading.main_thread().ident


def _installed(answer: Handler | None, others: tuple[int, ...]) -> dict[int, object]:
    """The handlers of before, by signal; none where nothing is to be done."""
    asked = answer or signal.getsignal(signal.SIGINT)
    if not callable(asked) or (answer is None and _memory.listens):
        return {}
    return {
        number: signal.signal(number, partial(_remembering, asked))
        for number in (signal.SIGINT, *others)
    }


def _remembering(asked: Handler, number: int, frame: FrameType | None) -> None:
    try:
        asked(number, frame)
    except KeyboardInterrupt:
        _memory.asked = True
        raise


def _end(before: dict[int, object], listened: bool) -> None:
    for number, handler in before.items():
        signal.signal(number, handler)  # type: ignore[arg-type]
    _memory.listens = listened
    if not listened:
        _memory.asked = False
