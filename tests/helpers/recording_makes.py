"""Files of one recording as EMT programs, RMS programs, recorders and colleagues write them; the
law behind is a closed form.
"""

import gzip
import lzma
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

S_BASE, V_BASE, F0 = 10e6, 20e3, 60.0
V_PEAK = V_BASE * np.sqrt(2 / 3)
I_PEAK = 2 / 3 * S_BASE / V_PEAK
P, Q = 0.8, 0.1
BASE = ("--base", "10MVA,20kV", "--f0-hz", "60")
_TURN = np.exp(-2j * np.pi / 3 * np.arange(3))
#: Where the voltage falls to a half and comes back, s; how long that takes; the end.
DIP, BACK, EDGE, END = 0.1, 0.25, 0.002, 0.4


@dataclass(frozen=True)
class Made:
    """A make of file.

    `write` : folder -> the files that are named. `options` : what `ibrid import` is told. `digits`
    : per unit, how far samples may be from the law. `rate` : samples per s.
    """

    make: str
    write: Callable[[Path], list[Path]]
    options: tuple[str, ...] = BASE
    digits: float = 1e-6


def voltage(time: np.ndarray) -> np.ndarray:
    """(n,) complex, d + j q per unit at an angle of 13 degrees: a dip to a half with edges of a
    raised cosine.
    """
    fall = np.clip((time - DIP) / EDGE, 0, 1) - np.clip((time - BACK) / EDGE, 0, 1)
    return (1 - 0.25 * (1 - np.cos(np.pi * fall))) * np.exp(1j * np.deg2rad(13))


def current(time: np.ndarray) -> np.ndarray:
    """(n,) complex per unit, out: it answers the dip with 10 ms."""
    answer = (
        1
        - np.exp(-np.clip(time - DIP, 0, None) / 0.01)
        - (1 - np.exp(-np.clip(time - BACK, 0, None) / 0.01))
    )
    return (P - 1j * Q + (0.2 - 0.5j) * answer) * np.exp(1j * np.deg2rad(13))


def times(rate: float = 5000.0) -> np.ndarray:
    return np.arange(round(END * rate) + 1) / rate


