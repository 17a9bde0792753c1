"""MATLAB's objects, whose bytes no other program reads: the line of MATLAB that saves each
readably.
"""

from collections.abc import Mapping

import numpy as np

from ibrid.errors import SweepError

#: Under which the classes of objects stand among arrays.
CLASSES = "\0classes"
_FRD = "[Y, w] = frdata(sys); save('sweep.mat', 'Y', 'w', '-v7')"
_SS = "[A, B, C, D] = ssdata(sys); save('model.mat', 'A', 'B', 'C', 'D', '-v7')"
_SIGNALS = "writetimetable(extractTimetable(logsout), 'record.csv')"
#: Class -> what saves it, where the variable is called as there.
SAVING = {
    "frd": _FRD,
    "idfrd": _FRD,
    "ss": _SS,
    "idss": _SS,
    "sparss": _SS,
    "mechss": _SS,
    "tf": _SS.replace("ssdata(sys)", "ssdata(ss(sys))"),
    "zpk": _SS.replace("ssdata(sys)", "ssdata(ss(sys))"),
    "idtf": _SS.replace("ssdata(sys)", "ssdata(ss(sys))"),
    "idpoly": _SS.replace("ssdata(sys)", "ssdata(ss(sys))"),
    "timeseries": "t = ts.Time; x = ts.Data; save('record.mat', 't', 'x', '-v7')",
    "timetable": "writetimetable(TT, 'record.csv')",
    "table": "writetable(T, 'table.csv')",
    "SimulationOutput": _SIGNALS.replace("logsout", "out.logsout"),
    "Dataset": _SIGNALS,
    "Signal": _SIGNALS,
    "tscollection": "ts = cellfun(@(n) tsc.(n), gettimeseriesnames(tsc), 'UniformOutput', false); "
    "writetimetable(timeseries2timetable(ts{:}), 'record.csv')",
}


def refuse_objects(arrays: dict[str, np.ndarray], where: str) -> None:
    """SweepError where a file holds objects and no arrays of numbers; the names of their classes
    are taken out.
    """
    classes = [str(one) for one in arrays.pop(CLASSES, np.zeros(0, dtype=str)).ravel()]
    if classes and not any(
        value.dtype.kind in "biufc" and value.size > 1 for value in arrays.values()
    ):
        raise SweepError(
            f"{where} must hold arrays of numbers; found a MATLAB object, "
            f"{how_to_save(classes[0])}."
        )


def how_to_save(name: str) -> str:
    """`of the class ss, in MATLAB: ..`, for a class by its full name; what to do with an unknown
    one.
    """
    short = name.rpartition(".")[2]
    if short not in SAVING:
        saving = f"{_FRD}; a model: {_SS}"
        return (
            f"of the class {short or 'unknown'}, in MATLAB save plain arrays, of a frequency "
            f"response: {saving}"
        )
    return f"of the class {short}, in MATLAB: {SAVING[short]}"


def classes_among(values: Mapping[str, object]) -> list[str]:
    """The classes of the objects that scipy classes and could not read."""
    classes = []
    for value in values.values():
        kind = type(value).__name__
        if kind == "MatlabOpaque":
            names = getattr(value, "dtype", np.dtype(float)).names or ()
            held = value["s2"].ravel()[0] if "s2" in names else b""  # type: ignore[index]
            classes.append(held.decode(errors="replace") if isinstance(held, bytes) else str(held))
        elif kind == "MatlabObject":
            classes.append(str(getattr(value, "classname", "")))
    return classes
