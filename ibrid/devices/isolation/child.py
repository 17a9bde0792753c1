"""The process in which a model file of somebody else runs: it is asked on standard input and
answers on what was its output.

A question or an answer is a line of JSON, and behind it as many numbers (float64) as the line says.
Whatever the model prints goes nowhere, and the process ends with the one that began it.
"""

import json
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, BinaryIO

import numpy as np

from ibrid.devices.describing import describe_here
from ibrid.devices.device_file import DeviceFile, SignalMeaning
from ibrid.devices.isolation.descendants import adopt_orphans, end_descendants
from ibrid.devices.isolation.files_read import FilesRead
from ibrid.devices.opening import TerminalDevice, open_here
from ibrid.devices.power_stage import PowerStage
from ibrid.errors import IbridError
from ibrid.foreign_data import json_in

#: Bytes of memory that a model may take, where the system keeps to it.
MEMORY = 8 << 30
#: Bytes of the line of a message, and rows of its numbers, at most.
LONGEST_LINE, MOST_ROWS = 10_000_000, 100_000_000
#: Characters of an error, which may be a model's own.
LONGEST_ERROR = 2_000
Message = tuple[dict[str, Any], np.ndarray]
NOTHING = np.zeros((0, 3))


def send(stream: BinaryIO, line: dict[str, Any], numbers: np.ndarray = NOTHING) -> None:
    """Write a message; numbers : (n, 3)."""
    header = json.dumps({**line, "numbers": len(numbers)}, allow_nan=False)
    stream.write(header.encode() + b"\n" + np.ascontiguousarray(numbers, dtype=float).tobytes())
    stream.flush()


def receive(stream: BinaryIO) -> Message | None:
    """Read a message; None at the end of the stream or where it broke off.

    Raises ValueError for what is no message: a model can write where its answers go.
    """
    header = stream.readline(LONGEST_LINE)
    if not header.endswith(b"\n"):
        return None
    line = json_in(header)
    count = line.get("numbers") if isinstance(line, dict) else None
    if not (isinstance(count, int) and 0 <= count <= MOST_ROWS):
        raise ValueError("no number of rows")
    content = stream.read(count * 3 * 8)
    if len(content) < count * 3 * 8:
        return None
    return line, np.frombuffer(content).reshape(count, 3)


def serve() -> None:
    """The life of the process: the device is opened, then played, until nobody asks any more."""
    answers = _quiet_output()
    _limit_memory()
    adopt_orphans()
    born = os.getpid()
    files = FilesRead()
    questions: SimpleQueue[Message] = SimpleQueue()
    threading.Thread(target=_listen, args=[questions], daemon=True).start()
    device: TerminalDevice | None = None
    for line, numbers in iter(questions.get, None):
        try:
            told: dict[str, Any] = {}
            result = NOTHING
            if "describe" in line:
                told = {"described": describe_here(line["describe"])}
            elif "files" in line:
                told = {"files": files.paths()}
            else:
                device, result = _answered(device, line, numbers)
        except IbridError as error:
            told = {"error": str(error)[:LONGEST_ERROR]}
        except MemoryError:
            told = {"error": "the model needs more memory than there is"}
        except BaseException as error:  # code of others: anything may go wrong in it
            told = {"error": _told(error)}
        if os.getpid() != born:  # the model forked, and this is the copy
            os._exit(0)
        send(answers, told, NOTHING if "error" in told else result)


def _answered(
    device: TerminalDevice | None, line: dict[str, Any], v: np.ndarray
) -> tuple[TerminalDevice, np.ndarray]:
    """The device, and the currents that were asked for."""
    if device is None:
        return open_here(device_from(line["open"])), NOTHING
    if "put" in line:
        for reference, value in line["put"].items():
            device.put(reference, value)
        return device, NOTHING
    if "move" in line:
        for reference, value in line["move"].items():
            device.move(reference, value)
        return device, NOTHING
    i = device.play(line["first"], v)
    if not np.isfinite(i).all():
        sample = line["first"] + int(np.argmin(np.isfinite(i).all(axis=1)))
        raise IbridError(
            f"its current is not a finite number from t = {sample * line['step_s']:g} s on"
        )
    return device, i


def plain_device(device: DeviceFile) -> dict[str, Any]:
    """The device file in the types of JSON."""
    signals = {role: [list(one.names), one.per_unit] for role, one in device.signals.items()}
    stage = None if device.power_stage is None else vars(device.power_stage)
    return {**vars(device), "signals": signals, "power_stage": stage}


def device_from(content: dict[str, Any]) -> DeviceFile:
    """The device file of `plain_device`."""
    signals = {
        role: SignalMeaning(tuple(names), per_unit)
        for role, (names, per_unit) in content["signals"].items()
    }
    stage = content["power_stage"] and PowerStage(**content["power_stage"])
    return DeviceFile(**{**content, "signals": signals, "power_stage": stage})


def _quiet_output() -> BinaryIO:
    """The stream of answers; what anybody prints from now on, C code too, goes nowhere."""
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    return answers


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):  # Windows, or a lower limit of the user's
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def _listen(questions: "SimpleQueue[Message]") -> None:
    """Hand on what is asked; at the end of it the process ends, whatever the model does."""
    for message in _messages(sys.stdin.buffer):
        questions.put(message)
    end_descendants(os.getpid())
    os._exit(0)


def _messages(stream: BinaryIO) -> Iterator[Message]:
    while (message := receive(stream)) is not None:
        yield message


def _told(error: BaseException) -> str:
    return f"it failed with {type(error).__name__}: {' '.join(str(error).split())[:300]}"
