"""Recordings and sweeps as further programs, instruments and languages write them, and what a
sentence must say where something is missing or wrong.
"""

import json
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from collecting import each_of

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement.importing.doubts.transformer_ratio import transformer_doubts
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.read_events import read_events

TIME = np.arange(0.0, 0.4, 2e-4)
BASE_V = 20e3 * np.sqrt(2 / 3)
BASE_I = 2.5e6 / (1.5 * BASE_V)
DIP = np.where((TIME > 0.1) & (TIME < 0.25), 0.7, 1.0)
POWER = 1.0 + 0.3j
SAID = {"base": "2.5MVA,20kV", "f0_hz": 50.0}


def phases(values: np.ndarray) -> np.ndarray:
    """(3, n) of a dq signal at 50 Hz."""
    turns = np.exp(1j * (2 * np.pi * 50 * TIME - 2 * np.pi / 3 * np.arange(3)[:, None]))
    return np.real(values * turns)


def recorded(folder: Path, names: str, order=(0, 1, 2), i_factor: float = 1.0, above: str = ""):
    """A file with a dip, the currents in another order of phases and times a factor."""
    v = BASE_V * phases(DIP)
    i = i_factor * BASE_I * phases(np.conj(POWER) / DIP * DIP)[[*order]]
    rows = [",".join(f"{x:.6f}" for x in row) for row in np.column_stack([TIME, *v, *i]).tolist()]
    (folder / "dip.csv").write_text("\n".join([above + names, *rows]) + "\n")
    return folder / "dip.csv"


@each_of(
    "names",
    [
        "t,va_V,vb_V,vc_V,ia_A,ib_A,ic_A",
        "time_s,Va_V,Vb_V,Vc_V,Ia_A,Ib_A,Ic_A",
        "Time [s],U_L1_V,U_L2_V,U_L3_V,I_L1_A,I_L2_A,I_L3_A",
        "t_s,vPCCa_V,vPCCb_V,vPCCc_V,iPCCa_A,iPCCb_A,iPCCc_A",
    ],
)
def test_units_behind_an_underscore_are_those_of_voltages_and_currents(tmp_path, names):
    record = read_events(recorded(tmp_path, names), **SAID)["dip"]
    assert (record.rest.p, record.rest.q) == pytest.approx((1.0, 0.3), abs=1e-3)


def test_currents_of_a_secondary_side_are_remarked_with_the_option_that_multiplies_them(tmp_path):
    names = "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    (said,) = contradictions(read_events(recorded(tmp_path, names, i_factor=0.01), **SAID))
    assert "secondary side" in said
    assert "--ratio i=" in said
    assert contradictions(read_events(recorded(tmp_path, names, i_factor=0.2), **SAID)) == ()


def test_voltages_of_a_secondary_side_are_refused_with_the_option(tmp_path):
    path = recorded(tmp_path, "t,va [mV],vb [mV],vc [mV],ia [A],ib [A],ic [A]")
    with pytest.raises(SweepError, match='ratio="v='):
        read_events(path, **SAID)


@each_of("order, first", [((2, 0, 1), "ib, ic, ia"), ((1, 2, 0), "")])
def test_currents_of_other_phases_are_told_from_a_current_that_counts_in(tmp_path, order, first):
    """At p = 1, q = 0.3 the current lags 17 degrees: by a third of a turn either way it is at 103
    or 137 degrees, which the third of a turn brings back.
    """
    names = "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    (said,) = contradictions(read_events(recorded(tmp_path, names, order), **SAID))
    assert "not in the order of those of the voltage (17 degrees once" in said
    assert first in said
    assert "--channels" in said


def test_the_order_that_the_sentence_names_puts_the_phases_right(tmp_path):
    names = "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    for order in ((2, 0, 1), (1, 2, 0)):
        path = recorded(tmp_path, names, order)
        (said,) = contradictions(read_events(path, **SAID))
        taken = said.split("degrees once ")[1].split(" are taken")[0].split(", ")
        place = {"ia": 5, "ib": 6, "ic": 7}
        channels = ",".join(f"{role}={place[one]}" for role, one in zip(place, taken, strict=True))
        record = read_events(path, channels=channels, **SAID)["dip"]
        assert (record.rest.p, record.rest.q) == pytest.approx((1.0, 0.3), abs=1e-3)


