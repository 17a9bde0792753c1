"""PSCAD's .psout through the package of its makers, in the process that reads foreign binaries."""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import some
from ibrid.measurement.importing.timed.signal_names import signal_of

#: Under which the sentences about what was not read stand.
REMARKS = "\0remarks"
#: Names of calls that say nothing of a signal.
_PLAIN = ("", "data", "pgb:data", "record", "root", "main")


def psout_arrays(content: bytes) -> dict[str, np.ndarray]:
    """The signals of the first run that can be voltages, currents or powers, by name with unit, and
    their time.
    """
    try:
        from importlib import import_module

        psout = import_module("mhi.psout")
    except ImportError:
        raise ImportError(
            "pip install mhi-psout reads it, on Windows; elsewhere let PSCAD write .out files, or "
            "export csv"
        ) from None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.psout"
        path.write_bytes(content)
        with psout.File(str(path)) as file:
            runs = getattr(file, "num_runs", 1)
            return _arrays(file.run(0), runs)


def _arrays(run: Any, runs: int) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    time = np.zeros(0)
    left_out: list[str] = []
    for trace in run.traces():
        domain = getattr(trace, "domain", None)
        name, unit = _described(trace)
        if domain is None or not _is_known(name, unit) or (size := _seconds(domain)) is None:
            continue
        data = np.asarray(trace.data, dtype=float)
        instants = size * np.asarray(domain.data, dtype=float)
        if not len(time):
            time = instants
        if len(data) == len(time) == len(instants) and np.array_equal(instants, time):
            shown = f"{name} [{unit}]" if unit else name
            arrays[shown if shown not in arrays else f"{shown} #{len(arrays) + 1}"] = data
        else:
            left_out.append(name)
    if not arrays:
        raise ValueError("it holds no signal that is called as a voltage, a current or a power")
    remarks = []
    if left_out:
        remarks.append(f"signals at other times than the first are left out: {some(left_out)}")
    if runs > 1:
        remarks.append(f"the first of its {runs} runs is read, the others are not")
    said = {REMARKS: np.array(remarks, dtype=str)} if remarks else {}
    return {"time [s]": time, **arrays, **said}


def _seconds(domain: Any) -> float | None:
    """The size of its unit in s; None where it is a frequency, over which spectra stand."""
    name, unit = _described(domain)
    signal = signal_of(f"{name} [{unit}]")
    if signal.quantity == "f" or signal.dimension == "frequency":
        return None
    return signal.factor if signal.dimension == "time" else 1.0


def _is_known(name: str, unit: str) -> bool:
    """Whether a signal is called as a voltage, a current or a power."""
    return bool(signal_of(f"{name} [{unit}]").quantity or signal_of(name).quantity)


def _described(trace: Any) -> tuple[str, str]:
    """Name and unit of the trace, or of the nearest call above it that has them; of several
    dimensions with its number.
    """
    name, unit, number = "", "", ""
    for place in (trace, *_above(trace)):
        said = _said(place)
        called = said.get("name", said.get("label", "")).strip()
        unit = unit or said.get("unit", said.get("units", "")).strip()
        if called.isdigit():
            number = number or called
        elif called.lower() not in _PLAIN:
            name = name or called
    if (
        name
        and number
        and any(_said(one).get("dim", "1") not in ("", "1") for one in _above(trace))
    ):
        name = f"{name}:{int(number) + 1}"
    return name, unit


def _above(trace: Any) -> Iterator[Any]:
    call = getattr(trace, "call", None)
    while call is not None:
        yield call
        call = getattr(call, "parent", None)


def _said(place: Any) -> dict[str, str]:
    held = place.variables() if callable(getattr(place, "variables", None)) else {}
    pairs = held.items() if isinstance(held, Mapping) else ()
    return {str(key).lower(): str(value) for key, value in pairs}
