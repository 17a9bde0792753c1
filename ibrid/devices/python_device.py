"""A device written in Python: any object with `step(t, v_abc) -> i_abc`, of the user's own or from
a file.
"""

import importlib.util
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ibrid.devices.device_file import DeviceFile
from ibrid.errors import IbridError, near


class PythonDevice:
    """An object with `step(t, v_abc)` as a `TerminalDevice`; its references are attributes of the
    names in the device file.
    """

    def __init__(self, device: DeviceFile, stepped: Any = None) -> None:
        self._device = device
        self._stepped = _object_in(device) if stepped is None else stepped
        if not callable(getattr(self._stepped, "step", None)):
            raise IbridError(
                f"{device.file}: a device must have step(t, v_abc), which answers three currents; "
                f"found a {type(self._stepped).__name__} without one"
            )
        signals = device.signals
        self._voltage = 1.0 / signals["v"].per_unit if "v" in signals else 1.0
        self._current = signals["i"].per_unit if "i" in signals else 1.0
        for name, value in device.start.items():
            self._set(name, value)

    def put(self, reference: str, value: float) -> None:
        """Set a reference, per unit."""
        meaning = self._device.signals[reference]
        self._set(meaning.names[0], value / meaning.per_unit)

    move = put

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        """(n, 3) currents out of the device at the voltages (n, 3), per unit, at the samples from
        `first` on.
        """
        i = np.empty_like(v)
        given = v * self._voltage
        times = (np.arange(first, first + len(v)) * self._device.step_s).tolist()
        for k, t in enumerate(times):
            i[k] = self._three_currents(self._stepped.step(t, given[k]), t)
        return i * self._current

    def _three_currents(self, answer: Any, t: float) -> np.ndarray:
        """The answer of one step as (3,) real numbers."""
        try:
            currents = np.asanyarray(answer)
        except ValueError:  # rows of different lengths
            currents = np.asanyarray(None)
        if currents.shape != (3,):
            raise IbridError(
                f"{self._device.file}: step must answer three currents, i_a, i_b, i_c; "
                f"found an answer of shape {currents.shape} at t = {t:g} s"
            )
        if currents.dtype.kind not in "fiu" or np.ma.isMaskedArray(currents):
            kind = "masked" if np.ma.isMaskedArray(currents) else currents.dtype.name
            raise IbridError(
                f"{self._device.file}: step must answer three real numbers; found {kind} ones at "
                f"t = {t:g} s, answer floats"
            )
        return currents

    def _set(self, name: str, value: float) -> None:
        if not hasattr(self._stepped, name):
            raise IbridError(
                f"{self._device.file}: the object has no attribute {name!r:.60}, which [signals] "
                "or [start] of the device file "
                "names; give it one, or correct the name"
            )
        setattr(self._stepped, name, value)


def module_in(path: Path) -> ModuleType:
    """The file, executed. Raises IbridError that names the line where it fails."""
    if path.suffix != ".py" or not path.is_file():
        raise IbridError(f"{path}: there is no such Python file; correct `file` in the device file")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise IbridError(f"{path} cannot be read as Python; give a FILE.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    sys.path.append(str(path.parent))
    with _failing_in(path):
        spec.loader.exec_module(module)
    return module


def _object_in(device: DeviceFile) -> Any:
    """The object in the file, made with the parameters where it is a class or a function."""
    path_text, _, name = device.file.rpartition(":")
    path = Path(path_text)
    if not path_text or not name.isidentifier():
        raise IbridError(
            f"file of a python device must be FILE.py:OBJECT; found {device.file!r:.200}"
        )
    module = module_in(path)
    if not hasattr(module, name):
        raise IbridError(f"{path}: has no {name}; {near(name, devices_in(module))}")
    value = getattr(module, name)
    makes = isinstance(value, type) or not hasattr(value, "step")
    if makes and callable(value):
        with _failing_in(path):
            return value(**device.parameters)
    if device.parameters:
        raise IbridError(
            f"{path}: {name} is made already and takes no parameters; name its class in place of "
            "the object"
        )
    return value


def devices_in(module: ModuleType) -> list[str]:
    """Names of what has `step` in a module."""
    return [
        name
        for name, value in vars(module).items()
        if name[0] != "_" and callable(getattr(value, "step", None))
    ]


@contextmanager
def _failing_in(path: Path) -> Iterator[None]:
    """Within, what the user's own code raises is a sentence with its line."""
    try:
        yield
    except (Exception, SystemExit) as error:  # anything may go wrong in it
        innermost_first = reversed(traceback.extract_tb(error.__traceback__))
        line = next(
            (f", line {frame.lineno}" for frame in innermost_first if frame.filename == str(path)),
            "",
        )
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
        raise IbridError(f"{path}{line}: it failed with {said}; mend it until it runs") from error