@each_of(
    "comment, letter",
    [
        ("CH1-CH3 differential probe 1000:1, CH4-CH6 current clamp 10 mV/A", "v"),
        ("CH1-CH3 differential probe 1000:1 CH4-CH6 current clamp 10 mV/A", "v"),
        ("CH4 Stromzange 1000:1 Wandler, CH1 Spannung direkt", "i"),
        ("HV probe 2000:1; Rogowski coils on CH4-CH6", "v"),
        ("current transformer, ratio 1000/5", "i"),
    ],
)
def test_a_ratio_belongs_to_what_its_own_words_measure(comment, letter):
    assert [one.letter for one in transformer_doubts([comment])] == [letter]


ENTRIES = {"dd": (0, 0), "dq": (0, 1), "qd": (1, 0), "qq": (1, 1)}
SWEEP = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
FREQUENCY = np.array(SWEEP.points[0].frequency)
Z_BASE = 690.0**2 / 2.75e6
ADMITTANCE = np.array(SWEEP.points[0].admittance) / Z_BASE
IMPEDANCE = -np.linalg.inv(ADMITTANCE)
OUT = {"f0_hz": 60.0, "current": "out", "q_axis": "leads", "power_node": "capacitor"}
IN = {**OUT, "current": "in"}
BASE = {"base": "2.75MVA,690V"}
REST = {"p": 1.0, "q": 0.3}


def scan(above: str = "", matrix: np.ndarray = ADMITTANCE, unit: str = "S", mark: str = ",") -> str:
    """A table of real and imaginary parts below some lines."""
    names = [f"Y{e}_{part} [{unit}]" for e in ENTRIES for part in ("re", "im")]
    values = np.ascontiguousarray(matrix).reshape(-1, 4).view(float)
    rows = [mark.join(f"{x:.9g}" for x in (f, *v)) for f, v in zip(FREQUENCY, values, strict=True)]
    return "\n".join([above + mark.join(["freq_hz", *names]), *rows]) + "\n"


def imported(folder: Path, text: str, name: str = "scan.csv", **said: object):
    (folder / name).write_text(text, encoding="utf-8")
    return import_files([folder / name], **said)


def error(sweep, point: int = 0) -> float:
    """Largest part of |Y| that a sweep is off the truth."""
    truth = np.array(SWEEP.points[point].admittance)
    found = np.array(sweep.points[point].admittance)
    return float(np.abs(found - truth).max() / np.abs(truth).max())


@each_of(
    "words, states",
    [
        ("Device;WR 2,75 MVA\nBemessungsspannung;690 V\n", "2.75MVA,690V"),
        ("# Rated power: 2750 kVA\n# Rated voltage: 690 V\n", "2.75MVA,690V"),
        ("# Sn = 2.75 MVA, Un = 0.69 kV\n", "2.75MVA,690V"),
        ("Essai : onduleur 2.75 MVA / 690 V\n", "2.75MVA,690V"),
        ("# Nennscheinleistung: 2750 kVA\n# Nennspannung: 690 V\n", "2.75MVA,690V"),
        ("# Puissance nominale : 2750 kVA, tension nominale : 690 V\n", "2.75MVA,690V"),
        ("# WTG 2.75 MVA scan\n", "2.75MVA"),
    ],
)
def test_a_base_that_is_said_otherwise_than_a_rating_in_words_is_remarked(tmp_path, words, states):
    text = scan(words, mark=";" if ";" in words else ",")
    said = imported(tmp_path, text, base="3MVA,400V", **OUT, **REST)
    shown = [one for one in said.remarks if one.startswith("base: ")]
    assert shown == [f"base: 3MVA,400V as said, while {tmp_path / 'scan.csv'} states {states}"]
    agreed = imported(tmp_path, text, **BASE, **OUT, **REST)
    assert [one for one in agreed.remarks if one.startswith("base: ")] == []


def test_a_rating_of_another_device_is_no_base(tmp_path):
    for words in ("# Trafo 3.15 MVA / 690 V\n", "# grid: 100 MVA\n", "# 2 MVA and 3 MVA units\n"):
        said = imported(tmp_path, scan(words), **BASE, **OUT, **REST)
        assert [one for one in said.remarks if one.startswith("base: ")] == []


def test_the_question_for_a_base_proposes_the_rating_of_the_words(tmp_path):
    text = scan("# onduleur 2.75 MVA / 690 V\n")
    assert "--base 2.75MVA,690V" in imported(tmp_path, text, **OUT, **REST).asked
    called = imported(tmp_path, scan("# base: 2.75 MVA, 690 V\n"), **OUT, **REST)
    assert error(called.answered()) < 1e-6


