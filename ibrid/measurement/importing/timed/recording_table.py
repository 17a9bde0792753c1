"""A table in time as samples of voltage and current: units of the columns, times of every kind,
records that a column names.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.formats.event_csv import why_not_increasing
from ibrid.measurement.formats.grouping import rows_of_each
from ibrid.measurement.importing.doubts.transformer_ratio import (
    Ratios,
    TransformerDoubt,
    ratio_question,
)
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.numbers.percent import as_shown
from ibrid.measurement.importing.timed.clock_times import times_of
from ibrid.measurement.importing.timed.families import Column, SignalFamily
from ibrid.measurement.importing.timed.phasors import Phasors, phasors_of
from ibrid.measurement.importing.timed.set_points import set_point_columns, set_points_of
from ibrid.measurement.importing.timed.signal_names import size_of, split_unit
from ibrid.measurement.importing.unsaid import UnsaidError
from ibrid.measurement.recordings.event_samples import Samples
from ibrid.measurement.sweeps.quantities import engineering

#: What a column in % measures, and its size.
_PERCENT = ("per unit", 0.01)
_FRAMES = {"phases": "abc", "lines": "abc"}
#: Families whose numbers are instantaneous; a voltage of the others above this is not per unit.
_INSTANTANEOUS, _LARGEST_PU = ("phases", "lines", "dq"), 3.0


@dataclass(frozen=True, eq=False)
class Recording:
    """The records of a table. `frame` : dq or abc. `unit` : "si" or "pu", "" where the table does
    not say it. `f0_hz` : nearest nominal frequency to a column of frequencies, None without one.
    `readings` : what, from which column, in which unit.
    `of_estimator` : whether these are phasors or rms values, whose window the table does not say.
    """

    samples: tuple[Samples, ...]
    frame: str
    unit: str
    f0_hz: float | None
    readings: tuple[tuple[str, str, str], ...]
    of_estimator: bool


def recording_of(
    table: ForeignTable,
    family: SignalFamily,
    header: Mapping[str, Any],
    supposed_unit: str = "",
    ratios: Ratios | None = None,
    transformers: Sequence[TransformerDoubt] = (),
) -> Recording:
    """The records of a table whose columns are known.

    header : what is said of the recording beside the columns: unit, f0_hz, s_base_va, v_base_v.
    supposed_unit : "si" or "pu" where nothing says it; of phasors and powers their size tells.
    ratios : what is said of transformers. transformers : what comments tell of them, which is asked
    for where nothing is said.

    Raises SweepError: cells that are no numbers, times that do not increase, units that do not fit
    together, a base that is needed and not said.
    """
    names = list(table.columns)
    in_percent = [
        names[column.place]
        for column in family.columns.values()
        if (column.signal.dimension, column.signal.factor) == _PERCENT
    ]
    in_percent += [
        name
        for name in set_point_columns(names).values()
        if size_of(split_unit(name)[1]) == _PERCENT
    ]
    table = as_shown(table, in_percent)
    if "t" not in family.columns:
        raise SweepError(
            f"{table.where} must have a column of times; found {some(names, 9)}, say which: "
            "--channels t=1 (its number)."
        )
    columns = {
        role: column for role, column in family.columns.items() if role not in ("t", "record")
    }
    values = {
        role: _numbers(table, names[column.place]) * column.signal.factor
        for role, column in columns.items()
    }
    time, remarks = times_of(table, names[family.columns["t"].place], family.columns["t"])
    remarks = (*table.remarks, *family.remarks, *remarks)
    read_family = family
    family, values, converted = _with_powers_as_voltage(table, family, values, header)
    remarks = (*remarks, *converted)
    unit = _unit(table, family, names, header)
    if not unit and family.kind not in _INSTANTANEOUS:
        size = next(value for role, value in values.items() if role[0] == "v")
        unit = "si" if np.nanmedian(np.abs(size)) > _LARGEST_PU else "pu"
    unit = unit or supposed_unit
    _require_base(table, unit, header)
    if ratios is not None:
        _require_si(table, unit, ratios)
        values = {role: value * ratios.of(role) for role, value in values.items()}
        remarks = (*remarks, ratios.words)
    elif unit == "si" and (asked := ratio_question(transformers, family.scaled)):
        raise UnsaidError(f"{table.where} does not say {asked}.")
    f0_hz = _nominal(values.get("f"))
    whole = np.all([np.isfinite(one) for one in (time, *values.values())], axis=0)
    time, values, remarks = _whole_rows(table, names, family, whole, time, values, remarks)
    record = _records(table, family, names, whole)
    nominal = float(header.get("f0_hz") or f0_hz or 60.0)
    set_points = set_points_of(table, unit, header, nominal, whole)
    used = {names[column.place] for column in family.columns.values()}
    used |= table.made_of
    used |= {one.column for one in set_points.values()}
    if unused := [name for name in names if name not in used]:
        remarks = (*remarks, f"not used: {some(unused, 8)}")
    angles = [one for one in unused if (size_of(split_unit(one)[1]) or "")[:1] == ("angle",)]
    if angles and family.kind in ("powers", "currents") and "v_ang" not in family.columns:
        words = f"{angles[0]} is not used and may be the angle of the voltage: --channels v_ang="
        remarks = (*remarks, f"{words}{names.index(angles[0]) + 1}")
    of_estimator = family.kind not in _INSTANTANEOUS
    unit_of_samples = "pu" if of_estimator else unit
    sizes = _sizes_of_set_points(header) if unit_of_samples == "si" else {}
    samples = []
    for name, rows in rows_of_each(record.tolist()).items():
        _require_forward(table, name, time[rows])
        part = {role: value[rows] for role, value in values.items()}
        v, i, more = _voltage_and_current(
            family, part, time[rows], unit, header, table.where, nominal
        )
        sigma = part.get("sigma")
        told = {role: one.values[rows] * sizes.get(role, 1.0) for role, one in set_points.items()}
        samples.append(Samples(str(name), time[rows], v, i, sigma, (*remarks, *more), told))
    readings = tuple(
        (role, names[column.place], _shown(column, unit))
        for role, column in read_family.columns.items()
    )
    readings += tuple((role, one.column, one.reading) for role, one in set_points.items())
    frame = _FRAMES.get(family.kind, "dq")
    return Recording(tuple(samples), frame, unit_of_samples, f0_hz, readings, of_estimator)


def _sizes_of_set_points(header: Mapping[str, Any]) -> dict[str, float]:
    """What 1 per unit of a set point is in the unit of instantaneous samples in V and A."""
    s_base_va, v_peak = header["s_base_va"], header["v_base_v"] * np.sqrt(2 / 3)
    return {"p_ref": s_base_va, "q_ref": s_base_va, "v_ref": v_peak}


def _voltage_and_current(
    family: SignalFamily,
    part: dict[str, np.ndarray],
    time: np.ndarray,
    unit: str,
    header: Mapping[str, Any],
    where: str,
    f0_hz: float,
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """v and i as `Samples` hold them, and what was assumed."""
    if family.kind in ("phases", "lines"):
        i = np.array([part[f"i{phase}"] for phase in "abc"])
        if family.kind == "phases":
            return np.array([part[f"v{phase}"] for phase in "abc"]), i, ()
        between = np.array([part["vab"], part["vbc"], -part["vab"] - part["vbc"]])
        return (between - np.roll(between, 1, axis=0)) / 3, i, ()
    if family.kind == "dq":
        return np.array([part["vd"], part["vq"]]), np.array([part["id"], part["iq"]]), ()
    base = header.get("s_base_va"), header.get("v_base_v")
    phasors: Phasors = phasors_of(family, part, time, unit, f0_hz, base, where)
    v, i = (np.array([np.real(one), np.imag(one)]) for one in (phasors.v, phasors.i))
    return v, i, phasors.remarks


def _numbers(table: ForeignTable, name: str) -> np.ndarray:
    values = table.columns[name]
    if values.dtype.kind != "f":
        raise SweepError(
            f"{table.where}: column {name} must be numbers in every row; found text or gaps, "
            "correct or leave out the rows."
        )
    return values


def _with_powers_as_voltage(
    table: ForeignTable,
    family: SignalFamily,
    values: dict[str, np.ndarray],
    header: Mapping[str, Any],
) -> tuple[SignalFamily, dict[str, np.ndarray], tuple[str, ...]]:
    """The recording with p and q per unit where the voltage is and they are in W, and in W where it
    is in V and they are per unit; and a remark on it.

    Raises SweepError where the base is not said.
    """
    columns = family.columns
    powers = {columns[role].signal.dimension for role in "pq" if role in columns}
    voltages = {
        column.signal.dimension
        for role, column in columns.items()
        if role[0] == "v" and not role.endswith("_ang")
    }
    if (voltages, powers) not in (({"per unit"}, {"power"}), ({"voltage"}, {"per unit"})):
        return family, values, ()
    if not header.get("s_base_va") or not header.get("v_base_v"):
        names = list(table.columns)
        size = next(role for role in columns if role[0] == "v")
        shown = [names[columns[role].place] for role in (size, "p")]
        raise SweepError(
            f"{table.where} does not say the inverter's base, which {shown[0]} beside {shown[1]} "
            "needs: add --base S_VA,V_LL (such as 10kVA,400V)."
        )
    base = float(header["s_base_va"])
    dimension, factor = ("per unit", 1 / base) if "power" in powers else ("power", base)
    of_powers = {
        role: replace(columns[role], signal=replace(columns[role].signal, dimension=dimension))
        for role in "pq"
    }
    values = values | {role: values[role] * factor for role in "pq"}
    words = (
        "what is per unit beside columns with units is taken on the base of "
        f"{engineering(base, 'VA')} and {engineering(float(header['v_base_v']), 'V')}"
    )
    return replace(family, columns={**columns, **of_powers}), values, (words,)


def _unit(
    table: ForeignTable, family: SignalFamily, names: Sequence[str], header: Mapping[str, Any]
) -> str:
    """ "si" or "pu" as the columns of voltage and current say, else as is said; "" where nothing
    does.
    """
    said = str(header.get("unit") or "")
    measured = {
        role: column.signal.dimension
        for role, column in family.columns.items()
        if role[0] in "vipq" and not role.endswith("ang")
    }
    absolute = [
        role for role, dimension in measured.items() if dimension in ("voltage", "current", "power")
    ]
    relative = [role for role, dimension in measured.items() if dimension == "per unit"]
    if absolute and relative:
        first, second = (names[family.columns[roles[0]].place] for roles in (absolute, relative))
        raise SweepError(
            f"{table.where}: voltages and currents must all be in V and A, or all per unit; found "
            f"{first} beside {second}, "
            "say the unit of one as --channels "
            f"{relative[0]}={family.columns[relative[0]].place + 1}[kV]."
        )
    unit = "si" if absolute else "pu" if relative else said
    if absolute and len(absolute) < len(measured) and said != "si":
        lacking = next(role for role in measured if role not in absolute)
        plain = {"v": "kV", "i": "kA", "p": "MW", "q": "Mvar"}[lacking[0]]
        without, beside = (names[family.columns[role].place] for role in (lacking, absolute[0]))
        raise SweepError(
            f"{table.where}: {without} must have a unit, as {beside} has; say it: "
            f"--channels {lacking}={family.columns[lacking].place + 1}[{plain}]."
        )
    return unit


def _require_base(table: ForeignTable, unit: str, header: Mapping[str, Any]) -> None:
    if unit == "si" and not (header.get("s_base_va") and header.get("v_base_v")):
        raise SweepError(
            f"{table.where} does not say the inverter's base, which voltages and currents in V and "
            "A need: add --base S_VA,V_LL "
            "(such as 10kVA,400V)."
        )


def _require_si(table: ForeignTable, unit: str, ratios: Ratios) -> None:
    if unit != "si" and ratios != Ratios():
        raise SweepError(
            f"{table.where}: --ratio multiplies voltages in V and currents in A, and these are per "
            "unit; leave it out, or say their unit: --unit si."
        )


def _nominal(frequency: np.ndarray | None) -> float | None:
    """50 or 60 Hz, whichever a column of frequencies is near; None without one."""
    if frequency is None or not np.isfinite(frequency).any():
        return None
    middle = float(np.nanmedian(frequency))
    return next((nominal for nominal in (50.0, 60.0) if abs(middle - nominal) < 3.0), None)


def _whole_rows(
    table: ForeignTable,
    names: Sequence[str],
    family: SignalFamily,
    whole: np.ndarray,
    time: np.ndarray,
    values: dict[str, np.ndarray],
    remarks: tuple[str, ...],
) -> tuple[np.ndarray, dict[str, np.ndarray], tuple[str, ...]]:
    """Rows without a gap.

    SweepError where a row lacks some of its numbers; one that lacks all is said.
    """
    if whole.all():
        return time, values, remarks
    measured = [value for role, value in values.items() if role != "sigma"]
    empty = np.all([np.isnan(value) for value in measured], axis=0)
    partly = ~whole & ~empty
    if partly.any() or not whole.any():
        row = int(np.argmax(partly if partly.any() else ~whole))
        lacking = next((role for role, value in values.items() if not np.isfinite(value[row])), "t")
        place = table.place(row, names[family.columns[lacking].place])
        raise SweepError(f"{place} must be a number; found text or gaps, cut the record there.")
    words = f"{int(empty.sum())} rows hold no numbers: left out"
    return time[whole], {role: value[whole] for role, value in values.items()}, (*remarks, words)


def _records(
    table: ForeignTable, family: SignalFamily, names: Sequence[str], whole: np.ndarray
) -> np.ndarray:
    """(n,) the record of each row."""
    if "record" not in family.columns:
        return np.full(int(whole.sum()), table.stem, dtype=object)
    return np.asarray(table.columns[names[family.columns["record"].place]])[whole]


def _require_forward(table: ForeignTable, name: object, time: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        before, after = (float(one) for one in time[back[0] : back[0] + 2])
        raise SweepError(f"{table.where}: {why_not_increasing(str(name), before, after)}")


def _shown(column: Column, unit: str) -> str:
    words = {
        "voltage": "V",
        "current": "A",
        "power": "W",
        "time": "s",
        "angle": "degrees",
        "frequency": "Hz",
    }
    dimension = column.signal.dimension
    if not dimension and column.signal.quantity in ("v", "i"):
        return {"si": "V or A", "pu": "per unit"}.get(unit, "per unit, as nothing says otherwise")
    plain = words.get(dimension, dimension)
    return (
        f"{plain} times {column.signal.factor:g}"
        if column.signal.factor != 1 and dimension != "per unit"
        else plain
    )