def phases(value: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(3, n) instantaneous values of a, b, c, peak."""
    return np.real(value * np.exp(2j * np.pi * F0 * time) * _TURN[:, None])


def six(rate: float = 5000.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and (6, n) voltages and currents of the phases in V and A."""
    time = times(rate)
    return time, np.concatenate(
        [V_PEAK * phases(voltage(time), time), I_PEAK * phases(current(time), time)]
    )


def text(
    names: list[str],
    columns: list[np.ndarray],
    mark: str = ",",
    above: tuple[str, ...] = (),
    comma: bool = False,
) -> str:
    rows = [mark.join(f"{cell:.10g}" for cell in row) for row in np.stack(columns, axis=1).tolist()]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    return "\n".join([*above, *([mark.join(names)] if names else []), *rows, ""])


def written(folder: Path, name: str, content: str | bytes, encoding: str = "utf-8") -> list[Path]:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return [path]


def table(
    names: str, scale: tuple[float, float] = (1.0, 1.0), *, file: str = "record.csv", **how
) -> Callable:
    """A table of the six phases under names of its own, parted by |."""

    def write(folder: Path) -> list[Path]:
        time, values = six()
        values = np.concatenate([values[:3] * scale[0], values[3:] * scale[1]])
        return written(folder, file, text(names.split("|"), [time, *values], **how))

    return write


def _pscad(
    folder: Path, described: Callable[[Path, list[tuple[str, str]]], None], parts: int
) -> list[Path]:
    """PSCAD's text: time and ten channels a file, without names; `described` writes what they
    are.
    """
    time, values = six()
    scaled = np.concatenate([values[:3] / 1e3, values[3:] / 1e3])
    fill = [np.full(len(time), 7.0 + k) for k in range(12)]
    columns = (
        [*fill[:6], *scaled[:3], *fill[6:9], *scaled[3:], *fill[9:]] if parts == 2 else list(scaled)
    )
    named = [
        ("V:1", "kV"),
        ("V:2", "kV"),
        ("V:3", "kV"),
        ("I:1", "kA"),
        ("I:2", "kA"),
        ("I:3", "kA"),
    ]
    if parts == 2:
        other = [(f"ctrl{k}", "pu") for k in range(12)]
        named = [*other[:6], *named[:3], *other[6:9], *named[3:], *other[9:]]
    described(folder, named)
    files = []
    for part in range(-(-len(columns) // 10)):
        rows = np.stack([time, *columns[10 * part : 10 * part + 10]], axis=1)
        body = "\n".join("  ".join(f"{cell:.9E}" for cell in row) for row in rows.tolist())
        files += written(folder, f"run_{part + 1:02d}.out", f"\n{body}\n")
    return files


def inf(folder: Path, named: list[tuple[str, str]]) -> None:
    lines = [
        f'PGB({k}) Output Desc="{name}" Group="Main" Max=20.0 Min=-20.0 Units="{unit}"'
        for k, (name, unit) in enumerate(named, 1)
    ]
    written(folder, "run.inf", "\n".join([*lines, ""]))


def infx(folder: Path, named: list[tuple[str, str]]) -> None:
    rows = [
        f'  <Analog index="{k}" name="{name}" orient="Main" unit="{unit}" min="-2" max="2"/>'
        for k, (name, unit) in enumerate(named)
    ]
    written(
        folder, "run.infx", "\n".join(['<?xml version="1.0"?>', "<List>", *rows, "</List>", ""])
    )


def pscad_inf(folder: Path) -> list[Path]:
    return _pscad(folder, inf, 1)


def pscad_two_files(folder: Path) -> list[Path]:
    return _pscad(folder, inf, 2)


def pscad_one_named(folder: Path) -> list[Path]:
    return _pscad(folder, inf, 2)[:1]


def pscad_by_inf(folder: Path) -> list[Path]:
    _pscad(folder, inf, 2)
    return [folder / "run.inf"]


def pscad_infx(folder: Path) -> list[Path]:
    return _pscad(folder, infx, 1)


def power_factory(folder: Path) -> list[Path]:
    """PowerFactory's export: a row of elements and a row of variables, as EMT."""
    time, values = six()
    names = [
        "b:tnow in s",
        *(f"m:u{p} in kV" for p in "ABC"),
        *(f"m:i{p}:bus1 in kA" for p in "ABC"),
    ]
    above = ("All calculations," + ",".join(["Bus PCC"] * 3 + ["Cub_1"] * 3),)
    return written(folder, "pf.csv", text(names, [time, *(values / 1e3)], above=above))


def power_factory_rms(folder: Path) -> list[Path]:
    """PowerFactory's RMS results of a test bench: positive sequence, per unit."""
    time = times(1000)
    v, i = voltage(time), current(time)
    s = v * np.conj(i)
    names = ["Time in s", "s:vpoc_pu", "s:ppoc_pu", "s:qpoc_pu"]
    above = (";".join(["All calculations", "meas", "meas", "meas"]),)
    return written(
        folder, "pf_rms.csv", text(names, [time, abs(v), s.real, s.imag], ";", above, comma=True)
    )


def mtb(folder: Path) -> list[Path]:
    """Names of a model test bench: active and reactive current of the positive sequence, per
    unit.
    """
    time = times(1000)
    v, i = voltage(time), current(time)
    own = i * np.conj(v) / abs(v)
    names = [
        "time",
        "MTB\\fft_pos_Vmag_pu",
        "MTB\\fft_pos_Id_pu",
        "MTB\\fft_pos_Iq_pu",
        "MTB\\P_pu_PoC",
        "MTB\\Q_pu_PoC",
    ]
    s = v * np.conj(i)
    return written(
        folder, "mtb.csv", text(names, [time, abs(v), own.real, -own.imag, s.real, s.imag], ";")
    )


def dycov(folder: Path) -> list[Path]:
    time = times(1000)
    v, i = voltage(time), current(time)
    own = i * np.conj(v) / abs(v)
    s = v * np.conj(i)
    bus = "BusPDR_BUS_"
    names = [
        "time",
        *(
            bus + n
            for n in ("Voltage", "ActivePower", "ReactivePower", "ActiveCurrent", "ReactiveCurrent")
        ),
    ]
    return written(
        folder, "rms.csv", text(names, [time, abs(v), s.real, s.imag, own.real, -own.imag], ";")
    )


def pmu(
    folder: Path, names: str = "Time (s)|VA_mag (V)|VA_ang (deg)|IA_mag (A)|IA_ang (deg)|Freq (Hz)"
) -> list[Path]:
    time = times(250)
    v, i = voltage(time), current(time)
    columns = [
        abs(v) * V_BASE / np.sqrt(3),
        np.angle(v, deg=True),
        abs(i) * I_PEAK / np.sqrt(2),
        np.angle(i, deg=True),
    ]
    return written(
        folder, "pmu.csv", text(names.split("|"), [time, *columns, np.full(len(time), F0)])
    )


def emtp(folder: Path) -> list[Path]:
    """Text of EMTP and ATP plots: blanks between, names of nodes."""
    time, values = six()
    names = [
        "Time",
        "v:PCCA",
        "v:PCCB",
        "v:PCCC",
        "c:PCCA -GRIDA",
        "c:PCCB -GRIDB",
        "c:PCCC -GRIDC",
    ]
    return written(folder, "atp.csv", text(names, [time, *values], ","))


def simulink_structure(folder: Path) -> list[Path]:
    """A scope's structure with time: signals of three columns and labels."""
    from scipy.io import savemat

    time, values = six()
    signals = np.zeros(
        (1, 2), dtype=[("values", object), ("dimensions", object), ("label", object)]
    )
    signals[0, 0] = (values[:3].T, 3.0, "Vabc")
    signals[0, 1] = (values[3:].T, 3.0, "Iabc")
    savemat(
        folder / "scope.mat",
        {"ScopeData": {"time": time[:, None], "signals": signals, "blockName": "m/Scope"}},
    )
    return [folder / "scope.mat"]


def packed(write: Callable[[Path], list[Path]], kind: str) -> Callable:
    def packed_write(folder: Path) -> list[Path]:
        files = write(folder)
        content = files[0].read_bytes()
        if kind == "zip":
            with zipfile.ZipFile(folder / "all.zip", "w", zipfile.ZIP_DEFLATED) as archive:
                for path in sorted(folder.iterdir()):
                    if path.suffix != ".zip":
                        archive.write(path, path.name)
            return [folder / "all.zip"]
        opener = {"gz": gzip.compress, "xz": lzma.compress}[kind]
        return written(folder, f"{files[0].name}.{kind}", opener(content))

    return packed_write


def in_unit_of_time(name: str, factor: float) -> Callable:
    def write(folder: Path) -> list[Path]:
        time, values = six()
        names = [name, "va [V]", "vb [V]", "vc [V]", "ia [A]", "ib [A]", "ic [A]"]
        return written(folder, "record.csv", text(names, [time * factor, *values]))

    return write


def line_of_units(folder: Path) -> list[Path]:
    time, values = six()
    above = ("t,Va,Vb,Vc,Ia,Ib,Ic",)
    return written(
        folder,
        "record.csv",
        text(["s", *["kV"] * 3, *["kA"] * 3], [time, *(values / 1e3)], above=above),
    )


def between_phases(folder: Path) -> list[Path]:
    time, values = six()
    lines = [values[0] - values[1], values[1] - values[2]]
    return written(
        folder,
        "record.csv",
        text(
            ["t", "Uab [V]", "Ubc [V]", "Ia [A]", "Ib [A]", "Ic [A]"], [time, *lines, *values[3:]]
        ),
    )


def started_up(folder: Path) -> list[Path]:
    """The record behind 0.2 s in which a simulation ramps up."""
    time = times()
    before = np.arange(0, 0.2, time[1] - time[0])
    ramp = np.clip(before / 0.1, 0, 1)
    v = np.concatenate([ramp * voltage(np.zeros(1)), voltage(time)])
    i = np.concatenate([ramp * current(np.zeros(1)), current(time)])
    columns = [np.arange(len(v)) * (time[1] - time[0]), v.real, v.imag, i.real, i.imag]
    return written(folder, "start.csv", text(["t", "v_d", "v_q", "i_d", "i_q"], columns))


def gapped(folder: Path) -> list[Path]:
    """Half a file: the last row breaks off."""
    (path,) = table("t|va|vb|vc|ia|ib|ic")(folder)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:900], lines[900][:30], ""]))
    return [path]