def test_the_base_of_a_recording_that_its_comments_say_otherwise_is_remarked(tmp_path):
    path = recorded(
        tmp_path, "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]", above="# Sn = 3 MVA, Un = 20 kV\n"
    )
    remarks = read_events(path, **SAID)["dip"].remarks
    assert "base: 2.5MVA,20kV as said, while its words state 3MVA,20kV" in remarks


def of_entry(head: str, rows: str, end: str = "", change=lambda z: z) -> dict[str, str]:
    """A file for each entry of the impedance, current in. rows : the form of a row with f, re, im,
    mag, deg, k.
    """
    files = {}
    for entry, place in ENTRIES.items():
        lines = [
            rows.format(
                k=k, f=f, re=z.real, im=z.imag, nim=-z.imag, mag=abs(z), deg=np.degrees(np.angle(z))
            )
            for k, (f, z) in enumerate(zip(FREQUENCY, change(IMPEDANCE)[:, *place], strict=True))
        ]
        files[f"scan_Z{entry}"] = head.format(entry=entry) + "\n".join([*lines, end])
    return files


GAMRY = (
    "EXPLAIN\nTAG\tEISPOT\nTITLE\tLABEL\tEIS Z{entry}\tTest Identifier\n"
    "FREQINIT\tQUANT\t5.0E+003\tInitial Freq. (Hz)\nZCURVE\tTABLE\n"
    "\tPt\tTime\tFreq\tZreal\tZimag\tZsig\tZmod\tZphz\tIdc\tVdc\tIERange\n"
    "\t#\ts\tHz\tohm\tohm\tV\tohm\t°\tA\tV\t#\n"
)
SPECTROSCOPY = {
    "Gamry": (GAMRY, "\t{k}\t{k}\t{f:.9g}\t{re:.9g}\t{im:.9g}\t1\t{mag:.9g}\t{deg:.9g}\t0\t0\t9"),
    "ZPlot": (
        "ZPLOT2 ASCII\n  Data Points: 16\n  End Comments\n"
        "Freq(Hz)\tAmpl\tBias\tTime(Sec)\tZ'(a)\tZ''(b)\tGD\tErr\tRange\n",
        "{f:.9g}\t0.01\t0\t{k}\t{re:.9g}\t{im:.9g}\t0\t0\t3",
    ),
    "NOVA": (
        "Index;Frequency (Hz);Z' (Ω);-Z'' (Ω);Z (Ω);-Phase (°);Time (s)\n",
        "{k};{f:.9g};{re:.9g};{nim:.9g};{mag:.9g};0;{k}",
    ),
    "EC-Lab": (
        "freq/Hz\tRe(Z)/Ohm\t-Im(Z)/Ohm\t|Z|/Ohm\tPhase(Z)/deg\ttime/s\n",
        "{f:.9g}\t{re:.9g}\t{nim:.9g}\t{mag:.9g}\t{deg:.9g}\t{k}",
    ),
    "Hioki": ("No.,FREQ[Hz],Z[ohm],PHASE[deg]\n", "{k},{f:.9g},{mag:.9g},{deg:.9g}"),
    "Keysight": (
        "!Format,AC\nFrequency(Hz), |Z|(Ohm), θz(deg)\n",
        "{f:.9g},{mag:.9g},{deg:.9g}",
    ),
    "R and X": ("f [Hz];R [Ohm];X [Ohm]\n", "{f:.9g};{re:.9g};{im:.9g}"),
    "Zahner": (
        "Number      Frequency/Hz    Impedance/Ohm       Phase/deg\n",
        "{k}   {f:.9g}   {mag:.9g}  {deg:.9g}",
    ),
    "French": (
        "Fréquence (Hz);Module (Ω);Déphasage (°)\n",
        "{f:.9g};{mag:.9g};{deg:.9g}",
    ),
    "German": (
        "Frequenz in Hz;Widerstand in Ohm;Reaktanz in Ohm\n",
        "{f:.9g};{re:.9g};{im:.9g}",
    ),
}


@each_of("make", SPECTROSCOPY)
def test_files_of_impedance_spectroscopy_with_one_entry_each_are_read(tmp_path, make):
    head, rows = SPECTROSCOPY[make]
    paths = []
    for name, text in of_entry(head, rows).items():
        paths.append(tmp_path / f"{name}.txt")
        paths[-1].write_text(text, encoding="utf-8")
    read = import_files(paths, **BASE, **IN, **REST, unit="ohm")
    assert error(read.answered()) < 1e-6


