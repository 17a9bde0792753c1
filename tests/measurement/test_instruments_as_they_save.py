"""What analysers, recorders and scan tools save, in their own words, bundles and encodings."""

import gzip
import json
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from scipy.io import savemat

import ibrid
from ibrid import cli
from ibrid.errors import SweepError
from ibrid.measurement.formats.files import decoded
from ibrid.measurement.formats.touchstone import touchstone_response
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.numbers.number_format import NumberFormat
from ibrid.measurement.importing.shapes.entries_apart import entries_last
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.importing.timed import recording_files
from ibrid.measurement.importing.timed.recording_files import each_once, joined_channels
from ibrid.measurement.read_events import is_events_file, read_events

SWEEP = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
FREQUENCY = np.array(SWEEP.points[0].frequency)
ADMITTANCE = np.array(SWEEP.points[0].admittance)
SAID = {
    "unit": "pu",
    "f0_hz": 60.0,
    "current": "out",
    "q_axis": "leads",
    "voltage_axis": "d",
    "power_node": "capacitor",
    "p": 1.0,
    "q": 0.3,
}
ENTRIES = {"dd": (0, 0), "dq": (0, 1), "qd": (1, 0), "qq": (1, 1)}


def parts(matrix: np.ndarray) -> np.ndarray:
    """(K, 8) real and imaginary parts of the entries in their order."""
    return np.stack([matrix.reshape(-1, 4).real, matrix.reshape(-1, 4).imag], axis=-1).reshape(
        -1, 8
    )


def text_of(names: list[str], columns: np.ndarray, mark: str = ",") -> str:
    rows = [mark.join(f"{value:.12g}" for value in row) for row in columns.tolist()]
    return "\n".join([mark.join(names), *rows]) + "\n"


def require_admittance(paths: list[Path], *maps: str, **said: object) -> None:
    sweep = import_files(paths, maps, **{**SAID, **said}).answered()
    assert sweep.points[0].frequency == pytest.approx(FREQUENCY, rel=1e-9)
    assert sweep.points[0].admittance == pytest.approx(ADMITTANCE, rel=1e-6, abs=1e-9)


@each_of(
    "name",
    [
        "Frequency in dq [Hz]",
        "Frequency (dq) [Hz]",
        "dq frequency / Hz",
        "Frequency (dq frame) (Hz)",
        "dq-frame frequency in Hz",
        "f in dq [Hz]",
    ],
)
def test_a_frequency_that_is_called_that_in_dq_is_the_frequency(tmp_path, name):
    names = [name, *(f"Y{entry}_{part}" for entry in ENTRIES for part in ("re", "im"))]
    path = tmp_path / "scan.csv"
    path.write_text(text_of(names, np.column_stack([FREQUENCY, parts(ADMITTANCE)])))
    require_admittance([path])


@each_of("name", ["Frequency in dq [Hz]", "f_dq (Hz)"])
def test_sequences_at_a_frequency_called_that_in_dq_ask_nothing_more(tmp_path, name):
    turn = np.array([[1, 1j], [1, -1j]]) / np.sqrt(2)
    sequences = turn @ ADMITTANCE @ np.linalg.inv(turn)
    names = [name, *(f"Y{entry}_{part}" for entry in ("pp", "pn", "np", "nn") for part in "ri")]
    path = tmp_path / "scan.csv"
    path.write_text(text_of(names, np.column_stack([FREQUENCY, parts(sequences)])))
    require_admittance([path])


@each_of(
    "encoding, frequency, entry",
    [
        ("gb2312", "频率(Hz)", "Y{}{}部(标幺)|实|虚"),
        ("gbk", "扫描频率（Hz）", "Y{}（{}部）（标幺）|实|虚"),
        ("euc-kr", "주파수(Hz)", "Y{}_{}수|실|허"),
        ("cp949", "주파수 [Hz]", "어드미턴스 Y{} {}수부|실|허"),
        ("cp932", "周波数 [Hz]", "Y{}{}部|実|虚"),
        ("utf-8-sig", "주파수 (Hz)", "Y{} ({}부) [pu]|실|허"),
        ("cp1252", "Frequenz [Hz]", "Y{} {}teil|Real|Imaginär"),
        ("utf-8", "Fréquence (Hz)", "Y{} (partie {})|réelle|imaginaire"),
        ("latin-1", "Frecuencia (Hz)", "Parte {1} de Y{0}|real|imaginaria"),
    ],
)
def test_words_of_real_and_imaginary_part_in_other_languages(tmp_path, encoding, frequency, entry):
    form, *words = entry.split("|")
    names = [frequency, *(form.format(one, word) for one in ENTRIES for word in words)]
    path = tmp_path / "scan.csv"
    path.write_bytes(
        text_of(names, np.column_stack([FREQUENCY, parts(ADMITTANCE)])).encode(encoding)
    )
    require_admittance([path])


