"""Files of one sweep as scan tools, laboratories and colleagues write them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrid.measurement.conventions.conversions import TO_SEQUENCE
from ibrid.measurement.sweeps.sweep import Sweep

S_BASE, V_BASE = 10e3, 400.0
Z_BASE = V_BASE**2 / S_BASE
NAMES = ("dd", "dq", "qd", "qq")
MIRROR = np.diag([1.0, -1.0])


@dataclass(frozen=True)
class Foreign:
    """A make of file.

    `write` : (sweep, folder) -> the files. `options` : what `ibrid import` is told beside them.
    `digits` : relative error that the digits of the file allow.
    """

    make: str
    write: Callable[[Sweep, Path], list[Path]]
    options: tuple[str, ...] = ()
    digits: float = 1e-9


def _flat(point) -> np.ndarray:
    return point.admittance.reshape(-1, 4)


def _text(folder: Path, name: str, lines: list[str], encoding: str = "utf-8") -> list[Path]:
    path = folder / name
    path.write_bytes("\n".join([*lines, ""]).encode(encoding))
    return [path]


def german_semicolons(sweep: Sweep, folder: Path) -> list[Path]:
    """Semicolons, decimal commas, CP1252, kHz, a trailing separator."""
    comma = lambda value: f"{value:.12g}".replace(".", ",")  # noqa: E731
    head = "Arbeitspunkt;Wirkleistung [kW];Blindleistung [kvar];Frequenz [kHz];" + ";".join(
        f"Y{entry} Realteil [S];Y{entry} Imagteil [S]" for entry in NAMES
    )
    lines = ["Prüfstand 3;Messung vom 4. März", "Sn = 10 kVA; Un = 400 V; fn = 60 Hz", head]
    for number, point in enumerate(sweep.points, 1):
        for frequency, row in zip(point.frequency, _flat(point) / Z_BASE, strict=True):
            cells = [
                f"AP{number}",
                comma(point.op.p * 10),
                comma(point.op.q * 10),
                comma(frequency / 1e3),
            ]
            lines.append(
                ";".join(
                    [*cells, *(comma(part) for value in row for part in (value.real, value.imag))]
                )
                + ";"
            )
    return _text(folder, "messung.csv", lines, "cp1252")


def magnitude_and_phase(sweep: Sweep, folder: Path) -> list[Path]:
    """dB and degrees of impedances in ohm, a file for each operating point, p and q in its name."""
    files = []
    for point in sweep.points:
        impedance = np.linalg.inv(-point.admittance).reshape(-1, 4) * Z_BASE
        lines = ["Frequency (Hz)\t" + "\t".join(f"|Z{e}| (dB)\t∠Z{e} (deg)" for e in NAMES)]
        for frequency, row in zip(point.frequency, impedance, strict=True):
            cells = [
                f"{part:.12g}"
                for z in row
                for part in (20 * np.log10(abs(z)), np.degrees(np.angle(z)))
            ]
            lines.append("\t".join([f"{frequency:.12g}", *cells]))
        files += _text(folder, f"scan_P{point.op.p:g}_Q{point.op.q:g}.txt", lines)
    return files


def complex_text(sweep: Sweep, folder: Path) -> list[Path]:
    """Complex numbers as text, rad/s, rows of P and Q in watts."""
    lines = ["w,P (W),Q (var),Y11 (S),Y12 (S),Y21 (S),Y22 (S)"]
    for point in sweep.points:
        for frequency, row in zip(point.frequency, _flat(point) / Z_BASE, strict=True):
            cells = [f"{z.real:.12g}{z.imag:+.12g}i" for z in row]
            lines.append(
                ",".join(
                    [
                        f"{2 * np.pi * frequency:.14g}",
                        f"{point.op.p * S_BASE:g}",
                        f"{point.op.q * S_BASE:g}",
                        *cells,
                    ]
                )
            )
    return _text(folder, "matlab_export.csv", lines)


def numpy_savetxt(sweep: Sweep, folder: Path) -> list[Path]:
    """numpy.savetxt with a header: a comment mark in front of the names, blanks between."""
    lines = ["# case freq_hz p q " + " ".join(f"Y{e}_re Y{e}_im" for e in NAMES)]
    for number, point in enumerate(sweep.points):
        for frequency, row in zip(point.frequency, _flat(point), strict=True):
            values = [
                number,
                frequency,
                point.op.p,
                point.op.q,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append(" ".join(f"{value:.18e}" for value in values))
    return _text(folder, "scan.txt", lines)


def units_below_names(sweep: Sweep, folder: Path) -> list[Path]:
    """An instrument's file: preamble, names, a line of units, percent signs."""
    lines = [
        "% Frequency response analyser 2.1",
        "% Rated power [kVA]: 10",
        "% Rated voltage [V]: 400",
        "% f0: 60 Hz",
        "",
    ]
    lines += [
        "f,P,Q," + ",".join(f"Re(Y{e}),Im(Y{e})" for e in NAMES),
        "Hz,kW,kvar," + ",".join(["mS"] * 8),
    ]
    for point in sweep.points:
        for frequency, row in zip(point.frequency, _flat(point) / Z_BASE * 1e3, strict=True):
            values = [
                frequency,
                point.op.p * 10,
                point.op.q * 10,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append(",".join(f"{value:.12g}" for value in values))
    return _text(folder, "analyser.csv", lines)


def tidy_rows(sweep: Sweep, folder: Path) -> list[Path]:
    """A row for each entry, as data frames are kept."""
    lines = ["scenario,frequency,p,q,entry,real,imag"]
    for number, point in enumerate(sweep.points):
        for frequency, row in zip(point.frequency, _flat(point), strict=True):
            for entry, z in zip(NAMES, row, strict=True):
                lines.append(
                    f"s{number},{frequency:.12g},{point.op.p},{point.op.q},{entry},{z.real:.12g},{z.imag:.12g}"
                )
    return _text(folder, "tidy_admittance.csv", lines)


def file_per_entry(sweep: Sweep, folder: Path) -> list[Path]:
    """A network analyser's file for each entry: magnitude in ohm and phase."""
    files = []
    for k, point in enumerate(sweep.points[:1]):
        impedance = np.linalg.inv(-point.admittance).reshape(-1, 4) * Z_BASE
        for entry, column in zip(NAMES, impedance.T, strict=True):
            lines = ["Frequency (Hz), Magnitude (ohm), Phase (deg)"]
            lines += [
                f"{f:.12g}, {abs(z):.12g}, {np.degrees(np.angle(z)):.12g}"
                for f, z in zip(point.frequency, column, strict=True)
            ]
            files += _text(folder, f"run{k}_Z{entry}.csv", lines)
    return files


def other_base(sweep: Sweep, folder: Path) -> list[Path]:
    """Per unit on 100 MVA and 33 kV, though the inverter has 10 kVA and 400 V."""
    ratio = (33e3**2 / 100e6) / Z_BASE
    lines = ["f_dq (Hz);P;Q;" + ";".join(f"{part}Y{e}" for e in NAMES for part in ("Re", "Im"))]
    for point in sweep.points:
        for frequency, row in zip(point.frequency, _flat(point) * ratio, strict=True):
            scale = S_BASE / 100e6
            values = [
                frequency,
                point.op.p * scale,
                point.op.q * scale,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append(";".join(f"{value:.14g}" for value in values))
    return _text(folder, "system_base.csv", lines)


def sequences(sweep: Sweep, folder: Path) -> list[Path]:
    """Modified sequences with coupling, kV/kA."""
    lines = ["f_dq,P_pu,Q_pu," + ",".join(f"Y{e}_re,Y{e}_im" for e in ("pp", "pn", "np", "nn"))]
    for point in sweep.points:
        sequence = (TO_SEQUENCE @ point.admittance @ TO_SEQUENCE.conj().T).reshape(-1, 4)
        for frequency, row in zip(point.frequency, sequence, strict=True):
            values = [
                frequency,
                point.op.p,
                point.op.q,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append(",".join(f"{value:.14g}" for value in values))
    return _text(folder, "sequence.csv", lines)


def current_in_lagging(sweep: Sweep, folder: Path) -> list[Path]:
    """PSCAD's habits: the current into the device, q behind d; resistances and reactances."""
    lines = ["f\tP\tQ\t" + "\t".join(f"R{e}\tX{e}" for e in NAMES)]
    for point in sweep.points:
        impedance = np.linalg.inv(MIRROR @ -point.admittance @ MIRROR).reshape(-1, 4) * Z_BASE
        for frequency, row in zip(point.frequency, impedance, strict=True):
            values = [
                frequency,
                point.op.p,
                point.op.q,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append("\t".join(f"{value:.14g}" for value in values))
    return _text(folder, "pscad_scan.dat", lines)


def no_names(sweep: Sweep, folder: Path) -> list[Path]:
    """Numbers alone."""
    lines = []
    for point in sweep.points:
        for frequency, row in zip(point.frequency, _flat(point), strict=True):
            values = [
                frequency,
                point.op.p,
                point.op.q,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append(" ".join(f"{value:.14g}" for value in values))
    return _text(folder, "numbers.dat", lines)


def strange_names(sweep: Sweep, folder: Path) -> list[Path]:
    """Names that nobody can guess; repeated runs without a number."""
    lines = ["tone_k,load_kw,load_kvar," + ",".join(f"ch{k}a,ch{k}b" for k in range(4))]
    for point in sweep.points:
        for frequency, row in zip(point.frequency, _flat(point) / Z_BASE, strict=True):
            values = [
                frequency / 1e3,
                point.op.p * 10,
                point.op.q * 10,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines += [",".join(f"{value:.14g}" for value in values)] * 3
    return _text(folder, "daq.csv", lines)


def workbook(sweep: Sweep, folder: Path) -> list[Path]:
    """A sheet for each operating point, its p, q and bases above the table."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.worksheets[0])
    for point in sweep.points:
        sheet = book.create_sheet(f"P{point.op.p:g} Q{point.op.q:g}")
        for row in (["Impedance scan"], ["Sn = 10 kVA", "Un = 400 V"], ["f0 = 60 Hz"], []):
            sheet.append(row)
        sheet.append(["f (Hz)", *(f"{part} Z{e} (ohm)" for e in NAMES for part in ("Re", "Im"))])
        impedance = np.linalg.inv(-point.admittance).reshape(-1, 4) * Z_BASE
        for frequency, row in zip(point.frequency, impedance, strict=True):
            sheet.append(
                [float(frequency), *(float(part) for z in row for part in (z.real, z.imag))]
            )
    path = folder / "scan.xlsx"
    book.save(path)
    return [path]


def parquet(sweep: Sweep, folder: Path) -> list[Path]:
    """A data frame saved by pandas."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    columns: dict[str, list] = {
        name: []
        for name in (
            "op",
            "p",
            "q",
            "freq_hz",
            *(f"Y{e}_{part}" for e in NAMES for part in ("re", "im")),
        )
    }
    for point in sweep.points:
        for frequency, row in zip(point.frequency, _flat(point), strict=True):
            values = [
                point.op.name,
                point.op.p,
                point.op.q,
                frequency,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            for name, value in zip(columns, values, strict=True):
                columns[name].append(value)
    path = folder / "frame.parquet"
    pq.write_table(pa.table(columns), path)
    return [path]


def mat_struct(sweep: Sweep, folder: Path) -> list[Path]:
    """A structure in a MAT file: frequencies, 2x2xK, and numbers beside it."""
    from scipy.io import savemat

    files = []
    for k, point in enumerate(sweep.points):
        path = folder / f"result{k}.mat"
        scan = {
            "freq": point.frequency,
            "Ydq": np.moveaxis(point.admittance, 0, -1) / Z_BASE,
            "P": point.op.p,
            "Q": point.op.q,
        }
        savemat(path, {"scan": scan, "Sbase": S_BASE, "Vbase": V_BASE, "f0": 60.0})
        files.append(path)
    return files


def hdf5(sweep: Sweep, folder: Path) -> list[Path]:
    """HDF5 of a Python script, a group for the measurement."""
    import h5py

    files = []
    for k, point in enumerate(sweep.points):
        path = folder / f"op{k}.h5"
        with h5py.File(path, "w") as file:
            group = file.create_group("measurement")
            group["omega"] = 2 * np.pi * point.frequency
            group["Y"] = point.admittance
            group["p"], group["q"] = point.op.p, point.op.q
        files.append(path)
    return files


def matlab_73(sweep: Sweep, folder: Path) -> list[Path]:
    """MATLAB 7.3: HDF5 with 512 bytes in front, arrays transposed, complex numbers as pairs."""
    import h5py

    files = []
    for k, point in enumerate(sweep.points):
        path = folder / f"new{k}.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            matrix = np.moveaxis(point.admittance, 0, -1)  # 2x2xK as MATLAB sees it
            pairs = np.empty(matrix.T.shape, dtype=[("real", "f8"), ("imag", "f8")])
            pairs["real"], pairs["imag"] = np.real(matrix.T), np.imag(matrix.T)
            for name, value in (
                ("w", 2 * np.pi * point.frequency[:, None]),
                ("Y", pairs),
                ("P", np.array([[point.op.p]])),
                ("Q", np.array([[point.op.q]])),
            ):
                file[name] = value
                file[name].attrs["MATLAB_class"] = np.bytes_("double")
        files.append(path)
    return files


def quoted_fortran(sweep: Sweep, folder: Path) -> list[Path]:
    """Quotes around names, Fortran exponents, empty cells, a row at 0 Hz and comments at the
    end.
    """
    lines = [
        '"Freq","P","Q",'
        + ",".join(f'"Y_{e[0]}_{e[1]}_real","Y_{e[0]}_{e[1]}_imag"' for e in NAMES)
    ]
    for point in sweep.points:
        lines.append(",".join(["0.0", str(point.op.p), str(point.op.q), *["1.0"] * 8]))
        for frequency, row in zip(point.frequency, _flat(point), strict=True):
            values = [
                frequency,
                point.op.p,
                point.op.q,
                *(part for z in row for part in (z.real, z.imag)),
            ]
            lines.append(",".join(f"{value:.14E}".replace("E", "D") for value in values))
        lines.append(
            ",".join([f"{point.frequency[-1] * 2:g}", str(point.op.p), str(point.op.q), *[""] * 8])
        )
    return _text(folder, "fortran.csv", [*lines, "# end of file"])


def angles_in_text(sweep: Sweep, folder: Path) -> list[Path]:
    """Polar numbers as text, decimal commas, voltages in volts."""
    lines = ["f/Hz;P/kW;Q/kvar;U/V;" + ";".join(f"Z{e}/Ω" for e in NAMES)]
    for point in sweep.points:
        impedance = np.linalg.inv(-point.admittance).reshape(-1, 4) * Z_BASE
        for frequency, row in zip(point.frequency, impedance, strict=True):
            polar = [f"{abs(z):.13g}∠{np.degrees(np.angle(z)):.13g}°" for z in row]
            cells = [
                f"{frequency:.12g}",
                f"{point.op.p * 10:g}",
                f"{point.op.q * 10:g}",
                f"{point.op.v * 400:g}",
                *polar,
            ]
            lines.append(";".join(cells).replace(".", ","))
    return _text(folder, "polar.csv", lines)


def ztool(sweep: Sweep, folder: Path) -> list[Path]:
    """What Z-tool writes: kA/kV into the block, q behind d."""
    files = []
    for point in sweep.points[:1]:
        scanned = (MIRROR @ -point.admittance @ MIRROR).reshape(-1, 4) / Z_BASE
        lines = ["f PCC-1_d PCC-1_q"]
        lines += [
            " ".join([f"({f:.14g}+0j)", *(f"({z.real:.14g}{z.imag:+.14g}j)" for z in row)])
            for f, row in zip(point.frequency, scanned, strict=True)
        ]
        files += _text(folder, "scan#Y_AC#PCC-1#.txt", lines)
    return files


def _records(sweep: Sweep, scale: float = 1.0):
    """(number of the point, P kW, Q kvar, Hz, the four entries) of every row."""
    for number, point in enumerate(sweep.points, 1):
        for frequency, row in zip(point.frequency, _flat(point) * scale, strict=True):
            yield number, point.op.p * 10, point.op.q * 10, frequency, row


def _parts(row: np.ndarray) -> list[float]:
    return [part for value in row for part in (value.real, value.imag)]


def _polar(row: np.ndarray) -> list[float]:
    return [part for value in row for part in (abs(value), np.degrees(np.angle(value)))]


def chinese_columns(sweep: Sweep, folder: Path) -> list[Path]:
    """Names of columns in Chinese, UTF-8 with its mark."""
    lines = [
        "工况,有功功率(kW),无功功率(kvar),频率(Hz),"
        + ",".join(f"Y{e}实部(S),Y{e}虚部(S)" for e in NAMES)
    ]
    for number, p, q, frequency, row in _records(sweep, 1 / Z_BASE):
        lines.append(
            f"工况{number},"
            + ",".join(f"{value:.12g}" for value in (p, q, frequency, *_parts(row)))
        )
    return _text(folder, "扫频.csv", lines, "utf-8-sig")


def gb2312_decibels(sweep: Sweep, folder: Path) -> list[Path]:
    """The same language as a Chinese Windows writes it: magnitude in dB, phase, a file for each
    operating point.
    """
    files = []
    for point in sweep.points:
        lines = ["频率/Hz\t" + "\t".join(f"Z{e}幅值/dB\tZ{e}相角/°" for e in NAMES)]
        for frequency, row in zip(
            point.frequency, np.linalg.inv(-point.admittance).reshape(-1, 4), strict=True
        ):
            polar = [(20 * np.log10(abs(z) * Z_BASE), np.degrees(np.angle(z))) for z in row]
            lines.append(
                "\t".join(
                    f"{value:.12g}"
                    for value in (frequency, *(part for pair in polar for part in pair))
                )
            )
        files += _text(
            folder, f"P={point.op.p * 10:g}kW_Q={point.op.q * 10:g}kvar.txt", lines, "gb2312"
        )
    return files


def french_columns(sweep: Sweep, folder: Path) -> list[Path]:
    """Accents in Latin-1, decimal commas, tabs."""
    parts = "\t".join(f"Partie réelle Y{e} [mS]\tPartie imaginaire Y{e} [mS]" for e in NAMES)
    lines = ["Fréquence [Hz]\tPuissance active [kW]\tPuissance réactive [kvar]\t" + parts]
    for _, p, q, frequency, row in _records(sweep, 1e3 / Z_BASE):
        lines.append(
            "\t".join(f"{value:.12g}" for value in (frequency, p, q, *_parts(row))).replace(
                ".", ","
            )
        )
    return _text(folder, "essai.tsv", lines, "latin-1")


def fixed_width_comments(sweep: Sweep, folder: Path) -> list[Path]:
    """Columns of one width behind comments, several numbers in one of them."""
    files = []
    for k, point in enumerate(sweep.points):
        lines = [
            "! Date: 2026-03-04 12:33:01",
            f"! Pmeas = {point.op.p * 10:g} kW   Qmeas = {point.op.q * 10:g} kvar",
        ]
        lines.append("!  Freq[Hz]  " + "  ".join(f"|Y{e}|[S]  arg(Y{e})[deg]" for e in NAMES))
        for frequency, row in zip(point.frequency, _flat(point) / Z_BASE, strict=True):
            lines.append("".join(f"{value:22.12E}" for value in (frequency, *_polar(row))))
        files += _text(folder, f"scan_{k}.out", lines)
    return files


def two_rows_of_names(sweep: Sweep, folder: Path) -> list[Path]:
    """A workbook whose entries stand above Re and Im."""
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.append(
        [
            "Load case",
            "P [kW]",
            "Q [kvar]",
            "f [Hz]",
            *(cell for e in NAMES for cell in (f"Y{e} [S]", None)),
        ]
    )
    sheet.append([None] * 4 + ["Re", "Im"] * 4)
    for number, p, q, frequency, row in _records(sweep, 1 / Z_BASE):
        sheet.append([f"full, case {number}", p, q, float(frequency), *map(float, _parts(row))])
    book.save(folder / "results.xlsx")
    return [folder / "results.xlsx"]


def sheet_per_entry(sweep: Sweep, folder: Path) -> list[Path]:
    """A workbook for each operating point, its p and q in the name, with a sheet for each entry."""
    import openpyxl

    files = []
    for point in sweep.points:
        book = openpyxl.Workbook()
        book.remove(book.worksheets[0])
        for entry, column in zip(NAMES, _flat(point).T / Z_BASE, strict=True):
            sheet = book.create_sheet(f"Y{entry}")
            sheet.append(["Frequency [Hz]", "Magnitude [S]", "Phase [deg]"])
            for frequency, value in zip(point.frequency, column, strict=True):
                sheet.append(
                    [float(frequency), float(abs(value)), float(np.degrees(np.angle(value)))]
                )
        files.append(folder / f"P{point.op.p * 10:g}kW_Q{point.op.q * 10:g}kvar.xlsx")
        book.save(files[-1])
    return files


def mat_with_watts(sweep: Sweep, folder: Path) -> list[Path]:
    """Vectors in a MAT file, P and Q in watts beside them."""
    from scipy.io import savemat

    files = []
    for k, point in enumerate(sweep.points):
        entries = {
            f"Y{e}": column for e, column in zip(NAMES, _flat(point).T / Z_BASE, strict=True)
        }
        files.append(folder / f"OP{k}.mat")
        powers = {"P": point.op.p * S_BASE, "Q": point.op.q * S_BASE}
        savemat(
            files[-1],
            {"f": point.frequency, **entries, **powers, "Sn": S_BASE, "Un": V_BASE, "fn": 60.0},
        )
    return files


def mat_structure_array(sweep: Sweep, folder: Path) -> list[Path]:
    """results(1), results(2): an operating point each; the base beside them."""
    from scipy.io import savemat

    results = np.zeros(
        len(sweep.points),
        dtype=[("freq", "O"), ("Y", "O"), ("P0", "O"), ("Q0", "O"), ("name", "O")],
    )
    for k, point in enumerate(sweep.points):
        matrices = np.moveaxis(point.admittance, 0, -1)
        results[k] = (point.frequency[:, None], matrices, point.op.p, point.op.q, f"case{k}")
    savemat(folder / "results.mat", {"results": results, "fn": 60.0})
    return [folder / "results.mat"]


def network_sequences(sweep: Sweep, folder: Path) -> list[Path]:
    """Sequences with coupling at the frequency of the network, as the name of the column says;
    dB.
    """
    lines = [
        "f_network_Hz,P [kW],Q [kvar],"
        + ",".join(f"Y{e} [dB],Y{e} [deg]" for e in ("pp", "pn", "np", "nn"))
    ]
    for point in sweep.points:
        sequence = (TO_SEQUENCE @ point.admittance @ TO_SEQUENCE.conj().T).reshape(-1, 4) / Z_BASE
        for frequency, row in zip(point.frequency, sequence, strict=True):
            polar = [part for z in row for part in (20 * np.log10(abs(z)), np.degrees(np.angle(z)))]
            values = (frequency + 60, point.op.p * 10, point.op.q * 10, *polar)
            lines.append(",".join(f"{value:.13g}" for value in values))
    return _text(folder, "seq.csv", lines)


def fixed_decimals(separator: str) -> Callable[[Sweep, Path], list[Path]]:
    """Decimal commas in every cell, so that commas part as many numbers as semicolons do."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        names = [f"{part} Y{e} [mS]" for e in NAMES for part in ("Re", "Im")]
        lines = [separator.join(["P [kW]", "Q [kvar]", "Frequenz [Hz]", *names])]
        for _, p, q, frequency, row in _records(sweep, 1e3 / Z_BASE):
            cells = [f"{value:.9f}".replace(".", ",") for value in (p, q, frequency, *_parts(row))]
            lines.append(separator.join(cells))
        return _text(folder, "fest.csv", lines)

    return write


def spaced_complex(sweep: Sweep, folder: Path) -> list[Path]:
    """Complex numbers with blanks around the sign, between tabs."""
    lines = ["f (kHz)\tP (kW)\tQ (kvar)\t" + "\t".join(f"Y_{e} (S)" for e in NAMES)]
    for _, p, q, frequency, row in _records(sweep, 1 / Z_BASE):
        entries = [f"{z.real:.12e} {'+-'[int(z.imag < 0)]} {abs(z.imag):.12e}i" for z in row]
        lines.append("\t".join([f"{frequency / 1e3:.12g}", f"{p:g}", f"{q:g}", *entries]))
    return _text(folder, "colleague.txt", lines)


def thousands(sweep: Sweep, folder: Path) -> list[Path]:
    """Quoted cells with commas between thousands."""
    lines = [
        "Frequency (Hz),P (W),Q (var)," + ",".join(f"Re(Y{e}) (S),Im(Y{e}) (S)" for e in NAMES)
    ]
    for _, p, q, frequency, row in _records(sweep, 1 / Z_BASE):
        lines.append(
            ",".join(f'"{value:,.14f}"' for value in (frequency, p * 1e3, q * 1e3, *_parts(row)))
        )
    return _text(folder, "excel.csv", lines)


def npz_arrays(sweep: Sweep, folder: Path) -> list[Path]:
    """Arrays that numpy saved."""
    point = sweep.points[0]
    np.savez(folder / "scan.npz", f=point.frequency, Y=point.admittance, P=point.op.p, Q=point.op.q)
    return [folder / "scan.npz"]


def json_records(sweep: Sweep, folder: Path) -> list[Path]:
    """A list of records."""
    import json

    names = [f"Y{e}_{part}" for e in NAMES for part in ("re", "im")]
    rows = [
        {
            "freq": float(frequency),
            "p": p / 10,
            "q": q / 10,
            **dict(zip(names, map(float, _parts(row)), strict=True)),
        }
        for _, p, q, frequency, row in _records(sweep)
    ]
    (folder / "scan.json").write_text(json.dumps(rows))
    return [folder / "scan.json"]


def json_lists(sweep: Sweep, folder: Path) -> list[Path]:
    """Lists by name, p and q beside them."""
    import json

    point = sweep.points[0]
    held = {"f_hz": point.frequency.tolist(), "P": point.op.p, "Q": point.op.q}
    for entry, column in zip(NAMES, _flat(point).T, strict=True):
        held |= {f"Y{entry}_re": column.real.tolist(), f"Y{entry}_im": column.imag.tolist()}
    (folder / "scan.json").write_text(json.dumps(held))
    return [folder / "scan.json"]


_SI = ("--base", "10kVA,400V", "--f0-hz", "60")
_OUT, _IN = ("--current", "out", "--q-axis", "leads"), ("--current", "in", "--q-axis", "leads")
_FOUR = ",".join(f"Y{entry}=ch{k}a+jch{k}b" for k, entry in enumerate(NAMES))
_NUMBERED = ",".join(f"Y{entry}=#{2 * k + 4}+j#{2 * k + 5}" for k, entry in enumerate(NAMES))
MAKES = (
    Foreign("german semicolons", german_semicolons, _OUT),
    Foreign("magnitude and phase", magnitude_and_phase, ("--unit", "ohm", *_SI, *_IN)),
    Foreign("complex text", complex_text, (*_SI, *_OUT)),
    Foreign("numpy.savetxt", numpy_savetxt, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("units below names", units_below_names, _OUT),
    Foreign("tidy rows", tidy_rows, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("a file per entry", file_per_entry, (*_SI, *_IN, "--p", "1", "--q", "0.3")),
    Foreign("another base", other_base, ("--unit", "pu:100MVA,33kV", *_SI, *_OUT)),
    Foreign("sequences", sequences, ("--unit", "pu", "--f0-hz", "60", "--current", "out")),
    Foreign(
        "into the device, q lags",
        current_in_lagging,
        ("--unit", "ohm", *_SI, "--current", "in", "--q-axis", "lags"),
    ),
    Foreign(
        "no names",
        no_names,
        ("--map", f"freq=#1,p=#2,q=#3,{_NUMBERED}", "--unit", "pu", "--f0-hz", "60", *_OUT),
    ),
    Foreign(
        "strange names",
        strange_names,
        ("--map", f"freq=tone_k[kHz],p=load_kw,q=load_kvar,{_FOUR}", "--unit", "S", *_SI, *_OUT),
    ),
    Foreign("workbook", workbook, _IN),
    Foreign("Parquet", parquet, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("MAT structure", mat_struct, ("--unit", "S", *_OUT)),
    Foreign("HDF5", hdf5, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("MATLAB 7.3", matlab_73, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("Fortran numbers", quoted_fortran, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("Z-tool", ztool, (*_SI, "--p", "1", "--q", "0.3", "--op", "full")),
    Foreign("polar text", angles_in_text, (*_SI, *_IN)),
    Foreign("Chinese columns", chinese_columns, (*_SI, *_OUT)),
    Foreign("GB2312", gb2312_decibels, ("--unit", "ohm", *_SI, *_IN)),
    Foreign("French columns", french_columns, (*_SI, *_OUT)),
    Foreign("fixed width", fixed_width_comments, (*_SI, *_OUT)),
    Foreign(
        "fixed width, mapped", fixed_width_comments, (*_SI, *_OUT, "--map", "p=Pmeas[kW],q=Qmeas")
    ),
    Foreign("two rows of names", two_rows_of_names, (*_SI, *_OUT)),
    Foreign("a sheet per entry", sheet_per_entry, (*_SI, *_OUT)),
    Foreign("MAT with watts", mat_with_watts, ("--unit", "S", *_OUT, "--map", "p=P[W],q=Q[W]")),
    Foreign("MAT structure array", mat_structure_array, ("--unit", "pu", *_OUT)),
    Foreign("network sequences", network_sequences, ("--unit", "S", *_SI, "--current", "out")),
    Foreign("fixed decimals", fixed_decimals(";"), (*_SI, *_OUT), 1e-6),
    Foreign("fixed decimals, blanks", fixed_decimals(" ; "), (*_SI, *_OUT), 1e-6),
    Foreign("spaced complex", spaced_complex, (*_SI, *_OUT)),
    Foreign("thousands", thousands, (*_SI, *_OUT)),
    Foreign("NPZ", npz_arrays, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("JSON records", json_records, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
    Foreign("JSON lists", json_lists, ("--unit", "pu", "--f0-hz", "60", *_OUT)),
)