def test_files_of_entries_whose_columns_are_not_known_are_asked_for_by_them(tmp_path):
    paths = []
    for name, text in of_entry("aa,bb,cc\n", "{f:.9g},{re:.9g},{im:.9g}").items():
        paths.append(tmp_path / f"{name}.csv")
        paths[-1].write_text(text)
    with pytest.raises(SweepError, match=r"one entry each.*aa, bb, cc.*--map freq=#1") as raised:
        import_files(paths, **BASE, **IN, **REST)
    assert "Z=#2+j#3" in str(raised.value)
    read = import_files(paths, ["freq=#1[Hz],Z=#2[ohm]+j#3[ohm]"], **BASE, **IN, **REST)
    assert error(read.answered()) < 1e-6


def labview(folder: Path) -> str:
    units = "\t".join(["dB", "deg"] * 4)
    names = "\t".join(f"Y{e} magnitude\tY{e} phase" for e in ENTRIES)
    lines = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        "***End_of_Header***\t",
        "\t",
        "Channels\t8",
        f"Y_Unit_Label\t{units}",
        "X_Dimension\tFrequency",
        "***End_of_Header***\t",
        f"X_Value\t{names}\tComment",
    ]
    for f, y in zip(FREQUENCY, ADMITTANCE.reshape(-1, 4), strict=True):
        cells = [f"{f:.9g}"]
        for one in y:
            cells += [f"{20 * np.log10(abs(one)):.9g}", f"{np.degrees(np.angle(one)):.9g}"]
        lines.append("\t".join(cells))
    return "\n".join(lines) + "\n"


def blocks(folder: Path) -> str:
    text = "% dq admittance scan, Sbase 2.75 MVA, Vbase 690 V (LL rms), 60 Hz\n"
    for k, q in enumerate((0.825, -0.825)):
        y = np.array(SWEEP.points[k].admittance) / Z_BASE
        table = scan(matrix=y, mark=" ").replace("freq_hz", "f(Hz)").replace(" [S]", "")
        text += f"% Case {k + 1}: P = 2.75 MW, Q = {q} Mvar\n{table}\n"
    return text


def rows_and_columns(folder: Path) -> str:
    text = "case,P_MW,Q_Mvar,f_Hz,row,col,G_S,B_S\n"
    for k, q in enumerate((0.825, -0.825)):
        y = np.array(SWEEP.points[k].admittance) / Z_BASE
        for f, matrix in zip(FREQUENCY, y, strict=True):
            for i, j in ENTRIES.values():
                one = matrix[i, j]
                text += f"C{k},2.75,{q},{f:.9g},{i + 1},{j + 1},{one.real:.9g},{one.imag:.9g}\n"
    return text


def nested(folder: Path) -> str:
    entries = {
        name: {"re": ADMITTANCE[:, *at].real.tolist(), "im": ADMITTANCE[:, *at].imag.tolist()}
        for name, at in ENTRIES.items()
    }
    sweep = {"freq_hz": FREQUENCY.tolist(), "Y": entries}
    return json.dumps({"device": "inverter", "sweep": sweep, "P_W": 2.75e6, "Q_var": 0.825e6})


def rscad(folder: Path) -> str:
    names = ",".join(f"Y{e.upper()}_MAG,Y{e.upper()}_PHS" for e in ENTRIES)
    units = ",".join(["S,Degrees"] * 4)
    lines = [f"FREQ,{names}", f"Hz,{units}"]
    for f, y in zip(FREQUENCY, ADMITTANCE.reshape(-1, 4), strict=True):
        cells = [f"{abs(one):.9g},{np.degrees(np.angle(one)):.9g}" for one in y]
        lines.append(",".join([f"{f:.9g}", *cells]))
    return "\n".join(lines) + "\n"


LAYOUTS = {
    "scan.lvm": (labview, {**REST, "unit": "S"}, 1),
    "blocks.txt": (blocks, {"unit": "S"}, 2),
    "long.csv": (rows_and_columns, {}, 2),
    "scan.json": (nested, {"unit": "S"}, 1),
    "rscad.csv": (rscad, REST, 1),
}