def three_phasors(folder: Path) -> list[Path]:
    """Magnitude and angle of each phase, as a PMU writes them, with the time of day."""
    time = times(200)
    stamps = np.datetime64("2026-03-01T12:00:00") + (time * 1e9).astype("timedelta64[ns]")
    names = [
        "Timestamp",
        *(
            f"{letter}{phase}_{part}"
            for letter in "VI"
            for phase in "ABC"
            for part in ("Mag", "Ang")
        ),
    ]
    columns = []
    for value, size in ((voltage(time), V_BASE / np.sqrt(3)), (current(time), I_PEAK / np.sqrt(2))):
        for turn in _TURN:
            columns += [abs(value) * size, np.angle(value * turn, deg=True)]
    cells = [
        [str(stamp), *(f"{cell:.10g}" for cell in row)]
        for stamp, row in zip(stamps, np.stack(columns, 1), strict=True)
    ]
    rows = [",".join(row) for row in cells]
    return written(folder, "pmu3.csv", "\n".join([",".join(names), *rows, ""]))


_SEVEN = "t|va|vb|vc|ia|ib|ic"
_NUMBERED = "t=1,va=2[kV],vb=3[kV],vc=4[kV],ia=5[kA],ib=6[kA],ic=7[kA]"
_KILO = (1e-3, 1e-3)
_ZEIT = (
    "Zeit [s]|Spannung L1 [V]|Spannung L2 [V]|Spannung L3 [V]|Strom L1 [A]|Strom L2 [A]|Strom L3 "
    "[A]"
)
_TEMPS = (
    "temps (s)|tension a (V)|tension b (V)|tension c (V)|courant a (A)|courant b (A)|courant c (A)"
)
_TIEMPO = (
    "tiempo (s)|tension a (V)|tension b (V)|tension c (V)|corriente a (A)|corriente b "
    "(A)|corriente c (A)"
)
MAKES = (
    Made("PSCAD .out with .inf", pscad_inf),
    Made("PSCAD, two files of a run", pscad_two_files),
    Made("PSCAD, one of two named", pscad_one_named),
    Made("PSCAD by its .inf", pscad_by_inf),
    Made("PSCAD with .infx", pscad_infx),
    Made("PSCAD in a zip", packed(pscad_two_files, "zip")),
    Made("PowerFactory EMT", power_factory),
    Made("PowerFactory RMS", power_factory_rms, ()),
    Made("MTB", mtb, ()),
    Made("DyCoV", dycov, ()),
    Made("DyCoV with a base", dycov),
    Made("PMU, one phase", pmu),
    Made("PMU, three phases and the time of day", three_phasors),
    Made("PMU, VM and VA", lambda folder: pmu(folder, "t|VM|VA|IM|IA|F"), (*BASE,)),
    Made("EMTP and ATP", emtp, (*BASE, "--unit", "si")),
    Made("Simulink scope", simulink_structure),
    Made("names of ours", table(_SEVEN), (*BASE, "--unit", "si")),
    Made("names of ours, base", table(_SEVEN)),
    Made("kV and kA", table("Time (s)|Va (kV)|Vb (kV)|Vc (kV)|Ia (kA)|Ib (kA)|Ic (kA)", _KILO)),
    Made("U1 [V]", table("t [s]|U1 [V]|U2 [V]|U3 [V]|I1 [A]|I2 [A]|I3 [A]")),
    Made("Ia(kA)", table("time|Ua(kV)|Ub(kV)|Uc(kV)|Ia(kA)|Ib(kA)|Ic(kA)", _KILO)),
    Made("units of --channels", table("a|b|c|d|e|f|g", _KILO), (*BASE, "--channels", _NUMBERED)),
    Made("German", table(_ZEIT, mark=";", comma=True)),
    Made("French", table(_TEMPS, mark=";", comma=True)),
    Made("Spanish", table(_TIEMPO, mark=";", comma=True)),
    Made(
        "Chinese",
        table("时间(s)|A相电压(V)|B相电压(V)|C相电压(V)|A相电流(A)|B相电流(A)|C相电流(A)"),
    ),
    Made("ms", in_unit_of_time("t [ms]", 1e3)),
    Made("microseconds", in_unit_of_time("Time_us", 1e6)),
    Made(
        "seconds of a clock",
        lambda folder: _later(in_unit_of_time("t [s]", 1.0)(folder)),
        digits=1e-4,
    ),
    Made("a line of units", line_of_units),
    Made("voltages between the phases", between_phases),
    Made("csv.gz", packed(table(_SEVEN), "gz")),
    Made("csv.xz", packed(table(_SEVEN), "xz")),
    Made("zip", packed(table(_SEVEN), "zip")),
    Made("tabs", table(_SEVEN, file="record.txt", mark="\t")),
    Made("a start-up, cut", started_up, ("--from", "0.2"), 1e-6),
)
#: Wrong on purpose -> what must be said of it.
WRONG = (
    (Made("two phases of voltage swapped", table("t|vb|va|vc|ia|ib|ic")), "turn the wrong way"),
    (Made("kV taken as V", table(_SEVEN, _KILO)), "kV in place of V"),
    (Made("kA taken as A", table(_SEVEN, (1.0, 1e-3))), "kA in place of A"),
    (
        Made("a base a thousand times too large", table(_SEVEN), ("--base", "10GVA,20kV")),
        "kA in place of A",
    ),
    (Made("half a file", gapped), "is the file cut off"),
    (
        Made("voltages and currents in other units", table("t|va [V]|vb [V]|vc [V]|ia|ib|ic")),
        "must have a unit",
    ),
    (Made("a start-up", started_up, ()), "add --from 0.1"),
    (
        Made("volts without a base", table("t|va [V]|vb [V]|vc [V]|ia [A]|ib [A]|ic [A]"), ()),
        "add --base",
    ),
    (
        Made("another nominal frequency", table(_SEVEN), ("--base", "10MVA,20kV", "--f0-hz", "50")),
        "must turn at about f0_hz",
    ),
)


def _later(files: list[Path]) -> list[Path]:
    """Times as a clock counts them, from the first of 2026 in seconds."""
    head, *rows = files[0].read_text().splitlines()
    cells = [row.split(",", 1) for row in rows]
    files[0].write_text(
        "\n".join([head, *(f"{1767225600 + float(time):.4f},{rest}" for time, rest in cells), ""])
    )
    return files
