"""A further pass of recordings: MATLAB's structures and the files that its lines write, encodings,
dq of several programs, phasors of several makes; and spoilt ones.
"""

import bz2
from collections.abc import Callable
from pathlib import Path

import numpy as np
from recording_makes import (
    BASE,
    I_PEAK,
    S_BASE,
    V_BASE,
    V_PEAK,
    Made,
    current,
    six,
    table,
    text,
    times,
    voltage,
    written,
)
from scipy.io import savemat

_SI = (*BASE, "--unit", "si")
_SEVEN = "t|va|vb|vc|ia|ib|ic"
_KILO = (1e-3, 1e-3)


def time_of_words(form: str) -> Callable:
    """Times with their unit in the cell, as writetimetable writes durations."""

    def write(folder: Path) -> list[Path]:
        time, values = six()
        names = ["Time", *(f"{one}_{k}" for one in ("Vabc", "Iabc") for k in (1, 2, 3))]
        rows = [
            ",".join([form.format(t=t, ms=1e3 * t), *(f"{cell:.10g}" for cell in row)])
            for t, row in zip(time, values.T.tolist(), strict=True)
        ]
        return written(folder, "record.csv", "\n".join([",".join(names), *rows, ""]))

    return write


def timeseries_structures(folder: Path) -> list[Path]:
    """struct(timeseries) of voltages and currents: Time and Data each."""
    time, values = six()
    held = {
        "Vabc": {"Time": time[:, None], "Data": values[:3].T},
        "Iabc": {"Time": time[:, None], "Data": values[3:].T},
    }
    savemat(folder / "ts.mat", {"out": held})
    return [folder / "ts.mat"]


def simulation_output(folder: Path) -> list[Path]:
    """tout and arrays of three columns, as a SimulationOutput is taken apart."""
    time, values = six()
    held = {"tout": time[:, None], "Vabc": values[:3].T, "Iabc": values[3:].T}
    savemat(folder / "out.mat", held)
    return [folder / "out.mat"]


def one_array(folder: Path) -> list[Path]:
    """What the line of MATLAB for a timeseries leaves: t and x."""
    time, values = six()
    savemat(folder / "record.mat", {"t": time[:, None], "x": values.T})
    return [folder / "record.mat"]


def simulink_array(folder: Path) -> list[Path]:
    """To File and To Workspace as an array: a column of times and six of signals."""
    time, values = six()
    savemat(folder / "simout.mat", {"ans": np.column_stack([time, values.T])})
    return [folder / "simout.mat"]


def scope_one_signal_each(folder: Path) -> list[Path]:
    """A structure with time whose axes hold one signal each."""
    time, values = six()
    signals = np.zeros((1, 6), dtype=[("values", object), ("label", object)])
    for k, name in enumerate(("va", "vb", "vc", "ia", "ib", "ic")):
        signals[0, k] = (values[k][:, None], name)
    savemat(folder / "scope.mat", {"ScopeData1": {"time": time[:, None], "signals": signals}})
    return [folder / "scope.mat"]


def in_dq(names: str, sizes: tuple[float, float] = (1.0, 1.0), *, behind: bool = False) -> Callable:
    """d and q under names of a program."""

    def write(folder: Path) -> list[Path]:
        time = times()
        v, i = voltage(time), current(time)
        v, i = (np.conj(v), np.conj(i)) if behind else (v, i)
        columns = [
            v.real * sizes[0],
            v.imag * sizes[0],
            i.real * sizes[1],
            i.imag * sizes[1],
        ]
        return written(folder, "record.csv", text(names.split("|"), [time, *columns]))

    return write


def rms(names: str, sizes: tuple[float, float], **how) -> Callable:
    """Voltage, p and q of an RMS program."""

    def write(folder: Path) -> list[Path]:
        time = times(1000)
        v, s = voltage(time), voltage(time) * np.conj(current(time))
        columns = [time, abs(v) * sizes[0], s.real * sizes[1], s.imag * sizes[1]]
        return written(folder, "rms.csv", text(names.split("|"), columns, **how))

    return write