@each_of("name", LAYOUTS)
def test_further_layouts_become_the_sweep_that_they_were_written_from(tmp_path, name):
    write, said, count = LAYOUTS[name]
    read = imported(tmp_path, write(tmp_path), name, **{**BASE, **OUT, **said}).answered()
    assert len(read.points) == count
    assert [read.points[k].op.q for k in range(count)] == pytest.approx([0.3, -0.3][:count])
    assert max(error(read, k) for k in range(count)) < 1e-6


def test_p_and_q_in_one_cell_of_a_workbook_are_both_read(tmp_path):
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Operating point", "P = 2750 kW, Q = 825 kvar"])
    sheet.append(["freq [Hz]", *(f"Y{e} {part} [S]" for e in ENTRIES for part in ("re", "im"))])
    for f, y in zip(FREQUENCY, np.ascontiguousarray(ADMITTANCE).reshape(-1, 4), strict=True):
        sheet.append([float(f), *map(float, y.view(float))])
    book.save(tmp_path / "scan.xlsx")
    point = import_files([tmp_path / "scan.xlsx"], **BASE, **OUT).answered().points[0].op
    assert (point.p, point.q) == pytest.approx((1.0, 0.3))


TURN = np.array([[1, 1j], [1, -1j]]) / np.sqrt(2)
POSITIVE_SCANS = {
    "PowerFactory": (
        '"Sweep";"PCC";"PCC"\n"b:fnow in Hz";"m:R1 in Ohm";"m:X1 in Ohm"\n',
        "{f:.9g};{re:.9g};{im:.9g}\n",
    ),
    "PowerFactory, magnitude": (
        "b:fnow in Hz;m:Z1 in Ohm;m:phiz1 in deg\n",
        "{f:.9g};{mag:.9g};{deg:.9g}\n",
    ),
    "PSCAD": (
        "   Harmonic Impedance Results\n   Freq(Hz)      Z+(ohms)        Ph+(deg)\n",
        " {f:.9g}  {mag:.9g}  {deg:.9g}\n",
    ),
}


@each_of("make", POSITIVE_SCANS)
def test_impedances_of_the_positive_sequence_of_planning_programs_are_read_as_such(tmp_path, make):
    """Z1 at the frequency in the network, f + f0, current in; what lacks is said."""
    head, row = POSITIVE_SCANS[make]
    z = 1 / (TURN @ -ADMITTANCE @ np.linalg.inv(TURN))[:, 0, 0]
    rows = [
        row.format(f=f + 60, re=one.real, im=one.imag, mag=abs(one), deg=np.degrees(np.angle(one)))
        for f, one in zip(FREQUENCY, z, strict=True)
    ]
    read = imported(tmp_path, head + "".join(rows), "fsweep.csv", f0_hz=60.0, **BASE, **REST)
    assert any("the positive sequence alone was measured" in one for one in read.remarks)
    point = read.answered().points[0]
    found = (TURN @ np.array(point.admittance) @ np.linalg.inv(TURN))[:, 0, 0]
    places = [int(np.argmin(abs(FREQUENCY - f))) for f in point.frequency]
    assert found == pytest.approx(-Z_BASE / z[places], rel=1e-5)


def test_a_magnitude_and_a_phase_that_are_exchanged_are_named(tmp_path):
    swapped = rscad(tmp_path).splitlines()
    for k in range(2, len(swapped)):
        cells = swapped[k].split(",")
        cells[3], cells[4] = cells[4], cells[3]
        swapped[k] = ",".join(cells)
    with pytest.raises(SweepError, match="probably exchanged") as raised:
        imported(tmp_path, "\n".join(swapped) + "\n", **BASE, **OUT, **REST)
    said = str(raised.value).split("--map ")[1].rstrip(".")
    read = import_files([tmp_path / "scan.csv"], [said], **BASE, **OUT, **REST)
    assert error(read.answered()) < 1e-6


def test_a_base_that_was_said_is_not_asked_for_again(tmp_path):
    text = rscad(tmp_path).replace("S,Degrees", ",Degrees")
    asked = imported(tmp_path, text, **BASE, **OUT, **REST).asked
    assert "--unit S" in asked
    assert "--base" not in asked


def test_an_entry_that_is_mapped_is_not_left_out_for_a_positive_sequence(tmp_path):
    head, row = POSITIVE_SCANS["PSCAD"]
    text = head + "".join(row.format(f=f, mag=1.0, deg=80.0) for f in FREQUENCY)
    (tmp_path / "scan.txt").write_text(text)
    with pytest.raises(SweepError, match="Ydq was not found"):
        import_files([tmp_path / "scan.txt"], ["Ydd=#2@#3[deg]"], f0_hz=60.0, **BASE, **REST)


