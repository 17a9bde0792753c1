"""Files of one recording as EMT programs, RMS programs, recorders and colleagues write them; the law behind is a closed form."""

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
    """A make of file. `write` : folder -> the files that are named. `options` : what `ibrid import` is told. `digits` : per unit,
    how far samples may be from the law. `rate` : samples per s."""

    make: str
    write: Callable[[Path], list[Path]]
    options: tuple[str, ...] = BASE
    digits: float = 1e-6


def voltage(time: np.ndarray) -> np.ndarray:
    """(n,) complex, d + j q per unit at an angle of 13 degrees: a dip to a half with edges of a raised cosine."""
    fall = np.clip((time - DIP) / EDGE, 0, 1) - np.clip((time - BACK) / EDGE, 0, 1)
    return (1 - 0.25 * (1 - np.cos(np.pi * fall))) * np.exp(1j * np.deg2rad(13))


def current(time: np.ndarray) -> np.ndarray:
    """(n,) complex per unit, out: it answers the dip with 10 ms."""
    answer = 1 - np.exp(-np.clip(time - DIP, 0, None) / 0.01) - (1 - np.exp(-np.clip(time - BACK, 0, None) / 0.01))
    return (P - 1j * Q + (0.2 - 0.5j) * answer) * np.exp(1j * np.deg2rad(13))


def times(rate: float = 5000.0) -> np.ndarray:
    return np.arange(round(END * rate) + 1) / rate


def phases(value: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(3, n) instantaneous values of a, b, c, peak."""
    return np.real(value * np.exp(2j * np.pi * F0 * time) * _TURN[:, None])


def six(rate: float = 5000.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and (6, n) voltages and currents of the phases in V and A."""
    time = times(rate)
    return time, np.concatenate([V_PEAK * phases(voltage(time), time), I_PEAK * phases(current(time), time)])


def text(
    names: list[str], columns: list[np.ndarray], mark: str = ",", above: tuple[str, ...] = (), comma: bool = False
) -> str:
    rows = [mark.join(f"{cell:.10g}" for cell in row) for row in np.stack(columns, axis=1).tolist()]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    return "\n".join([*above, *([mark.join(names)] if names else []), *rows, ""])


def written(folder: Path, name: str, content: str | bytes, encoding: str = "utf-8") -> list[Path]:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return [path]


def table(names: str, scale: tuple[float, float] = (1.0, 1.0), *, file: str = "record.csv", **how) -> Callable:
    """A table of the six phases under names of its own, parted by |."""

    def write(folder: Path) -> list[Path]:
        time, values = six()
        values = np.concatenate([values[:3] * scale[0], values[3:] * scale[1]])
        return written(folder, file, text(names.split("|"), [time, *values], **how))

    return write


def _pscad(folder: Path, described: Callable[[Path, list[tuple[str, str]]], None], parts: int) -> list[Path]:
    """PSCAD's text: time and ten channels a file, without names; `described` writes what they are."""
    time, values = six()
    scaled = np.concatenate([values[:3] / 1e3, values[3:] / 1e3])
    fill = [np.full(len(time), 7.0 + k) for k in range(12)]
    columns = [*fill[:6], *scaled[:3], *fill[6:9], *scaled[3:], *fill[9:]] if parts == 2 else list(scaled)
    named = [("V:1", "kV"), ("V:2", "kV"), ("V:3", "kV"), ("I:1", "kA"), ("I:2", "kA"), ("I:3", "kA")]
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
    written(folder, "run.infx", "\n".join(['<?xml version="1.0"?>', "<List>", *rows, "</List>", ""]))


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
    names = ["b:tnow in s", *(f"m:u{p} in kV" for p in "ABC"), *(f"m:i{p}:bus1 in kA" for p in "ABC")]
    above = ("All calculations," + ",".join(["Bus PCC"] * 3 + ["Cub_1"] * 3),)
    return written(folder, "pf.csv", text(names, [time, *(values / 1e3)], above=above))


def power_factory_rms(folder: Path) -> list[Path]:
    """PowerFactory's RMS results of a test bench: positive sequence, per unit."""
    time = times(1000)
    v, i = voltage(time), current(time)
    s = v * np.conj(i)
    names = ["Time in s", "s:vpoc_pu", "s:ppoc_pu", "s:qpoc_pu"]
    above = (";".join(["All calculations", "meas", "meas", "meas"]),)
    return written(folder, "pf_rms.csv", text(names, [time, abs(v), s.real, s.imag], ";", above, comma=True))


def mtb(folder: Path) -> list[Path]:
    """Names of a model test bench: active and reactive current of the positive sequence, per unit."""
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
    return written(folder, "mtb.csv", text(names, [time, abs(v), own.real, -own.imag, s.real, s.imag], ";"))


def dycov(folder: Path) -> list[Path]:
    time = times(1000)
    v, i = voltage(time), current(time)
    own = i * np.conj(v) / abs(v)
    s = v * np.conj(i)
    bus = "BusPDR_BUS_"
    names = [
        "time",
        *(bus + n for n in ("Voltage", "ActivePower", "ReactivePower", "ActiveCurrent", "ReactiveCurrent")),
    ]
    return written(folder, "rms.csv", text(names, [time, abs(v), s.real, s.imag, own.real, -own.imag], ";"))


def pmu(folder: Path, names: str = "Time (s)|VA_mag (V)|VA_ang (deg)|IA_mag (A)|IA_ang (deg)|Freq (Hz)") -> list[Path]:
    time = times(250)
    v, i = voltage(time), current(time)
    columns = [abs(v) * V_BASE / np.sqrt(3), np.angle(v, deg=True), abs(i) * I_PEAK / np.sqrt(2), np.angle(i, deg=True)]
    return written(folder, "pmu.csv", text(names.split("|"), [time, *columns, np.full(len(time), F0)]))


def emtp(folder: Path) -> list[Path]:
    """Text of EMTP and ATP plots: blanks between, names of nodes."""
    time, values = six()
    names = ["Time", "v:PCCA", "v:PCCB", "v:PCCC", "c:PCCA -GRIDA", "c:PCCB -GRIDB", "c:PCCC -GRIDC"]
    return written(folder, "atp.csv", text(names, [time, *values], ","))


def simulink_structure(folder: Path) -> list[Path]:
    """A scope's structure with time: signals of three columns and labels."""
    from scipy.io import savemat

    time, values = six()
    signals = np.zeros((1, 2), dtype=[("values", object), ("dimensions", object), ("label", object)])
    signals[0, 0] = (values[:3].T, 3.0, "Vabc")
    signals[0, 1] = (values[3:].T, 3.0, "Iabc")
    savemat(folder / "scope.mat", {"ScopeData": {"time": time[:, None], "signals": signals, "blockName": "m/Scope"}})
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
