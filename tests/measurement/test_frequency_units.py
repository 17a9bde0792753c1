"""Frequencies in rad/s, Hz or kHz: read as their name or what stands beside them says, and asked
for where numbers contradict.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.frequency_unit import measure_of, units_spoken_of
from ibrid.measurement.importing.importing import Imported, import_files

HZ = np.geomspace(1, 2500, 25)
W = 2 * np.pi * HZ
SAID = {
    "unit": "pu",
    "f0_hz": 50.0,
    "p": 0.7,
    "q": -0.2,
    "current": "out",
    "q_axis": "leads",
    "quantity": "Y",
}


def matrices(hertz: np.ndarray = HZ) -> np.ndarray:
    """(n, 2, 2) of a filter under a proportional current control, without decoupling."""
    s = 2j * np.pi * hertz[:, None, None]
    turn = np.array([[0, -1], [1, 0]])
    return -np.linalg.inv(
        0.15 * (s / (100 * np.pi) * np.eye(2) + turn) + 0.2 * np.eye(2) + 20 / s * np.eye(2)
    )


Y = matrices()
COLUMN_LAST = np.moveaxis(Y, 0, -1)
ENTRIES = {
    f"Y{entry}_{part}": getattr(Y.reshape(-1, 4)[:, k], name)
    for k, entry in enumerate(("dd", "dq", "qd", "qq"))
    for part, name in (("re", "real"), ("im", "imag"))
}


def frequencies(imported: Imported) -> np.ndarray:
    return imported.answered().points[0].frequency


MAT = {
    "key": {"Frequency": W, "FrequencyUnit": "rad/s", "Y": COLUMN_LAST},
    "key in Hz": {"Frequency": HZ, "FrequencyUnit": "Hz", "Y": COLUMN_LAST},
    "key in kHz": {"freq": HZ / 1e3, "freq_unit": "kHz", "Y": COLUMN_LAST},
    "a frd as a structure": {
        "sys": {
            "ResponseData": COLUMN_LAST,
            "Frequency": W,
            "FrequencyUnit": "rad/TimeUnit",
            "TimeUnit": "seconds",
        }
    },
    "a frd in minutes": {
        "sys": {
            "ResponseData": COLUMN_LAST,
            "Frequency": W * 60,
            "FrequencyUnit": "rad/TimeUnit",
            "TimeUnit": "minutes",
        }
    },
    "its end": {"freq_rad": W, "Y": COLUMN_LAST},
    "its name": {"omega": W, "Y": COLUMN_LAST},
    "w and a key": {"w_vec": HZ, "FrequencyUnit": "Hz", "Y": COLUMN_LAST},
    "rotations": {"f": HZ * 60, "unit_of_frequency": "rpm", "Y": COLUMN_LAST},
    "nothing": {"f": HZ, "Y": COLUMN_LAST},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", MAT)
def test_mat_files_are_read_in_the_unit_that_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
):
    monkeypatch.setattr(
        "ibrid.measurement.importing.table_files.guarded",
        lambda reader, content, what: reader(content),
    )
    savemat(tmp_path / "scan.mat", MAT[case])
    imported = import_files([tmp_path / "scan.mat"], **SAID)
    np.testing.assert_allclose(frequencies(imported), HZ, rtol=1e-12)
    unit = next(unit for what, _, unit in imported.readings if what == "frequency")
    assert ("as nothing says otherwise" in unit) == (case == "nothing")


def test_npz_hdf5_and_json_say_their_unit_in_the_same_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    h5py = pytest.importorskip("h5py")
    monkeypatch.setattr(
        "ibrid.measurement.importing.table_files.guarded",
        lambda reader, content, what: reader(content),
    )
    np.savez(tmp_path / "a.npz", frequency=W, frequency_unit="rad/s", Y=Y)
    np.savez(tmp_path / "b.npz", frequency=W, frequency_unit=np.bytes_("rad/s"), Y=Y)
    np.savez(tmp_path / "c.npz", w=W, Y=Y)
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file.create_dataset("scan/frequency", data=W).attrs["units"] = "rad/s"
        file.create_dataset("scan/Y", data=Y)
    with h5py.File(tmp_path / "e.h5", "w") as file:
        file.attrs["FrequencyUnit"] = "rad/s"
        file["f"] = W
        file["Y"] = Y
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file["f"] = W
        file["f_unit"] = "rad/s"
        file["Y"] = Y
    lists = {name: column.tolist() for name, column in ENTRIES.items()}
    (tmp_path / "g.json").write_text(
        json.dumps({"frequency": W.tolist(), "FrequencyUnit": "rad/s", **lists})
    )
    for name in ("a.npz", "b.npz", "c.npz", "d.h5", "e.h5", "f.h5", "g.json"):
        np.testing.assert_allclose(
            frequencies(import_files([tmp_path / name], **SAID)), HZ, rtol=1e-12, err_msg=name
        )


def test_a_unit_that_was_taken_from_a_column_is_not_said_to_be_unused(tmp_path: Path):
    lists = {name: column.tolist() for name, column in ENTRIES.items()}
    key = {"FrequencyUnit": "rad/s", "TimeUnit": "seconds", "Comment": "first"}
    (tmp_path / "scan.json").write_text(json.dumps({"frequency": W.tolist(), **key, **lists}))
    assert "not used: Comment" in import_files([tmp_path / "scan.json"], **SAID).remarks
    mapped = import_files([tmp_path / "scan.json"], ["freq=frequency[rad/s]"], **SAID)
    assert "not used: FrequencyUnit, TimeUnit, Comment" in mapped.remarks


def table(path: Path, name: str, frequency: np.ndarray, *comments: str) -> Path:
    rows = np.column_stack([frequency, *ENTRIES.values()])
    lines = [
        *comments,
        ",".join([name, *ENTRIES]),
        *(",".join(map(repr, row)) for row in rows.tolist()),
    ]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "comment", "factor"),
    [
        ("f", "# FrequencyUnit: rad/s", 2 * np.pi),
        ("f_scan", "# f_scan: rad/s", 2 * np.pi),
        ("freq", "# freq [rad/s], others per unit", 2 * np.pi),
        ("w", "# bandwidth frequency of the loop in rad/s: 300", 2 * np.pi),
        ("omega [1/s]", "# sampling frequency in Hz", 2 * np.pi),
        ("frequency_rad_per_s", "", 2 * np.pi),
        ("f", "# sampling frequency in rad/s", 1.0),
        ("f", "# frequency of the PLL 60 rad/s", 1.0),
        ("f [kHz]", "# frequency unit: kHz", 1e-3),
    ],
)
def test_text_says_its_unit_in_a_name_or_a_comment(
    tmp_path: Path, name: str, comment: str, factor: float
):
    imported = import_files([table(tmp_path / "scan.csv", name, HZ * factor, comment)], **SAID)
    np.testing.assert_allclose(frequencies(imported), HZ, rtol=1e-12)


def test_a_unit_in_the_name_against_one_beside_it_is_asked_for(tmp_path: Path):
    path = table(tmp_path / "scan.csv", "f [Hz]", W, "# FrequencyUnit: rad/s")
    asked = import_files([path], **SAID).asked
    assert "--map freq=f [Hz][rad/s] or --map freq=f [Hz][Hz]" in asked
    np.testing.assert_allclose(
        frequencies(import_files([path], ["freq=f [Hz][rad/s]"], **SAID)), HZ, rtol=1e-12
    )


def test_numbers_that_look_like_rad_per_s_are_asked_for_where_nothing_is_said(tmp_path: Path):
    """Ends that are round in Hz, or an inductance that turns d and q at omega_0."""
    path = table(tmp_path / "round.csv", "f", W)
    assert (
        "the unit of the frequencies (divided by 2 pi they run from 1 to 2.5e+03"
        in import_files([path], **SAID).asked
    )
    odd = HZ * 1.0371
    rows = np.column_stack([2 * np.pi * odd, matrices(odd).reshape(-1, 4).view(float)])
    odd_file = tmp_path / "odd.csv"
    odd_file.write_text(
        "\n".join([",".join(["f", *ENTRIES]), *(",".join(map(repr, row)) for row in rows.tolist())])
    )
    assert "2 pi times 50 Hz" in import_files([odd_file], **SAID).asked
    for maps, hertz in ((["freq=f[rad/s]"], odd), (["freq=f[Hz]"], 2 * np.pi * odd)):
        np.testing.assert_allclose(
            frequencies(import_files([odd_file], maps, **SAID)), hertz, rtol=1e-12
        )


def test_a_frequency_at_rest_in_rad_per_s_is_not_taken_for_hertz(tmp_path: Path):
    said = {key: value for key, value in SAID.items() if key != "f0_hz"}
    for number, comment in enumerate(
        ("# f0 = 314.159265 rad/s", "# omega0 = 314.159265", "# w_n: 314.159265 rad/s")
    ):
        path = table(tmp_path / f"{number}.csv", "f [Hz]", HZ, comment)
        assert import_files([path], **said).answered().f0_hz == pytest.approx(50.0, abs=1e-6)


@pytest.mark.slow
def test_a_sweep_file_of_matlab_heeds_its_unit(tmp_path: Path):
    """Read without import: a variable called frequency beside FrequencyUnit, and a w that is said
    to be Hz.
    """
    savemat(
        tmp_path / "a.mat",
        {"frequency": W, "FrequencyUnit": "rad/s", "Y": COLUMN_LAST, "p": 0.7, "q": 0.0},
    )
    np.testing.assert_allclose(
        ibrid.read_sweep(tmp_path / "a.mat").points[0].frequency, HZ, rtol=1e-12
    )
    savemat(
        tmp_path / "b.mat", {"w": HZ, "FrequencyUnit": "Hz", "Y": COLUMN_LAST, "p": 0.7, "q": 0.0}
    )
    with pytest.raises(SweepError, match="w must be in rad/s; found Hz said beside it"):
        ibrid.read_sweep(tmp_path / "b.mat")


def test_names_of_frequencies_say_their_unit():
    angular = (
        "w",
        "omega",
        "freq_rad",
        "f_rads",
        "w [rad/s]",
        "omega_vec",
        "frequency (krad/s)",
        "ω",
        "Kreisfrequenz [1/s]",
    )
    assert {name: meaning_of(name).role for name in angular} == dict.fromkeys(angular, "omega")
    plain = ("f", "freq", "Frequency_Hz", "frequencies", "freq_vec", "f [1/s]", "fréquence (Hz)")
    assert {name: meaning_of(name).role for name in plain} == dict.fromkeys(plain, "freq")
    assert meaning_of("Ydd_phase_rad").role == "matrix"


def test_units_of_frequency_are_known_as_programs_write_them():
    expected = {
        "rad/s": ("angular frequency", 1.0),
        "rad/TimeUnit": ("angular frequency", 1.0),
        "krad/s": ("angular frequency", 1e3),
        "radians per second": ("angular frequency", 1.0),
        "cycles/second": ("frequency", 1.0),
        "MHz": ("frequency", 1e6),
        "rpm": ("frequency", 1 / 60),
        "V": None,
        "rad/minute": ("angular frequency", 1 / 60),
        "rad": ("angular frequency", 1.0),
    }
    assert {text: measure_of(text) for text in expected} == expected
    quiet = [
        "nominal frequency: 314.16 rad/s",
        "PLL frequency: 3 Hz",
        "f, omega [rad/s]",
        "gradual, radius",
        "w0 = 377 rad/s",
    ]
    assert not units_spoken_of(quiet, ("f", "omega [rad/s]"))


def without_turning(path: Path, frequency: np.ndarray, *comments: str) -> Path:
    """A table whose d and q are not turned by an inductance, so that its numbers show no unit."""
    plain = 1 / (0.3 + 0.001j * frequency)
    y = np.stack([plain, 0 * plain, 0 * plain, plain], axis=-1)
    rows = np.column_stack([frequency, y.view(float).reshape(len(y), 8)])
    lines = [
        *comments,
        ",".join(["f", *ENTRIES]),
        *(",".join(map(repr, row)) for row in rows.tolist()),
    ]
    path.write_text("\n".join(lines))
    return path


SPOKEN = [
    "# carrier frequency in kHz, see sheet 2",
    "# PLL crossover frequency in rad/s",
    "# All gains for omega in rad/s",
    "# virtual inertia acts on the angular frequency, rad/s",
    "# Kreisfrequenz in rad/s",
    "# columns: rad/s, pu, pu",
    "# frequencies: 8.6 to 12487 rad/s",
    "# unit of x: rad/s",
    "# frequencies are in rad/s",
    "% radians per second",
    "# units = rad s^-1",
    "# x in krad/s",
]


@pytest.mark.slow
@pytest.mark.parametrize("comment", SPOKEN)
def test_a_sentence_with_another_unit_asks_and_decides_nothing(tmp_path: Path, comment: str):
    """Whether it speaks of these frequencies or of others; where the numbers show Hz it says
    nothing.
    """
    slow = np.geomspace(1.37, 143.7, 25)
    path = without_turning(tmp_path / "silent.csv", slow, comment)
    asked = import_files([path], **SAID).asked
    assert "the unit of the frequencies (beside them stands" in asked
    assert f"--map freq=f[{'kHz' if 'kHz' in comment else 'rad/s'}] or --map freq=f[Hz]" in asked
    np.testing.assert_allclose(
        frequencies(import_files([path], ["freq=f[Hz]"], **SAID)), slow, rtol=1e-12
    )
    shows = table(tmp_path / "shows.csv", "f", HZ, comment)
    np.testing.assert_allclose(frequencies(import_files([shows], **SAID)), HZ, rtol=1e-12)


@pytest.mark.slow
def test_a_text_in_a_mat_file_that_is_rad_per_s_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(
        "ibrid.measurement.importing.table_files.guarded",
        lambda reader, content, what: reader(content),
    )
    odd = 2 * np.pi * HZ * 1.0371
    flat = np.eye(2)[:, :, None] / (0.3 + 0.001j * odd)
    savemat(tmp_path / "a.mat", {"frequency": odd, "units": "rad/s", "Y": flat, "p": 0.7, "q": 0.0})
    assert (
        "the unit of the frequencies (beside them stands 'units: rad/s')"
        in import_files([tmp_path / "a.mat"], **SAID).asked
    )
    with pytest.raises(SweepError, match="frequency must have a unit; found rad/s in units"):
        ibrid.read_sweep(tmp_path / "a.mat")


def test_what_mat_files_say_of_frequencies_is_refused_where_it_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(
        "ibrid.measurement.importing.table_files.guarded",
        lambda reader, content, what: reader(content),
    )
    cases = {
        "w must be 2 pi times frequency; found 1.01 Hz beside 1 Hz": {
            "frequency": HZ,
            "w": W * 1.01,
        },
        "w must be a number; found": {"w": W + 1j},
        "p must be a real number; found (1+1j)": {"w": W, "p": 1 + 1j},
        "must be Hz, kHz, MHz, GHz, rad/s, krad/s, rad/minute": {
            "frequency": HZ,
            "FrequencyUnit": "furlong",
        },
    }
    for words, variables in cases.items():
        savemat(tmp_path / "scan.mat", {"Y": COLUMN_LAST, **variables})
        with pytest.raises(SweepError, match=re.escape(words)):
            import_files([tmp_path / "scan.mat"], **SAID)
    savemat(tmp_path / "scan.mat", {"Y": COLUMN_LAST, "frequency": HZ, "w": W})
    np.testing.assert_allclose(
        frequencies(import_files([tmp_path / "scan.mat"], **SAID)), HZ, rtol=1e-12
    )
    savemat(tmp_path / "scan.mat", {"Y": COLUMN_LAST, "frequency": HZ, "w": W * 1.01})
    named = import_files([tmp_path / "scan.mat"], ["freq=frequency"], **SAID)
    np.testing.assert_allclose(frequencies(named), HZ, rtol=1e-12)