def parts(first: str, second: str) -> list[str]:
    return [form.format(e) for e in ENTRIES for form in (first, second)]


def answers(form: str) -> list[str]:
    """Columns of the d and q current that a voltage causes."""
    return [f"{part}({form.format(*e)}) [S]" for e in ENTRIES for part in ("Re", "Im")]


NAMES = {
    "Italian": ("Frequenza (Hz)", parts("Modulo Y{0} (S)", "Fase Y{0} (gradi)"), "polar"),
    "Dutch": ("Frequentie [Hz]", parts("Yreëel_{0} [S]", "Yimaginair_{0} [S]"), ""),
    "Portuguese": (
        "Frequência (Hz)",
        parts("Parte real Y{0} (S)", "Parte imaginária Y{0} (S)"),
        "",
    ),
    "Japanese": ("周波数[Hz]", parts("Y{0}_実部[S]", "Y{0}_虚部[S]"), ""),
    "Danish": ("Frekvens [Hz]", parts("Re Y{0} [S]", "Im Y{0} [S]"), ""),
    "parts behind the letter": ("freq_hz", parts("Yreal_{0} [S]", "Yimag_{0} [S]"), ""),
    "conductance": ("f_Hz", parts("G{0}_S", "B{0}_S"), ""),
    "answers": ("f", answers("i{0}/v{1}"), ""),
    "answers, u": ("f", answers("I_{0}/U_{1}"), ""),
    "phase shift": ("f", parts("|Y{0}| [S]", "Phasenverschiebung Y{0} [°]"), "polar"),
}


@each_of("name", NAMES)
def test_names_of_further_languages_and_programs_are_read(tmp_path, name):
    first, names, form = NAMES[name]
    lines = [";".join([first, *names])]
    for f, y in zip(FREQUENCY, ADMITTANCE.reshape(-1, 4), strict=True):
        pairs = [
            (abs(one), np.degrees(np.angle(one))) if form else (one.real, one.imag) for one in y
        ]
        lines.append(";".join(f"{x:.9g}" for x in (f, *(x for pair in pairs for x in pair))))
    read = imported(tmp_path, "\n".join(lines) + "\n", **BASE, **OUT, **REST)
    assert error(read.answered()) < 1e-6


RECORDINGS = {
    "Italian": "Tempo (s);Tensione L1 (V);Tensione L2 (V);Tensione L3 (V);"
    "Corrente L1 (A);Corrente L2 (A);Corrente L3 (A)",
    "Portuguese": "Tempo [s];Tensão A [V];Tensão B [V];Tensão C [V];"
    "Corrente A [A];Corrente B [A];Corrente C [A]",
    "Japanese": "時間[s];電圧U[V];電圧V[V];電圧W[V];電流U[A];電流V[A];電流W[A]",
    "Dutch": "Tijd [s];Spanning L1 [V];Spanning L2 [V];Spanning L3 [V];"
    "Stroom L1 [A];Stroom L2 [A];Stroom L3 [A]",
    "R, S, T": "t;uR_V;uS_V;uT_V;iR_A;iS_A;iT_A",
    "HYPERSIM": "time;PCC_V_a(V);PCC_V_b(V);PCC_V_c(V);PCC_I_a(A);PCC_I_b(A);PCC_I_c(A)",
}


@each_of("name", RECORDINGS)
def test_recordings_of_further_languages_and_programs_are_read(tmp_path, name):
    path = recorded(tmp_path, RECORDINGS[name].replace(";", ","))
    record = read_events(path, **SAID)["dip"]
    assert (record.rest.p, record.rest.q) == pytest.approx((1.0, 0.3), abs=1e-3)


def test_recordings_of_labview_are_read(tmp_path):
    path = recorded(tmp_path, "X_Value,Ua,Ub,Uc,Ia,Ib,Ic,Comment")
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t6\n"
        "Y_Unit_Label\tV\tV\tV\tA\tA\tA\nX_Dimension\tTime\n***End_of_Header***\t\n"
    )
    (tmp_path / "dip.lvm").write_text(head + path.read_text().replace(",", "\t"))
    (record,) = read_events(tmp_path / "dip.lvm", **SAID).records
    assert (record.rest.p, record.rest.q) == pytest.approx((1.0, 0.3), abs=1e-3)
