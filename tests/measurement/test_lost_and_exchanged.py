"""Impedances called admittances, rad/s called Hz and columns of zeros are named; nothing that is
shipped, and no other device, is suspected of them.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from sweep_makes import rows_of

import ibrid
from ibrid import cli
from ibrid.errors import ImpossibleValueError
from ibrid.measurement import OperatingPoint, PointSweep, Sweep
from ibrid.measurement.conventions.contradictions import check_conventions
from ibrid.measurement.conventions.exchanged_quantity import exchanged_quantity
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.plausibility import implausible_numbers
from ibrid.plants import random_stable

DATA = Path(__file__).resolve().parents[2] / "data"
SHIPPED = sorted([*DATA.glob("*.csv"), *(DATA / "devices").glob("*.csv")])
REST = OperatingPoint("rest", 0.8, 0.1)
FREQUENCY = np.geomspace(5, 5000, 40)
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def inductance(x: float, r: float, f0_hz: float = 50.0) -> np.ndarray:
    """Law: Z = (r + j x f / f0) + x J, current out: Y = -1 / Z."""
    along = (r + 1j * x * FREQUENCY / f0_hz)[:, None, None] * np.eye(2)
    return -np.linalg.inv(along + x * TURN)


def sweep_of(
    admittance: np.ndarray, frequency: np.ndarray = FREQUENCY, z_base: float | None = None
) -> Sweep:
    bases = {} if z_base is None else {"s_base_va": 400.0**2 / z_base, "v_base_v": 400.0}
    return Sweep((PointSweep(REST, frequency, admittance),), f0_hz=50.0, **bases)


def table(head: str, letter: str, frequency: np.ndarray, matrix: np.ndarray) -> str:
    """Text with a column for each part of each entry."""
    names = [f"{letter}{e}_{part}" for e in ("dd", "dq", "qd", "qq") for part in ("re", "im")]
    values = np.ascontiguousarray(matrix).reshape(-1, 4).view(float).T
    return rows_of([head, *names], [frequency, *values])


def changed(sweep: Sweep, factor: float, change) -> Sweep:
    """Frequencies times a factor, and other matrices, of all operating points."""
    points = [
        PointSweep(point.op, point.frequency * factor, change(np.array(point.admittance)))
        for point in sweep.points
    ]
    return replace(sweep, points=tuple(points))


def test_what_is_shipped_is_suspected_of_nothing():
    wrong = {
        path.stem: said for path in SHIPPED if (said := implausible_numbers(ibrid.read_sweep(path)))
    }
    assert wrong == {}


def test_random_devices_are_suspected_of_nothing():
    wrong = {}
    for seed in range(20):
        population = ("textbook", "wide")[seed % 2]
        plant = random_stable(np.random.default_rng(seed), population=population)
        said = implausible_numbers(ibrid.sweep(plant, None, FREQUENCY))
        wrong |= {seed: said} if said else {}
    assert wrong == {}


@each_of("z_base", [0.16, 0.8, 1.0, 16.0, 484.0])
def test_impedances_in_ohm_called_siemens_are_named_with_their_inductance(z_base):
    """Z per unit times the base, called S, is per unit that times the base again."""
    impedance = np.linalg.inv(inductance(0.15, 0.02))
    sweep = sweep_of(impedance * z_base**2, z_base=z_base)
    shown = exchanged_quantity(sweep.points, 50.0, z_base)
    assert shown is not None
    assert shown.unit == "ohm"
    assert shown.inductance == pytest.approx(0.15, rel=0.02)
    (said,) = [one for one in inspect(sweep).warnings if "probably hold impedances" in one]
    assert "as such 0.15 per unit" in said
    assert "Zdd .. with unit: ohm" in said
    assert 'map="Zdd=RE+jIM"' in said


def test_a_capacitor_that_may_be_there_is_said_and_one_of_no_filter_is_not():
    impedance = np.linalg.inv(inductance(0.1, 0.02))
    shown = [exchanged_quantity(sweep_of(k * impedance).points, 50.0, None) for k in (1.0, 9.0)]
    assert [one.possible for one in shown if one] == [True, False]
    assert exchanged_quantity(sweep_of(inductance(0.1, 0.02)).points, 50.0, None) is None


@pytest.mark.parametrize(
    ("unit", "letter", "words"),
    [("S", "Y", "impedances: name them Zdd"), ("ohm", "Z", "admittances: name them Ydd")],
)
def test_a_refusal_names_the_other_quantity(unit, letter, words, tmp_path):
    admittance = inductance(0.15, 0.02)
    values = np.linalg.inv(admittance) * 16 if unit == "S" else admittance / 16
    above = f"# unit: {unit}\n# s_base_va: 10000\n# v_base_v: 400\n# f0_hz: 50\n"
    body = table("freq_hz", letter, FREQUENCY, values)
    rows = [f"rest,0.8,0.1,{row}" for row in body.splitlines()]
    rows[0] = rows[0].replace("rest,0.8,0.1", "op,p,q")
    (tmp_path / "a.csv").write_text(above + "\n".join(rows))
    with pytest.raises(ImpossibleValueError, match=f"or the columns hold {words}"):
        ibrid.read_sweep(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1 / (2 * np.pi), "look like Hz, taken as rad/s: times 2 pi"),
        (2 * np.pi, "look like rad/s, taken as Hz: divided by 2 pi"),
    ],
)
def test_frequencies_too_small_or_large_by_two_pi_show_f0_high_up(factor, words):
    """The cross terms of an inductance read f0 at the true frequencies alone; the grid is not
    round.
    """
    uneven = 1.0137 * FREQUENCY
    admittance = -np.linalg.inv(
        (0.02 + 0.15j * uneven / 50)[:, None, None] * np.eye(2) + 0.15 * TURN
    )
    assert [
        one for one in implausible_numbers(sweep_of(admittance, factor * uneven)) if words in one
    ]
    assert implausible_numbers(sweep_of(admittance, uneven)) == ()


def test_an_inductance_of_one_per_unit_may_be_in_hertz_called_radians():
    decoupled = -np.eye(2) / (0.02 + 0.3j * FREQUENCY / 50)[:, None, None]
    (said,) = implausible_numbers(sweep_of(decoupled, FREQUENCY / (2 * np.pi)))
    assert "1.9 per unit, too large" in said
    assert "Hz taken as rad/s (then 0.3)" in said


@each_of("entries", [("dd",), ("dq", "qd"), ("dd", "dq", "qd", "qq")])
@each_of("letter", ["Y", "Z"])
def test_imaginary_parts_that_are_all_zero_are_named(entries, letter):
    def spoilt(values: np.ndarray) -> np.ndarray:
        values = np.linalg.inv(values) if letter == "Z" else values
        for entry in entries:
            place = (..., "dq".index(entry[0]), "dq".index(entry[1]))
            values[place] = values[place].real
        return np.linalg.inv(values) if letter == "Z" else values

    sweep = changed(ibrid.read_sweep(DATA / "paper_like.csv"), 1.0, spoilt)
    (said,) = [one for one in inspect(sweep).warnings if "parts of" in one]
    letter = "Y" if len(entries) == 4 else letter  # the inverse of a real matrix is real
    named = ", ".join(f"{letter}{entry}" for entry in entries)
    assert said.startswith(f"the imaginary parts of {named} are zero in all rows while")
    assert f'map="{letter}{entries[0]}=RE+jIM"' in said


def test_real_parts_that_are_all_zero_are_named_at_their_operating_point():
    sweep = ibrid.read_sweep(DATA / "paper_like.csv")
    first = sweep.points[0]
    values = np.array(first.admittance)
    values[:, 1, 1] = 1j * values[:, 1, 1].imag
    points = (PointSweep(first.op, first.frequency, values), *sweep.points[1:])
    (said,) = [one for one in inspect(replace(sweep, points=points)).warnings if "parts of" in one]
    assert said.startswith(f"the real parts of Yqq are zero in all rows at {first.op.name} while")


def test_a_lossless_reactance_a_gain_and_an_axis_without_coupling_have_lost_nothing():
    """Without losses an inductance in dq is imaginary in dd and real in dq at all frequencies."""
    gain = np.tile([[-1.0, 0.2], [0.3, -1.0]], (len(FREQUENCY), 1, 1)) + 0j
    uncoupled = -np.eye(2) / (0.02 + 0.3j * FREQUENCY / 50)[:, None, None]
    for admittance in (inductance(0.15, 0.0), gain, uncoupled):
        assert not [one for one in implausible_numbers(sweep_of(admittance)) if "parts of" in one]


def _map(letter: str, of: str) -> str:
    return ",".join(f"{letter}{e}={of}{e}_re+j{of}{e}_im" for e in ("dd", "dq", "qd", "qq"))


SAID = ["--current", "out", "--q-axis", "leads", "--voltage-axis", "d", "--f0-hz", "50"]
SAID += ["--p", "0.8", "--q", "0.1"]
BASE = ["--base", "1MVA,400V"]


@pytest.mark.parametrize(
    ("head", "letter", "wrong", "right", "words"),
    [
        ("f", "Y", ["--unit", "S", *BASE], ["--map", _map("Z", "Y")], "hold impedances"),
        ("w [rad/s]", "Z", [], ["--map", "freq=w [rad/s][Hz]"], "Hz, taken as rad/s"),
    ],
)
def test_the_option_that_the_sentence_names_puts_it_right(
    head, letter, wrong, right, words, tmp_path, capsys
):
    """The file holds impedances in ohm at frequencies in Hz, whatever its names say."""
    admittance = inductance(0.15, 0.02)
    file, out = tmp_path / "scan.csv", tmp_path / "out.csv"
    file.write_text(table(head, letter, FREQUENCY, 0.16 * np.linalg.inv(admittance)))
    true = ["--unit", "ohm", *BASE]
    assert cli.main(["import", str(file), *SAID, *(wrong or true), "--out", str(out)]) == 0
    assert words in capsys.readouterr().err
    out.unlink()
    assert cli.main(["import", str(file), *SAID, *true, *right, "--out", str(out)]) == 0
    assert words not in capsys.readouterr().err
    (point,) = ibrid.read_sweep(out).points
    np.testing.assert_allclose(point.frequency, FREQUENCY, rtol=1e-9)
    np.testing.assert_allclose(point.admittance, admittance, rtol=1e-8, atol=1e-9)


TURNED_SIGNS = {
    "Ydd": [[-1, 1], [1, 1]],
    "Ydq": [[1, -1], [1, 1]],
    "Yqd": [[1, 1], [-1, 1]],
    "Yqq": [[1, 1], [1, -1]],
    "Ydd and Yqd": [[-1, 1], [-1, 1]],
    "Ydq and Yqq": [[1, -1], [1, -1]],
    "Ydd and Ydq": [[-1, -1], [1, 1]],
    "Yqd and Yqq": [[1, 1], [-1, -1]],
}


@each_of("entries", TURNED_SIGNS)
@each_of("name", ["paper_like", "gfl_dc_link", "gfm_droop", "random_00"])
def test_a_sign_that_is_turned_is_named_by_the_filter_high_up(entries, name):
    signs = np.array(TURNED_SIGNS[entries])
    turned = changed(ibrid.read_sweep(DATA / f"{name}.csv"), 1.0, lambda y: y * signs)
    (sentence,) = [one for one in implausible_numbers(turned) if "sign of" in one]
    named = sentence.split("once the sign of ")[1].split(" is turned")[0]
    assert named == entries


def test_a_sweep_that_ends_before_the_filter_shows_is_not_doubted_for_its_signs():
    sweep = ibrid.read_sweep(DATA / "paper_like.csv")
    below = [
        PointSweep(p.op, p.frequency[p.frequency < 900], p.admittance[p.frequency < 900])
        for p in sweep.points
    ]
    turned = changed(replace(sweep, points=tuple(below)), 1.0, lambda y: y * [[1, 1], [-1, 1]])
    assert [one for one in implausible_numbers(turned) if "sign of" in one] == []


@each_of("name", ["devices/motulator_gfl", "gfl_l_filter", "random_03", "gfl_dc_link"])
def test_exchanged_direct_entries_are_named_where_the_angle_has_settled(name):
    """Law: Yqq V^2 = p at rest, whatever the control; Ydd V^2 = p of no device that has it too."""
    sweep = ibrid.read_sweep(DATA / f"{name}.csv")
    exchanged = changed(sweep, 1.0, lambda y: np.where(np.eye(2), y[:, ::-1, ::-1], y))
    assert any("Ydd and Yqq are" in one for one in check_conventions(exchanged).warnings)


def test_no_device_that_is_shipped_is_said_to_have_its_direct_entries_exchanged():
    wrong = [
        path.stem
        for path in SHIPPED
        if any("Ydd and Yqq are" in w for w in check_conventions(ibrid.read_sweep(path)).warnings)
    ]
    assert wrong == []


def said_of(plant: str, change) -> str:
    """What is said of the rest and the signs of a reference inverter whose Z is changed."""
    rest, frequency = OperatingPoint("a", 1.0, 0.3), np.geomspace(1, 5000, 60)
    sweep = ibrid.sweep(plant, [rest], frequency)
    impedance = np.linalg.inv(sweep.points[0].admittance)
    change(impedance)
    point = replace(sweep.points[0], admittance=np.linalg.inv(impedance))
    return " ".join(inspect(replace(sweep, points=(point,))).warnings)


@each_of("plant", ["gfl_l_filter", "gfl_dc_link"])
def test_one_slip_of_an_entry_of_the_impedance_is_named_as_that_alone(plant):
    def exchange(z):
        z[:, 0, 0], z[:, 1, 1] = z[:, 1, 1].copy(), z[:, 0, 0].copy()

    def turn(z):
        z[:, 1, 0] *= -1

    def milliohm(z):
        z[:, 1, 1] *= 1000

    assert "probably" not in said_of(plant, lambda z: None)
    assert "Ydd and Yqq are probably exchanged" in said_of(plant, exchange)
    assert re.search("once the sign of [ZY]qd is turned", said_of(plant, turn))
    said = said_of(plant, milliohm)
    assert "in another unit" in said
    assert "frame" not in said
    assert "times too" not in said


def test_the_sign_of_one_entry_of_the_admittance_is_named_where_it_has_settled():
    sweep = ibrid.sweep("gfl_l_filter", [OperatingPoint("a", 0.8, 0.3)], np.geomspace(0.1, 500, 40))
    wrong = []
    for entry in ("dd", "dq", "qd", "qq"):
        admittance = sweep.points[0].admittance.copy()
        admittance[:, "dq".index(entry[0]), "dq".index(entry[1])] *= -1
        point = replace(sweep.points[0], admittance=admittance)
        said = check_conventions(replace(sweep, points=(point,))).warnings
        if f"sign of Y{entry} is turned" not in " ".join(said):
            wrong.append((entry, said))
    assert wrong == []


def test_directions_that_are_said_are_not_asked_for_as_an_angle_of_the_frame(tmp_path):
    sweep = ibrid.sweep("gfl_l_filter", [OperatingPoint("a", 0.8, 0.1)], np.geomspace(1, 5000, 40))
    point = sweep.points[0]
    path = tmp_path / "into.csv"
    path.write_text(table("f_Hz", "Y", point.frequency, -point.admittance))
    said = {"unit": "pu", "f0_hz": 50, "p": 0.8, "q": 0.1, "current": "in"}
    for more in ({"q_axis": "leads", "voltage_axis": "d"}, {}):
        answer = import_files([path], **said, **more)
        assert answer.questions == ()
        (read,) = answer.answered().points
        np.testing.assert_allclose(read.admittance, point.admittance, rtol=1e-10)