@each_of("words", ["Größe ändert", "répété", "hänge Wärme übertrage", "Ç1 ñandú, años"])
def test_words_of_europe_are_not_taken_for_those_of_asia(words):
    assert decoded(words.encode("cp1252")) == words


@each_of("kind", ["scan.tar", "scan.tar.gz", "scan.tgz", "scan.tar.xz"])
def test_a_tar_archive_is_read_as_a_zip_archive_is(tmp_path, kind):
    names = ["f_hz", *(f"Y{entry}_{part}" for entry in ENTRIES for part in ("re", "im"))]
    for name, factor in (("P80kW_Q10kvar", 1.0), ("P40kW_Q10kvar", 0.5)):
        table = np.column_stack([FREQUENCY, parts(ADMITTANCE * factor)])
        (tmp_path / f"{name}.csv").write_text(text_of(names, table))
    (tmp_path / "README.txt").write_text("Thanks, Ana")
    path = tmp_path / kind
    with tarfile.open(
        path, "w:" + {"tgz": "gz", "tar": ""}.get(kind.split(".")[-1], kind[9:])
    ) as to:
        for name in ("README.txt", "P80kW_Q10kvar.csv", "P40kW_Q10kvar.csv"):
            to.add(tmp_path / name, f"./scan/{name}")
    files = each_once([path])
    assert [file.name for file in files] == ["P80kW_Q10kvar.csv", "P40kW_Q10kvar.csv"]
    sweep = import_files(files, **{**SAID, "p": None, "q": None}, base="100kVA,400V").answered()
    assert [(point.op.p, point.op.q) for point in sweep.points] == [(0.8, 0.1), (0.4, 0.1)]
    assert sweep.points[0].admittance == pytest.approx(2 * sweep.points[1].admittance)
    require_admittance([files[0]])
    path.write_bytes(path.read_bytes()[: len(path.read_bytes()) // 3])
    with pytest.raises(SweepError, match=r"must be .*(cut off|cannot be read|No such|archive)"):
        each_once([path])


IMPEDANCE = np.linalg.inv(ADMITTANCE) * 1.6
OF_ANALYSER = {"unit": None, "base": "100kVA,400V"}


def analyser_files(folder: Path, called: str, names: str, form: str, above: str = "") -> list[Path]:
    """form : in which order the analyser writes f, Z, theta, R and X of an entry."""
    paths = []
    for entry, place in ENTRIES.items():
        values = IMPEDANCE[:, *place]
        held = {"f": FREQUENCY, "Z": np.abs(values), "theta": np.angle(values, deg=True)}
        held |= {"R": values.real, "X": values.imag}
        path = folder / called.format(entry)
        table = np.column_stack([held[name] for name in form.split()])
        path.write_text(above + text_of(names.split("; "), table))
        paths.append(path)
    return paths


NF = '"Frequency[Hz]"; "|Z|[ohm]"; "Theta[deg]"; "R[ohm]"; "X[ohm]"'


@each_of(
    "called, names, form",
    [
        ("Z{}_NF.csv", NF, "f Z theta R X"),
        ("{}_hioki.csv", "FREQUENCY[Hz]; Z[ohm]; PHASE[deg]; Rs[ohm]; X[ohm]", "f Z theta R X"),
        ("run1 Z{} (2).csv", "Frequency(Hz); |Z|(ohm)-data; theta-z(deg)-data", "f Z theta"),
        ("Z{}.csv", "Frequency(Hz); R(Ohm); X(Ohm); Theta(deg); |Z|(Ohm)", "f R X theta Z"),
    ],
)
def test_four_files_of_an_impedance_analyser_are_the_entries(tmp_path, called, names, form):
    require_admittance(analyser_files(tmp_path, called, names, form), **OF_ANALYSER)


def test_the_columns_of_four_files_are_named_by_map_whatever_their_names_say(tmp_path):
    paths = analyser_files(tmp_path, "Z{}_NF.csv", NF, "f Z theta R X")
    require_admittance(paths, "Z=#2@#3", **OF_ANALYSER)
    require_admittance(paths, "Z=#4+j#5", **OF_ANALYSER)


def test_resistance_and_reactance_that_are_not_those_of_magnitude_and_angle_are_refused(tmp_path):
    names = NF.replace("R[", "r[").replace("X[", "R[").replace("r[", "X[")
    paths = analyser_files(tmp_path, "Z{}_NF.csv", names, "f Z theta R X")
    with pytest.raises(SweepError, match=r"NF.csv line 2: R.* --map Z=#5\+j#4 or Z=#2@#3"):
        import_files(paths, **{**SAID, **OF_ANALYSER})


def test_a_fifth_file_beside_the_four_entries_is_said(tmp_path):
    paths = analyser_files(tmp_path, "Z{}_NF.csv", NF, "f Z theta R X")
    notes, point = tmp_path / "notes.txt", tmp_path / "op.csv"
    notes.write_text("Measured on Tuesday\nby Ana\n")
    point.write_text("P [kW],Q [kvar],T [C]\n100,30,21\n")
    said = {**SAID, **OF_ANALYSER, "p": None, "q": None}
    imported = import_files([*paths, notes, point], **said)
    operating_point = imported.answered().points[0].op
    assert (operating_point.p, operating_point.q) == pytest.approx((1.0, 0.3))
    assert any("notes.txt must hold rows of numbers" in remark for remark in imported.remarks)
    assert any("op.csv holds no entry of a matrix" in remark for remark in imported.remarks)
    with pytest.raises(SweepError, match=r"notes.txt must hold rows of numbers"):
        import_files([*paths[:3], notes], **said)


@each_of("is_complex", [True, False])
def test_traces_of_an_impedance_analyser_below_each_other_are_one_table(tmp_path, is_complex):
    """The 4294A writes each trace with its format above it, the second column zero where the
    format is a real number.
    """
    paths = []
    for entry, place in ENTRIES.items():
        z = IMPEDANCE[:, *place]
        first = z if is_complex else np.abs(z)
        blocks = []
        for trace, form, values in (("A", "|Z|", first), ("B", "theta", np.angle(z, deg=True))):
            table = np.column_stack([FREQUENCY, values.real, values.imag])
            names = ['"Frequency"', '"Real"', '"Imaginary"']
            blocks.append(
                f'"TRACE: {trace}"\n"FORMAT: {form}"\n\n{text_of(names, table, chr(9))}\n'
            )
        paths.append(tmp_path / f"Z{entry}.TXT")
        paths[-1].write_text('"4294A REV1.11"\n"DATE: Dec/01/2025"\n\n' + "".join(blocks))
    require_admittance(paths, **OF_ANALYSER)


def listed(values: np.ndarray) -> dict[str, list[float]]:
    return {"re": values.real.tolist(), "im": values.imag.tolist()}


BY_NAME = {
    "f_hz": FREQUENCY.tolist(),
    **{f"Z{entry}": listed(IMPEDANCE[:, *place]) for entry, place in ENTRIES.items()},
}
ROWS = [
    {
        "f_hz": f,
        **{
            f"Z{entry}": {"re": float(z[place].real), "im": float(z[place].imag)}
            for entry, place in ENTRIES.items()
        },
    }
    for f, z in zip(FREQUENCY.tolist(), IMPEDANCE, strict=True)
]
META = {
    "device": "a plant",
    "f_nom_hz": 60,
    "s_base_mva": 0.1,
    "v_base_kv": 0.4,
    "current_direction": "out of the inverter",
    "unit": "ohm",
}


@each_of("name, held", [("rows", ROWS), ("lists", BY_NAME)])
@each_of("of_point", [{"p_kw": 100, "q_kvar": 30}, {"operating_point": {"p": 1.0, "q": 0.3}}])
def test_data_in_json_have_what_stands_in_meta_beside_them(tmp_path, name, held, of_point):
    path = tmp_path / f"{name}.json"
    path.write_text(json.dumps({"meta": META | of_point, "data": held}))
    said = dict.fromkeys(("p", "q", "unit", "f0_hz", "current"))
    require_admittance([path], **said)


TIME = np.arange(0.0, 0.3, 2e-4)
TURNS = np.exp(1j * (2 * np.pi * 60 * TIME - 2 * np.pi / 3 * np.arange(3)[:, None]))
DIP = np.where(TIME > 0.15, 0.7, 1.0)
PEAK_V, PEAK_I = 400 * np.sqrt(2 / 3), 100e3 / 400 * np.sqrt(2 / 3)
VOLTAGES = PEAK_V * np.real(DIP * TURNS)
CURRENTS = PEAK_I * np.real((0.8 - 0.2j) * TURNS)
OF_RECORDER = {"base": "100kVA,400V", "f0_hz": 60.0, "current": "out"}


def require_recording(path: object, **said: object) -> None:
    record = read_events(path, **{**OF_RECORDER, **said}).records[0]
    assert record.rest.p == pytest.approx(0.8, abs=2e-3)
    assert record.rest.q == pytest.approx(0.2, abs=2e-3)
    assert np.abs(record.v[-1]).max() == pytest.approx(0.7, abs=2e-3)


@each_of("how", ["times of each", "rate alone", "structures"])
def test_channels_that_dewesoft_saves_for_matlab_are_a_recording(tmp_path, how):
    channels = dict(
        zip(["U_L1", "U_L2", "U_L3", "I_L1", "I_L2", "I_L3"], [*VOLTAGES, *CURRENTS], strict=True)
    )
    held: dict[str, object] = {"Sample_rate": 5000.0, "Start_time": "03-Dec-2025 10:00:00"}
    for name, values in channels.items():
        if how == "structures":
            held[name] = {"time": TIME[:, None], "data": values[:, None]}
            continue
        held[f"Data1_{name}"] = values[:, None]
        if how == "times of each":
            held[f"Data1_time_{name}"] = TIME[:, None]
    path = tmp_path / "test_0001.mat"
    savemat(path, held)
    assert is_events_file(path)
    require_recording(path)


def coefficients(count: int, den: object) -> dict[str, np.ndarray]:
    """Cells of Y = 1 / (0.1 s / omega_0 + r) on the diagonal, r = 0.01 and 0.02, and a gain of 0.3
    and -0.3 beside it.
    """
    cells = {"num": np.empty((count, count), object), "den": np.empty((count, count), object)}
    for row, column in np.ndindex(count, count):
        slow = [0.1 / (120 * np.pi), 0.01 * (row + 1)]
        cells["num"][row, column] = [[1.0]] if row == column else [[0.3 - 0.6 * (row > column)]]
        cells["den"][row, column] = [slow] if row == column or den else [[1.0]]
    return cells


@each_of("den", ["", "same length"])
@each_of("place", ["", "sys", "sys of objects"])
def test_transfer_functions_in_cells_are_sampled(tmp_path, den, place):
    cells = coefficients(2, den)
    if "objects" in place:
        cells = {"Numerator": cells["num"], "Denominator": cells["den"]}
    held = {**cells, "Ts": 0.0}
    savemat(tmp_path / "tfdata.mat", {"sys": held} if place else held)
    said = {**SAID, "quantity": None}
    imported = import_files([tmp_path / "tfdata.mat"], **said)
    (point,) = imported.answered().points
    s = 2j * np.pi * point.frequency
    slow = [0.1 / (120 * np.pi) * s + r for r in (0.01, 0.02)]
    assert point.admittance[:, 0, 0] == pytest.approx(1 / slow[0])
    assert point.admittance[:, 1, 1] == pytest.approx(1 / slow[1])
    beside = [1 / one if den else np.ones(len(s)) for one in slow]
    assert point.admittance[:, 0, 1] == pytest.approx(0.3 * beside[0])
    assert point.admittance[:, 1, 0] == pytest.approx(-0.3 * beside[1])
    assert any("poles from" in remark for remark in imported.remarks)


def test_transfer_functions_of_more_ports_name_the_line_of_matlab(tmp_path):
    savemat(tmp_path / "tfdata.mat", coefficients(3, ""))
    with pytest.raises(SweepError, match=r"cells of 2 x 2.*in MATLAB: .*sys\(1:2, 1:2\)"):
        import_files([tmp_path / "tfdata.mat"], **SAID)


@each_of("ending, word", [(".dxd", "Export, to Matlab"), (".trc", "ASCII"), (".pl4", "COMTRADE")])
def test_files_that_a_recorder_alone_reads_name_its_own_export(tmp_path, ending, word):
    path = tmp_path / f"test{ending}"
    path.write_bytes(b"\x01\0\2" * 50)
    with pytest.raises(SweepError, match=rf"must hold numbers as text; found a file of .*{word}"):
        import_files([path], **SAID)
    with pytest.raises(SweepError, match=word):
        read_events(path, **OF_RECORDER)


def scope_files(folder: Path, called: str, above: str, words: str) -> list[Path]:
    """called : the name of a file, with {n} its number and {name} that of its signal."""
    paths = []
    for n, values in enumerate([*VOLTAGES, *CURRENTS]):
        name = ["Va", "Vb", "Vc", "Ia", "Ib", "Ic"][n]
        path = folder / called.format(n=n + 1, name=name)
        rows = [f"{t:.7g},{x:.7g}" for t, x in zip(TIME - 0.15, values, strict=True)]
        unit = words.split("|")[n // 3] if words else ""
        path.write_text("\n".join([above.format(n=n + 1, unit=unit).strip("\n"), *rows]) + "\n")
        paths.append(path)
    return paths


LECROY = "LECROYWM31,31234,Waveform\nSegments,1,SegmentSize,1500\n"
LECROY += "Segment,TrigTime,TimeSinceSegment1\n#1,01-Dec-2025 14:03:22,0\nTime,Ampl\n"
TEKTRONIX = "Model,MSO58\nSample Interval,2e-4\nVertical Units,{unit}\n\nTIME,CH{n}\n"
NUMBERED = "va=2,vb=3,vc=4,ia=5,ib=6,ic=7"


@each_of(
    "called, above, words, channels",
    [
        ("C{n}--{name}--00004.csv", LECROY, "", None),
        ("dip_{name}_7.csv", LECROY, "", None),
        ("tek0003CH{n}.csv", TEKTRONIX, "V|A", NUMBERED),
        ("scope_3_{n}.csv", "x-axis,{n}\nsecond,{unit}\n", "Volt|Ampere", f"t=1,{NUMBERED}"),
    ],
)
def test_files_of_an_oscilloscope_with_a_channel_each_are_one_recording(
    tmp_path, capsys, called, above, words, channels
):
    paths = scope_files(tmp_path, called, above, words)
    require_recording(paths, channels=channels)
    told = ["--channels", channels] if channels else []
    said = ["--base", "100kVA,400V", "--f0-hz", "60", "--current", "out"]
    out = tmp_path / "out.csv"
    assert cli.main(["import", *map(str, paths), *told, *said, "--out", str(out)]) == 0
    assert "6 files with a channel each are one recording" in capsys.readouterr().err
    require_recording(out, base=None, f0_hz=None, current=None)


def test_channels_of_an_oscilloscope_at_other_times_are_no_recording(tmp_path):
    paths = scope_files(tmp_path, "C{n}--{name}--00004.csv", LECROY, "")
    paths[3].write_text(paths[3].read_text().replace("\n-0.15,", "\n-0.1501,"))
    with pytest.raises(SweepError, match="at the same times"):
        read_events(paths, **OF_RECORDER)


ADF = "dip60.pl4\n  t   v:POCA   v:POCB   v:POCC   c:INVA  -POCA   c:INVB  -POCB   c:INVC  -POCC\n"


@each_of(
    "above",
    [
        ADF,
        "dip60.pl4\n t v1 v2\n",
        "",
        "Time [s] CH1 CH2 CH3 CH4 CH5 CH6\n",
        "Time CH1 CH2 CH3 Current_R Current_S Current_T\n",
    ],
)
def test_text_of_atp_is_read_or_asks_with_an_answer_that_can_be_copied(tmp_path, above):
    table = np.column_stack([TIME, *VOLTAGES, *CURRENTS])
    rows = [" ".join(f"{value:16.8E}" for value in row) for row in table.tolist()]
    path = tmp_path / "dip60.adf"
    path.write_text(above + "\n".join(rows) + "\n")
    if above == ADF:
        require_recording(path)
        return
    with pytest.raises(SweepError, match='tell them: channels="') as asked:
        read_events(path, **OF_RECORDER)
    answer = str(asked.value).split('channels="')[1].split('"')[0]
    require_recording(path, channels=answer)


@each_of("name", ["angle_deg", "theta [deg]", "x (deg)"])
def test_an_angle_that_is_not_taken_is_offered_as_that_of_the_voltage(tmp_path, name):
    angle = np.where(TIME > 0.15, 20.0, 5.0)
    columns = np.column_stack([TIME, DIP, angle, 80 * DIP, 20 * DIP])
    path = tmp_path / "rms.csv"
    path.write_text(text_of(["t (s)", "u (pu)", name, "P (kW)", "Q (kvar)"], columns))
    without = read_events(path, **OF_RECORDER).records[0]
    (offered,) = [one for one in without.remarks if "--channels" in one]
    assert f"{name} is not used and may be the angle of the voltage" in offered
    told = offered.split("--channels ")[1]
    turned = read_events(path, channels=told, **OF_RECORDER).records[0]
    end = np.angle(complex(*turned.v[-1]), deg=True)
    assert end == pytest.approx(15.0, abs=0.1)
    assert not any("--channels" in one for one in turned.remarks)


@each_of("ohm", [1.6, 50.0])
def test_s_parameters_of_the_dq_ports_are_admittances_with_the_current_into_them(tmp_path, ohm):
    """Law: S = (1 - R Y)(1 + R Y)^-1 with Y into the port, 1.6 ohm being the base."""
    one, y = np.eye(2), -ADMITTANCE / 1.6 * ohm
    s = (one - y) @ np.linalg.inv(one + y)
    columns = np.column_stack([FREQUENCY, parts(np.swapaxes(s, 1, 2))])
    path = tmp_path / "inverter.s2p"
    path.write_text(f"# Hz S RI R {ohm}\n" + text_of(["! f"], columns, " "))
    said = {"unit": None, "current": None, "base": "100kVA,400V"}
    require_admittance([path], **said)
    remarks = import_files([path], **{**SAID, **said}).remarks
    assert f"S-parameters at {ohm:g} ohm became admittances, current into the ports" in remarks
    keys = {"s_base_va": 100e3, "v_base_v": 400.0, "f0_hz": 60.0, "p": 1.0, "q": 0.3}
    path.with_suffix(".y2p").write_bytes(path.read_bytes())
    with pytest.raises(SweepError, match="found S, call it"):
        import_files([path.with_suffix(".y2p")], **SAID)
    sweep = ibrid.read_sweep(path, q_axis="leads", power_node="capacitor", **keys)
    assert sweep.points[0].admittance == pytest.approx(ADMITTANCE, rel=1e-6, abs=1e-9)


@each_of(
    "encoding, names",
    [
        ("cp949", "시간(s)|{}상 전압(V)|{}상 전류(A)"),
        ("utf-8", "시간 [s]|전압 {}상 [V]|전류 {}상 [A]"),
        ("gbk", "时间(s)|{}相电压(V)|{}相电流(A)"),
        ("utf-8-sig", "时间（s）|电压{}相（V）|电流{}相（A）"),
        ("cp932", "時間[s]|{}相電圧[V]|{}相電流[A]"),
        ("utf-8", "Time|S1) VPOC{}|S1) IPOC{}"),
    ],
)
def test_channels_in_other_languages_and_of_rscad_are_known(tmp_path, encoding, names):
    time, *forms = names.split("|")
    head = [time, *(form.format(phase) for form in forms for phase in "ABC")]
    path = tmp_path / "record.csv"
    table = text_of(head, np.column_stack([TIME, *VOLTAGES, *CURRENTS]))
    path.write_bytes(table.encode(encoding))
    assert is_events_file(path)
    require_recording(path)


@each_of(
    "names",
    [
        "Time [s]|Vrms AN Avg|Vrms BN Avg|PowerP Total Avg|PowerQ Total Avg",
        "Time [s]|Vrms AN Med|Vrms BN Med|Active Power Total Med|Reactive Power Total Med",
        "시간(s)|AB선간전압(V)|BC선간전압(V)|유효전력(W)|무효전력(var)",
    ],
)
def test_root_mean_squares_of_power_analysers_are_known(tmp_path, names):
    v = (400.0 if "선간" in names else 400 / np.sqrt(3)) * DIP
    columns = np.column_stack([TIME, v, v, 80e3 * DIP, 20e3 * DIP])
    path = tmp_path / "rms.csv"
    path.write_text(text_of(names.replace("_", "|").split("|"), columns), encoding="utf-8")
    require_recording(path)


def test_nodes_of_rscad_that_say_no_phase_are_asked_for(tmp_path):
    names = ["Time", *(f"S1) N{k}" for k in range(1, 7))]
    path = tmp_path / "plot.csv"
    path.write_text(text_of(names, np.column_stack([TIME, *VOLTAGES, *CURRENTS])))
    with pytest.raises(
        SweepError, match=r'channels="t=1,va=2,vb=3,vc=4,ia=5,ib=6,ic=7".*2 S1\) N1'
    ):
        read_events(path, **OF_RECORDER)
    require_recording(path, channels=NUMBERED)


def test_a_number_called_num_beside_a_matrix_is_no_numerator(tmp_path):
    path = tmp_path / "num.npz"
    np.savez(path, f=FREQUENCY, Y=ADMITTANCE, num=30)
    require_admittance([path])


@each_of(
    "names, sign",
    [("freq [Hz] Z' [ohm] -Z'' [ohm]", -1), ("freq [Hz] Re(Z) [ohm] -Im(Z) [ohm]", -1)],
)
def test_a_minus_before_a_part_that_blanks_separate_begins_a_name(tmp_path, names, sign):
    paths = []
    for entry, place in ENTRIES.items():
        z = IMPEDANCE[:, *place]
        paths.append(tmp_path / f"Z{entry}.txt")
        paths[-1].write_text(text_of([names], np.column_stack([FREQUENCY, z.real, -z.imag]), " "))
    require_admittance(paths, **OF_ANALYSER)


def two_points(folder: Path) -> list[Path]:
    """Four files of an analyser for each of the operating points a and b."""
    names, form = "f [Hz]; R [ohm]; X [ohm]", "f R X"
    return [
        path for point in "ab" for path in analyser_files(folder, point + "_Z{}.csv", names, form)
    ]


def test_a_file_without_numbers_named_as_an_entry_gives_its_own_reason(tmp_path):
    paths = two_points(tmp_path)
    paths[-1].write_text("nothing\n")
    with pytest.raises(SweepError, match=r"b_Zqq.csv must hold rows of numbers"):
        import_files(paths, **SAID, base="100kVA,400V")


@each_of("called", ["{}_info.csv", "info {} 2025-11-13.csv"])
def test_a_file_beside_the_entries_tells_p_and_q_of_its_own_operating_point(tmp_path, called):
    paths = two_points(tmp_path)
    for point, p in (("a", 50), ("b", 100)):
        paths.append(tmp_path / called.format(point))
        paths[-1].write_text(f"P [kW],Q [kvar],v [pu]\n{p},30,1\n")
    said = {**SAID, **OF_ANALYSER, "p": None, "q": None}
    points = import_files(paths, **said).answered().points
    assert [one.op.p for one in points] == pytest.approx([0.5, 1.0])


def test_a_file_beside_the_entries_of_no_known_point_tells_none(tmp_path):
    paths = [*two_points(tmp_path), tmp_path / "info.csv"]
    paths[-1].write_text("P [kW],Q [kvar]\n50,30\n")
    imported = import_files(paths, **{**SAID, **OF_ANALYSER, "p": None, "q": None})
    assert imported.sweep is None
    assert "does not say" in imported.asked


def test_two_traces_of_one_format_are_not_taken_for_each_other(tmp_path):
    columns = np.column_stack([FREQUENCY, FREQUENCY, 0 * FREQUENCY])
    table = text_of(["Frequency", "Real", "Imaginary"], columns, "\t")
    path = tmp_path / "Zdd.TXT"
    path.write_text("".join(f'"TRACE: {trace}"\n"FORMAT: |Z|"\n\n{table}\n' for trace in "AB"))
    assert len(read_tables(path)) == 2


@each_of("r, x, theta", [("ohm", "mohm", "deg"), ("ohm", "ohm", ""), ("mohm", "ohm", "rad")])
def test_resistance_and_reactance_are_compared_in_their_own_units(tmp_path, r, x, theta):
    paths = []
    for entry, place in ENTRIES.items():
        z = IMPEDANCE[:, *place]
        in_r, in_x = (1e3 if unit == "mohm" else 1.0 for unit in (r, x))
        angle = np.angle(z, deg=theta == "deg")
        columns = np.column_stack([FREQUENCY, in_r * z.real, in_x * z.imag, np.abs(z), angle])
        of_theta = f"theta [{theta}]" if theta else "theta"
        names = ["f [Hz]", f"R [{r}]", f"X [{x}]", "|Z| [ohm]", of_theta]
        paths.append(tmp_path / f"Z{entry}.csv")
        paths[-1].write_text(text_of(names, columns))
    require_admittance(paths, **OF_ANALYSER)


def test_compressed_s_parameters_are_those_of_their_name_without_gz(tmp_path):
    columns = np.column_stack([FREQUENCY, np.zeros((len(FREQUENCY), 8))])
    text = "# Hz S RI R 1.6\n" + text_of(["! f"], columns, " ")
    path = tmp_path / "z.s2p.gz"
    path.write_bytes(gzip.compress(text.encode()))
    response = touchstone_response(path)
    assert response.name == "z"
    assert response.matrix[:, 0, 0] == pytest.approx(1 / 1.6)
    said = {**SAID, **OF_ANALYSER, "current": None}
    assert import_files([path], **said).sweep is not None


def test_numbers_of_scans_of_whole_matrices_are_no_entries(tmp_path):
    names = ["f_hz", *(f"Y{entry}_{part}" for entry in ENTRIES for part in ("re", "im"))]
    paths = []
    for number in (11, 12, 21, 22):
        paths.append(tmp_path / f"scan_{number}_lab.csv")
        table = np.column_stack([FREQUENCY, parts(ADMITTANCE * number)])
        paths[-1].write_text(text_of(names, table))
    assert [table.stem for table in entries_last([read_tables(path)[0] for path in paths])] == [
        path.stem for path in paths
    ]


def test_text_in_a_table_with_names_of_its_own_is_refused_with_its_line(tmp_path):
    names = ["freq", *(f"Y{entry}_{part}" for entry in ENTRIES for part in ("re", "im"))]
    lines = text_of(names, np.column_stack([FREQUENCY, parts(ADMITTANCE)])).splitlines()
    lines[5] = ",".join([*lines[5].split(",")[:2], "abc", *lines[5].split(",")[3:]])
    path = tmp_path / "scan.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(SweepError, match=r"line 6: Ydd_im must be a number; found 'abc'"):
        ibrid.read_sweep(path, **SAID)
    path.write_text("\n".join([lines[0].replace("freq", "name,p,q,freq_hz"), *lines[1:]]))
    with pytest.raises(SweepError, match=r"column op is missing; found 'name'"):
        ibrid.read_sweep(path, **SAID)


@each_of("kind", ["npz", "h5"])
def test_a_model_in_arrays_is_sampled_at_the_frequencies_that_are_said(tmp_path, kind):
    model = {"A": -100 * np.eye(2), "B": np.eye(2), "C": np.eye(2), "D": np.zeros((2, 2))}
    path = tmp_path / f"ss.{kind}"
    if kind == "npz":
        np.savez(path, **model)
    else:
        h5py = pytest.importorskip("h5py", reason="HDF5 is written by h5py (pip install h5py)")
        with h5py.File(path, "w") as file:
            for name, values in model.items():
                file[name] = values
    sweep = ibrid.read_sweep(path, frequency=[10.0, 20.0, 30.0], **SAID)
    assert sweep.points[0].frequency.tolist() == [10.0, 20.0, 30.0]


@each_of("kind", ["scan.zip", "scan.tar.gz"])
def test_an_archive_in_place_of_a_file_names_one_in_it(tmp_path, kind):
    own = tmp_path / "own.csv"
    own.write_text("f\n1\n")
    path = tmp_path / kind
    if kind.endswith("zip"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.write(own, "own.csv")
    else:
        with tarfile.open(path, "w:gz") as archive:
            archive.add(own, "own.csv")
    for read in (ibrid.read_sweep, read_events):
        with pytest.raises(SweepError, match=rf"name a file in it: .*{kind}/own.csv"):
            read(path)


def test_words_of_japan_are_those_of_japan():
    words = "インピーダンスの測定"
    assert decoded(words.encode("cp932")) == words


def test_points_of_thousands_in_files_of_an_oscilloscope_are_read_as_said(tmp_path):
    paths = [tmp_path / f"sc_{name}.csv" for name in ("Va", "Vb", "Ia", "Ib")]
    for path in paths:
        path.write_text("t;x\n0;1.234\n1;2.345\n2;3.456\n")
    for decimal, factor in (("point", 1.0), ("comma", 1e3)):
        table = joined_channels(paths, NumberFormat(decimal))
        assert table.columns["Va"] == pytest.approx(factor * np.array([1.234, 2.345, 3.456]))
    with pytest.raises(SweepError, match="decimal must be point or comma"):
        read_events(paths, decimal="semicolon")


def test_a_recording_in_several_files_is_called_as_all_of_them(tmp_path):
    paths = scope_files(tmp_path, "sc_{name}.csv", "t,x", "")
    assert read_events(paths, **OF_RECORDER).records[0].name == "sc"
    paths = scope_files(tmp_path, "tek0003CH{n}.csv", TEKTRONIX, "V|A")
    assert joined_channels(paths).stem == "tek0003CH"


def test_files_that_are_no_recording_together_say_why(tmp_path):
    paths = scope_files(tmp_path, "sc_{name}.csv", "t,x", "")
    with pytest.raises(SweepError, match="must be 4 at least; found 3"):
        read_events(paths[:3], **OF_RECORDER)
    with pytest.raises(SweepError, match=r"gone.csv must exist"):
        read_events([*paths[:5], tmp_path / "gone.csv"], **OF_RECORDER)
    paths[2].write_text("t,x,y\n0,1,2\n1,2,3\n")
    with pytest.raises(SweepError, match=r"sc_Vc.csv must hold a time and one channel.*t, x, y"):
        read_events(paths, **OF_RECORDER)
    with pytest.raises(SweepError, match="a list with dict, read them one by one"):
        read_events([{}, {}], **OF_RECORDER)


@each_of("count, answer", [(3, "add those that lack"), (4, "v="), (5, "v_mag=2,v_ang=3")])
def test_a_table_of_few_columns_is_answered_with_what_it_can_hold(tmp_path, count, answer):
    names = [f"x{k}" for k in range(count)]
    path = tmp_path / "few.csv"
    path.write_text(text_of(names, np.column_stack([TIME, *CURRENTS, *VOLTAGES])[:, :count]))
    with pytest.raises(SweepError, match=rf"found {count} channels.*{answer}") as refused:
        read_events(path, **OF_RECORDER)
    assert "va=" not in str(refused.value)


def test_files_of_an_oscilloscope_are_read_once_by_an_import(tmp_path, monkeypatch):
    paths = scope_files(tmp_path, "sc_{name}.csv", "t,x", "")
    read = []

    def counted(path: Path, *args: object, **keys: object) -> list:
        read.append(path)
        return read_tables(path, *args, **keys)

    monkeypatch.setattr(recording_files, "read_tables", counted)
    said = ["--base", "100kVA,400V", "--f0-hz", "60", "--current", "out"]
    out = ["--out", str(tmp_path / "out.csv")]
    assert cli.main(["import", *map(str, paths), *said, *out]) == 0
    assert read == paths


def test_a_number_in_place_of_the_column_of_frequencies_is_refused(tmp_path):
    path = tmp_path / "scan.csv"
    names = ["f_hz", *(f"Y{entry}_{part}" for entry in ENTRIES for part in ("re", "im"))]
    path.write_text(text_of(names, np.column_stack([FREQUENCY, parts(ADMITTANCE)])))
    with pytest.raises(SweepError, match="the frequency must be a column; found one number"):
        import_files([path], ("freq=99",), **SAID)


def test_a_file_without_a_name_in_a_tar_archive_is_refused(tmp_path):
    with tarfile.open(tmp_path / "scan.tar", "w") as archive:
        archive.addfile(tarfile.TarInfo(""))
    with pytest.raises(SweepError, match="must be a tar archive; it cannot be read"):
        import_files([tmp_path / "scan.tar"], **SAID)


@each_of("coefficients_of", [[0.0], [np.nan, 1.0], [np.inf, 1.0]])
def test_transfer_functions_without_a_denominator_are_refused(tmp_path, coefficients_of):
    cells = coefficients(2, "")
    cells["den"][0, 0] = [coefficients_of]
    savemat(tmp_path / "tfdata.mat", cells)
    with pytest.raises(SweepError, match="must hold finite coefficients"):
        import_files([tmp_path / "tfdata.mat"], **{**SAID, "quantity": None})