def frame(kind: str) -> Callable:
    """A DataFrame as a workbook, Parquet or HDF5."""

    def write(folder: Path) -> list[Path]:
        import h5py
        import pandas

        time, values = six(2000.0)
        names = ["t [s]", *(f"v{p} [V]" for p in "abc"), *(f"i{p} [A]" for p in "abc")]
        columns = dict(zip(names, [time, *values], strict=True))
        path = folder / f"record.{kind}"
        if kind == "h5":
            with h5py.File(path, "w") as file:
                for name, column in columns.items():
                    file[name.split()[0]] = column
            return [path]
        data = pandas.DataFrame(columns)
        data.to_excel(path, index=False) if kind == "xlsx" else data.to_parquet(path)
        return [path]

    return write


def bzip2(folder: Path) -> list[Path]:
    (path,) = table(_SEVEN)(folder)
    return written(folder, "record.csv.bz2", bz2.compress(path.read_bytes()))


def phasor_of(names: str, *, radians: bool = False, kilo: bool = False) -> Callable:
    """Magnitude and angle of one phase, from other makers."""

    def write(folder: Path) -> list[Path]:
        time = times(250)
        v, i = voltage(time), current(time)
        size = 1e3 if kilo else 1.0
        columns = [
            abs(v) * V_BASE / np.sqrt(3) / size,
            np.angle(v, deg=not radians),
            abs(i) * I_PEAK / np.sqrt(2) / size,
            np.angle(i, deg=not radians),
        ]
        return written(folder, "pmu.csv", text(names.split("|"), [time, *columns]))

    return write


def encoded(encoding: str) -> Callable:
    def write(folder: Path) -> list[Path]:
        (path,) = table(_SEVEN)(folder)
        path.write_bytes(path.read_text().encode(encoding))
        return [path]

    return write


_NUMBERED = "t=1,va=2,vb=3,vc=4,ia=5,ib=6,ic=7"
_TESTED = "Time|Voltage phase a (V)|Voltage phase b (V)|Voltage phase c (V)"
_TESTED += "|Current phase a (A)|Current phase b (A)|Current phase c (A)"
_UVW = "t in s|u_L1 in V|u_L2 in V|u_L3 in V|i_L1 in A|i_L2 in A|i_L3 in A"
MORE_RECORDINGS = (
    Made("writetimetable, seconds", time_of_words("{t:.10g} sec"), _SI),
    Made("writetimetable, milliseconds", time_of_words("{ms:.10g} ms"), _SI),
    Made("writetable of a timetable", time_of_words("{t:.10g}"), _SI),
    Made("timeseries as structures", timeseries_structures, _SI),
    Made("a SimulationOutput taken apart", simulation_output, _SI),
    Made("t and x", one_array, (*_SI, "--channels", _NUMBERED)),
    Made("an array of Simulink", simulink_array, (*_SI, "--channels", _NUMBERED)),
    Made("a scope of single signals", scope_one_signal_each, _SI),
    Made("dq of a program", in_dq("Time|Vsd_pu|Vsq_pu|Isd_pu|Isq_pu"), ()),
    Made(
        "dq in kV and kA",
        in_dq("t [s]|v_d [kV]|v_q [kV]|i_d [kA]|i_q [kA]", (V_PEAK / 1e3, I_PEAK / 1e3)),
    ),
    Made("dq with q behind", in_dq("t|v_d|v_q|i_d|i_q", behind=True), ("--q-axis", "lags")),
    Made("kV, MW, Mvar", rms("t [s]|U [kV]|P [MW]|Q [Mvar]", (V_BASE / 1e3, S_BASE / 1e6))),
    Made(
        "Spannung, Wirkleistung",
        rms(
            "Zeit [s]|Spannung [V]|Wirkleistung [W]|Blindleistung [var]",
            (V_BASE, S_BASE),
            mark=";",
            comma=True,
        ),
    ),
    Made(
        "tension, puissance",
        rms(
            "temps [s]|Tension [V]|Puissance active [W]|Puissance réactive [var]",
            (V_BASE, S_BASE),
            mark=";",
            comma=True,
        ),
    ),
    Made("电压 and 功率", rms("时间[s]|电压[V]|有功功率[W]|无功功率[var]", (V_BASE, S_BASE))),
    Made("a workbook", frame("xlsx")),
    Made("Parquet", frame("parquet")),
    Made("HDF5", frame("h5"), _SI),
    Made("bz2", bzip2),
    Made("UTF-16 with tabs", encoded("utf-16")),
    Made(
        "phasors in kV and rad",
        phasor_of("t [s]|V_mag [kV]|V_ang [rad]|I_mag [kA]|I_ang [rad]", radians=True, kilo=True),
    ),
    Made(
        "phasors of the positive sequence",
        phasor_of("Time (s)|Vpos_mag (V)|Vpos_ang (deg)|Ipos_mag (A)|Ipos_ang (deg)"),
    ),
    Made("words for phases", table(_TESTED)),
    Made("PowerFactory's in", table(_UVW)),
)


