"""Words of German, French, Spanish and English in names and comments: voltages and powers of a
recording, the nominal frequency, which way the current counts.
"""

import numpy as np
import pytest
from recording_makes import BASE, current, six, text, times, voltage

import ibrid
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.timed.signal_names import signal_of
from ibrid.measurement.importing.told import current_in_words, told_beside

#: Voltage and powers, and whether the voltage is said to be that between the phases.
NAMES = [
    ("Leiter-Leiter-Spannung, Betrag in kV", "Wirkleistung in MW", "Blindleistung in Mvar", 1),
    ("Außenleiterspannung (kV)", "Gesamtwirkleistung [MW]", "Gesamtblindleistung [Mvar]", 1),
    ("Verkettete Spannung in kV", "Wirkleistung, gesamt in MW", "Blindleistung Q in Mvar", 1),
    ("Spannung Mitsystem, Betrag in kV", "Gesamte Wirkleistung in MW", "Blindleistung [Mvar]", 0),
    ("Tension composée (kV)", "Puissance active (MW)", "Puissance réactive (Mvar)", 1),
    ("Tension entre phases [kV]", "Puissance active totale [MW]", "Q réactive [Mvar]", 1),
    ("Tensión de línea (kV)", "Potencia activa (MW)", "Potencia reactiva (Mvar)", 1),
    ("Tensión compuesta [kV]", "Potencia activa total [MW]", "Potencia reactiva total [Mvar]", 1),
    ("Tensión línea-línea (kV)", "P activa [MW]", "Q reactiva [Mvar]", 1),
    ("Line-to-line voltage, magnitude (kV)", "Total active power (MW)", "Reactive power (Mvar)", 1),
]


@pytest.mark.parametrize("names", NAMES)
def test_long_names_of_a_voltage_and_powers_are_known(names):
    v, p, q = (signal_of(name) for name in names[:3])
    assert (v.quantity, p.role, q.role) == ("v", "p", "q")
    assert (v.factor, p.factor, q.factor) == (1e3, 1e6, 1e6)
    assert ("line" in v.counted) == bool(names[3])


@pytest.mark.parametrize(
    "name", ["Leiter-Erde-Spannung [kV]", "Tension simple (kV)", "Tensión de fase (kV)"]
)
def test_voltages_to_the_ground_are_not_taken_for_those_between_the_phases(name):
    assert signal_of(name).quantity == ""


def test_a_recording_with_long_names_of_germany_needs_no_channels(tmp_path):
    time = times(500.0)
    power = voltage(time) * np.conj(current(time))
    columns = [time, abs(voltage(time)) * 20, power.real * 10, power.imag * 10]
    path = tmp_path / "record.csv"
    path.write_text(text(["Zeit in s", *NAMES[0][:3]], columns, ";", comma=True))
    (record,) = ibrid.read_events(path, base=BASE[1], f0_hz=60).records
    assert [record.rest.p, record.rest.q, record.rest.v] == pytest.approx([0.8, 0.1, 1.0])


@pytest.mark.parametrize(
    "words",
    [
        "Nennfrequenz: 50 Hz",
        "Nennfrequenz 50 Hz",
        "fréquence nominale 50 Hz",
        "frecuencia nominal 50 Hz",
        "nominal frequency is 50 Hz",
    ],
)
def test_the_nominal_frequency_is_read_from_words(words):
    assert told_beside("", [words])["f0_hz"][:2] == (50.0, "frequency")


@pytest.mark.parametrize(
    ("words", "way"),
    [
        ("Strom positiv in das Gerät", "in"),
        ("Strom positiv ins Netz", "out"),
        ("Strom ist positiv vom Netz zum Gerät", "in"),
        ("courant positif vers le réseau", "out"),
        ("courant positif vers l'onduleur", "in"),
        ("corriente positiva hacia la red", "out"),
        ("current positive into the device", "in"),
        ("current counted positive from the grid", "in"),
        ("Positive current flows out of the inverter", "out"),
        ("current not positive into the device", None),
        ("current measured at 3 A in the device under test", None),
        ("current injected to the grid", None),
    ],
)
def test_which_way_the_current_counts_is_read_from_words(words, way):
    assert (current_in_words([words]) or (None,))[0] == way


def test_two_sentences_that_disagree_say_nothing_of_the_current():
    assert current_in_words(["current positive into the device", "Strom positiv ins Netz"]) is None


@pytest.mark.parametrize(("words", "sign"), [("Strom positiv in das Gerät", -1), ("", 1)])
def test_a_current_that_counts_into_the_device_by_words_is_turned(tmp_path, words, sign):
    time, values = six(2000.0)
    names = ["t [s]", "ua [V]", "ub [V]", "uc [V]", "ia [A]", "ib [A]", "ic [A]"]
    columns = [time, *values[:3], *(sign * values[3:])]
    path = tmp_path / "record.csv"
    path.write_text(text(names, columns, above=(f"# {words}",)), encoding="utf-8")
    (record,) = ibrid.read_events(path, base=BASE[1], f0_hz=60).records
    assert [record.rest.p, record.rest.q] == pytest.approx([0.8, 0.1], abs=1e-3)


def test_the_words_of_a_sweep_say_which_way_its_current_counts(tmp_path):
    """As `--current in` does, and the account shows the sentence."""
    point = ibrid.read_sweep(ibrid.benchmarks()["paper_like"]).points[0]
    parts = [f"Y{a}{b}_{part}" for a in "dq" for b in "dq" for part in ("re", "im")]
    entries = np.stack([point.admittance.real, point.admittance.imag], -1).reshape(-1, 8)
    rows = [",".join(map(repr, row)) for row in np.c_[point.frequency, -entries].tolist()]
    path = tmp_path / "scan.csv"
    head = ["# courant positif vers l'onduleur", "# fréquence nominale 60 Hz"]
    path.write_text("\n".join([*head, ",".join(["f", *parts]), *rows]), encoding="utf-8")
    read = import_files([path], unit="pu", p=1.0, q=0.3)
    np.testing.assert_allclose(read.answered().points[0].admittance, point.admittance, atol=1e-12)
    assert [one for one in read.remarks if 'words say: "courant' in one] != [], read.remarks