def with_spike(folder: Path) -> list[Path]:
    """A single sample of a current that stands out."""
    (path,) = table("t|va [V]|vb [V]|vc [V]|ia [A]|ib [A]|ic [A]")(folder)
    lines = path.read_text().splitlines()
    cells = lines[300].split(",")
    cells[5] = f"{10 * float(cells[5]):g}"
    lines[300] = ",".join(cells)
    path.write_text("\n".join([*lines, ""]))
    return [path]


def row_lost(folder: Path) -> list[Path]:
    """A row in the middle that broke off."""
    (path,) = table(_SEVEN)(folder)
    lines = path.read_text().splitlines()
    lines[500] = lines[500][:20]
    path.write_text("\n".join([*lines, ""]))
    return [path]


def backwards(folder: Path) -> list[Path]:
    """The second half stands in front of the first."""
    (path,) = table(_SEVEN)(folder)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *rows[1000:], *rows[:1000], ""]))
    return [path]


def flowing_in(folder: Path) -> list[Path]:
    time, values = six()
    return written(folder, "record.csv", text(_SEVEN.split("|"), [time, *values[:3], *-values[3:]]))


def behind_by_a_third(folder: Path) -> list[Path]:
    time, values = six()
    return written(
        folder,
        "record.csv",
        text(_SEVEN.split("|"), [time, *values[:3], *np.roll(values[3:], 1, 0)]),
    )


def one_phase_reversed(folder: Path) -> list[Path]:
    time, values = six()
    values = values * np.array([1, 1, 1, 1, -1, 1])[:, None]
    return written(folder, "record.csv", text(_SEVEN.split("|"), [time, *values]))


def at_other_power(folder: Path) -> list[Path]:
    time = times(1000)
    v = voltage(time)
    s = v * np.conj(current(time))
    columns = [time, abs(v), s.real * 10e6, s.imag * 10e6]
    return written(folder, "rms.csv", text(["t", "u_pu", "p", "q"], columns))


MORE_WRONG = (
    (Made("a spike in a current", with_spike), "stands out"),
    (Made("a row that broke off", row_lost), "is it cut off"),
    (Made("halves exchanged", backwards), "must increase"),
    (Made("the current counted into the device", flowing_in), "counts into it"),
    (Made("currents of other phases", behind_by_a_third), "not in the order"),
    (Made("one current reversed", one_phase_reversed), "swapped, reversed or missing"),
    (Made("watts as per unit", at_other_power, ()), "must be per unit or have a unit"),
    (
        Made(
            "line to line as of a phase",
            table(_SEVEN),
            ("--base", "10MVA,11.547kV", "--f0-hz", "60"),
        ),
        "voltage at rest",
    ),
    (
        Made("voltage and current exchanged", table("t|ia|ib|ic|va|vb|vc")),
        "must be at most 20 per unit at rest",
    ),
)
