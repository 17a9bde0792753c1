"""Stability in a grid: closed forms, poles against Nyquist against simulation, the command and its
page.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from fitted import evaluated, measured
from ibrid_bench.fit.behind_grid import critical_ratio, step_behind_grid
from page_reader import Reader
from scipy.linalg import eig
from sharing import shared

import ibrid
from ibrid.analysis import stability
from ibrid.analysis.grids.device_in_grid import behind_grid, terminal_current, thevenin_voltage
from ibrid.analysis.grids.grid import (
    MeasuredGrid,
    SeriesRL,
    measured_grid,
    of_ratio,
    ratios,
    series_rl,
)
from ibrid.analysis.grids.nyquist import nyquist, start_frequencies
from ibrid.analysis.models.modes import Mode
from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants import PLANTS, operating_point, state_space
from ibrid.structure.diagrams.program import parse_program

OMEGA_0 = 2 * np.pi * 60
POINTS = ("p=1,q=0.3", "p=1,q=-0.3", "p=0,q=0")
XR = 10.0


@shared
def fitted() -> Record:
    return evaluated("gfl_pll_filter_exact")


@shared
def answer():
    return stability(fitted(), ratios("1:10:6"), op=POINTS)


def found_at(op: str):
    return next(one for one in answer().points if one.op == op)


def sorted_poles(poles: np.ndarray) -> np.ndarray:
    return np.array(sorted(poles, key=lambda one: (round(one.real, 4), one.imag)))


# --- the closed loop
# ----------------------------------------------------------------------------------------------


def test_a_branch_on_a_grid_has_the_poles_of_both_in_series():
    R, L, grid = 0.01, 0.2, SeriesRL(0.03, 0.3, OMEGA_0)
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    A = -OMEGA_0 / L * (R * np.eye(2) + L * J)
    found, added = behind_grid(A, -OMEGA_0 / L * np.eye(2), np.eye(2), np.zeros((2, 2)), grid)
    assert added == ()
    expected = -OMEGA_0 * (R + grid.r) / (L + grid.x)
    np.testing.assert_allclose(
        sorted_poles(np.linalg.eigvals(found)), expected + 1j * OMEGA_0 * np.array([-1, 1])
    )


def test_a_resistor_on_a_grid_leaves_the_currents_of_the_grid_as_states():
    R, grid = 2.0, SeriesRL(0.03, 0.3, OMEGA_0)
    found, added = behind_grid(
        np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), -np.eye(2) / R, grid
    )
    assert len(added) == 2
    expected = -OMEGA_0 * (R + grid.r) / grid.x
    np.testing.assert_allclose(
        sorted_poles(np.linalg.eigvals(found)), expected + 1j * OMEGA_0 * np.array([-1, 1])
    )


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_poles_are_those_of_the_descriptor_form_for_any_direct_term(rank):
    rng, grid, n = np.random.default_rng(rank), SeriesRL(0.05, 0.4, OMEGA_0), 4
    A, B, C = (rng.standard_normal(shape) for shape in ((n, n), (n, 2), (2, n)))
    D = rng.standard_normal((2, rank)) @ rng.standard_normal((rank, 2))
    found = np.linalg.eigvals(behind_grid(A, B, C, D, grid)[0])
    # x' = A x + B v, 0 = C x + D v - i, l i' = v - (r + x J) i, nothing eliminated
    l, I = grid.x / OMEGA_0, np.eye(2)
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    left = np.block(
        [[A, B, np.zeros((n, 2))], [C, D, -I], [np.zeros((2, n)), I, -(grid.r * I + grid.x * J)]]
    )
    right = np.zeros((n + 4, n + 4))
    right[:n, :n], right[n + 2 :, n + 2 :] = np.eye(n), l * I
    pencil = eig(left, right, right=False, homogeneous_eigvals=True)
    finite = np.abs(pencil[1]) > 1e-9 * np.abs(pencil[0])
    poles = pencil[0][finite] / pencil[1][finite]
    assert len(poles) == n + rank == len(found)
    assert max(np.abs(poles - one).min() / (1 + abs(one)) for one in found) < 1e-6


@pytest.mark.slow
def test_the_inverter_behind_a_grid_is_the_inverter_with_a_longer_line():
    """Another way to the same poles: the nonlinear plant with L_g + x, R_g + r on a stiff source
    v_Th, linearised.
    """
    plant, grid = PLANTS["paper_like"], of_ratio(2.0, XR, OMEGA_0)
    for op in POINTS:
        (point,) = stability(fitted(), [2.0], op=op).points
        (case,) = point.cases
        assert case.thevenin is not None
        longer = plant.with_overrides({"L_g": 0.15 + grid.x, "R_g": 0.01 + grid.r})
        at = operating_point(op)
        true = state_space(longer, replace(at, v=case.thevenin)).poles
        assert case.modes is not None
        assert max(np.abs(true - mode.pole).min() for mode in case.modes) < 1e-3  # of 1e4 rad/s


def test_the_source_follows_from_the_current_at_the_pcc():
    current = terminal_current(fitted(), "p=1,q=0.3")
    x_eq = PLANTS["paper_like"].equilibrium(operating_point("p=1,q=0.3"))
    true = np.asarray(PLANTS["paper_like"].dynamics.g(x_eq, [1.0, 0.0])).ravel()
    assert current is not None
    np.testing.assert_allclose(current, true, atol=1e-9)
    z = 0.02 + 0.5j
    assert thevenin_voltage(1.0, true, SeriesRL(z.real, z.imag, OMEGA_0)) == pytest.approx(
        abs(1 - z * complex(*true))
    )


def test_a_shunt_at_the_pcc_draws_its_current_from_the_grid_and_keeps_its_direct_term():
    text = PLANTS["paper_like"].program.rstrip() + (
        '\n    g.add("Shunt_RC", "cable", R=0.5, C=0.1)\n    g.connect("v_DQ", "cable.v")\n    '
        'g.connect("cable.i", "i_DQ")\n'
    )
    values = dict(PLANTS["paper_like"].diagram_values)
    record = record_at(parse_program(text), measured(["p=1,q=0.3"]), values)
    without = terminal_current(fitted(), "p=1,q=0.3")
    current = terminal_current(record, "p=1,q=0.3")
    assert without is not None
    assert current is not None
    admittance = 1 / (0.5 + 1 / 0.1j)  # series R, C at nominal frequency
    np.testing.assert_allclose(complex(*current), complex(*without) - admittance, atol=1e-9)
    (point,) = stability(record, [1.0, 2.0, 5.0]).points
    for case in point.cases:
        assert case.nyquist.certain
        assert case.modes is not None
        unstable = sum(1 if one.frequency == 0 else 2 for one in case.modes if not one.stable)
        assert case.nyquist.unstable_poles == unstable


# --- the Nyquist criterion
# ----------------------------------------------------------------------------------------------


def scalar_loop(gain):
    """Z and Y whose loop is gain(s) I."""

    def impedance(frequency):
        return gain(2j * np.pi * frequency)[:, None, None] * np.eye(2)

    return lambda frequency: -np.broadcast_to(np.eye(2), (len(frequency), 2, 2)), impedance


@pytest.mark.parametrize(("gain", "unstable"), [(4.0, 0), (10.0, 4)])
def test_three_equal_lags_lose_stability_at_a_gain_of_eight(gain, unstable):
    found = nyquist(*scalar_loop(lambda s: gain / (s + 1) ** 3), np.geomspace(1e-4, 1e3, 200))
    assert found.unstable_poles == unstable
    assert found.certain
    if not unstable:
        assert found.gain_margin == pytest.approx(
            2.0, rel=1e-2
        )  # linear between points 0.3 rad apart
        crossover = np.sqrt(gain ** (2 / 3) - 1)
        assert found.phase_margin == pytest.approx(
            180 - 3 * np.degrees(np.arctan(crossover)), abs=0.5
        )


def test_unstable_open_loops_are_counted_in():
    found = nyquist(
        *scalar_loop(lambda s: 2 / (s - 1)), np.geomspace(1e-4, 1e4, 100), open_loop_unstable=2
    )
    assert found.turns == 2
    assert found.stable
    weak = nyquist(
        *scalar_loop(lambda s: 0.5 / (s - 1)), np.geomspace(1e-4, 1e4, 100), open_loop_unstable=2
    )
    assert weak.unstable_poles == 2


def test_a_growing_determinant_is_closed_at_infinity():
    """det = (1 + s)^2 on an inductor: no unstable pole although its phase ends at 180 degrees."""
    found = nyquist(*scalar_loop(lambda s: s), np.geomspace(1e-4, 1e4, 100), growth=2)
    assert found.stable
    assert found.certain


def test_a_locus_of_rounding_alone_ends_within_bounds_and_is_not_certain():
    rng = np.random.default_rng(0)

    def noise(frequency: np.ndarray) -> np.ndarray:
        return 1e100 * rng.standard_normal((len(frequency), 2, 2)) * (1 + 1j)

    found = nyquist(
        noise,
        lambda frequency: np.broadcast_to(np.eye(2), (len(frequency), 2, 2)),
        np.geomspace(1, 1e3, 50),
    )
    assert not found.certain
    assert len(found.frequency) <= 100_000


def test_a_narrow_resonance_is_not_stepped_over():
    """1 + L = 0 is s^2 + (1e-4 - k) s + 1 = 0: unstable for k above 1e-4, a circle within 2e-5
    Hz.
    """
    poles = np.roots([1.0, 1e-4, 1.0])
    for gain, unstable in ((0.9e-4, 0), (1.1e-4, 4), (0.2, 4)):
        loop = scalar_loop(lambda s, k=gain: -k * s / (s**2 + 1e-4 * s + 1.0))
        assert nyquist(*loop, start_frequencies(poles)).unstable_poles == unstable


# --- poles, Nyquist and time
# ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("op", POINTS)
def test_poles_and_nyquist_count_the_same_on_every_grid(op):
    for case in found_at(op).cases:
        assert case.modes is not None
        assert case.nyquist.unstable_poles == sum(
            1 if one.frequency == 0 else 2 for one in case.modes if not one.stable
        )
        assert case.nyquist.certain


def test_critical_ratios_of_poles_and_nyquist_agree():
    found = [one for point in answer().points for one in point.critical]
    assert [one.unstable for one in found] == ["below", "below", "below", "above"]
    for one in found:
        assert one.scr_nyquist == pytest.approx(one.scr, rel=1e-3)  # asked: 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("op", POINTS)
def test_simulation_grows_on_one_side_of_a_critical_ratio_and_decays_on_the_other(op):
    for critical in found_at(op).critical:
        for factor in (0.97, 1.03):
            grid = of_ratio(critical.scr * factor, XR, OMEGA_0)
            response = step_behind_grid(
                PLANTS["paper_like"], operating_point(op), grid.r, grid.x, duration=2.0
            )
            assert response.stable == ((factor > 1) == (critical.unstable == "below"))


@pytest.mark.slow
def test_simulation_finds_the_critical_ratio_by_itself():
    found = critical_ratio(
        PLANTS["paper_like"], operating_point(POINTS[0]), 1.0, 1.5, xr=XR, duration=2.0, width=0.02
    )
    assert found == pytest.approx(found_at(POINTS[0]).critical[0].scr, rel=0.02)
    with pytest.raises(IbridError, match="must differ"):
        critical_ratio(
            PLANTS["paper_like"], operating_point(POINTS[0]), 3.0, 4.0, xr=XR, duration=1.0
        )


@pytest.mark.slow
def test_the_simulated_motion_grows_at_the_rate_of_the_pole():
    (point,) = stability(fitted(), [2.3], op="p=0,q=0").points
    modes = point.cases[0].modes
    assert modes is not None
    grid = of_ratio(2.3, XR, OMEGA_0)
    response = step_behind_grid(
        PLANTS["paper_like"], operating_point("p=0,q=0"), grid.r, grid.x, duration=4.0
    )
    assert response.growth == pytest.approx(
        modes[0].pole.real, rel=0.05
    )  # other modes still decay in the windows


@pytest.mark.slow
def test_the_interval_of_a_critical_ratio_is_its_finite_difference():
    name, deviation = "pll.kI_pll", 1e-3
    record = fitted()
    names = list(record.covariance["names"])
    matrix = np.zeros((len(names), len(names)))
    matrix[names.index(name), names.index(name)] = deviation**2
    record = replace(record, covariance={"names": names, "matrix": matrix.tolist()})
    for op, low, high in (("p=0,q=0", 2.0, 4.0), ("p=1,q=0.3", 1.0, 1.5)):
        (critical,) = stability(record, [low, high], op=op).points[0].critical
        ends = []
        for sign in (1, -1):
            values = {
                at: {**one, name: one[name] * np.exp(sign * deviation)}
                for at, one in record.parameters.items()
            }
            (moved,) = (
                stability(replace(record, parameters=values), [low, high], op=op).points[0].critical
            )
            ends.append(np.log(moved.scr))
        half = abs(ends[0] - ends[1]) / 2
        assert critical.interval is not None
        # bisection of 1e-6 on both sides
        assert np.log(critical.interval[1] / critical.scr) / 1.96 == pytest.approx(
            half, rel=2e-2, abs=2e-6
        )


@pytest.mark.slow
def test_a_record_of_separate_fits_answers_at_its_own_points_without_intervals():
    record = evaluated("gfl_pll_filter_exact", parameters="per-op")
    found = stability(record, [1.0, 3.0])
    assert [one.op for one in found.points] == list(record.parameters)
    assert all(critical.interval is None for one in found.points for critical in one.critical)
    with pytest.raises(IbridError, match="only a record with shared parameters"):
        stability(record, [1.0, 3.0], op="p=0.5,q=0")


# --- passivity
# ----------------------------------------------------------------------------------------------


def test_the_passivity_index_is_that_of_the_load_admittance():
    point = found_at("p=1,q=0.3")
    admittance = fitted().response("p=1,q=0.3", point.frequency[[5]])[0]
    index = np.linalg.eigvalsh(-(admittance + admittance.conj().T) / 2)[0]
    assert point.passivity.smallest[5] == pytest.approx(index)
    assert point.passivity.smallest[-1] > 0  # the filter's resistance, at the highest frequencies
    assert point.passivity.bands


# --- grids
# ----------------------------------------------------------------------------------------------


def test_a_short_circuit_ratio_is_one_over_the_impedance():
    grid = of_ratio(2.5, 5.0, OMEGA_0)
    assert grid.scr == pytest.approx(2.5)
    assert grid.x / grid.r == pytest.approx(5.0)
    at_nominal = grid.impedance(np.array([0.0]))[0]
    np.testing.assert_allclose(at_nominal, [[grid.r, -grid.x], [grid.x, grid.r]])


def test_ranges_of_ratios_are_logarithmic_and_hold_both_ends():
    np.testing.assert_allclose(ratios("1:100:3"), [1.0, 10.0, 100.0])
    assert len(ratios("1.5:10")) == 12
    np.testing.assert_array_equal(ratios("3"), [3.0])
    assert series_rl("r=0.1, x=0.5", OMEGA_0) == SeriesRL(0.1, 0.5, OMEGA_0)


@pytest.mark.parametrize("scr", [1e-6, 1e9])
@pytest.mark.parametrize("xr", [1e-6, 10.0, 1e9, np.inf])
def test_the_ends_of_the_ratios_are_grids_that_can_be_written_too(scr: float, xr: float):
    grid = of_ratio(scr, xr, OMEGA_0)
    assert series_rl(f"r={grid.r!r},x={grid.x!r}", OMEGA_0) == grid


def sampled(grid: SeriesRL, frequency: np.ndarray) -> Sweep:
    """A grid as a measured sweep: the admittance that its current into the grid has."""
    point = PointSweep(
        OperatingPoint("grid", 1.0, 0.0), frequency, np.linalg.inv(grid.impedance(frequency))
    )
    return Sweep((point,), source="a grid")


@pytest.mark.slow
def test_a_measured_grid_gives_the_same_count_and_margins_as_its_values():
    for scr in (1.05, 1.3, 4.0):
        grid = of_ratio(scr, XR, OMEGA_0)
        seen = measured_grid(sampled(grid, np.geomspace(1.0, 5000.0, 200)), 60.0)
        one = stability(fitted(), grid=seen, op=POINTS[0]).points[0].cases[0]
        other = stability(fitted(), grid=grid, op=POINTS[0]).points[0].cases[0]
        assert one.modes is None
        assert one.nyquist.unstable_poles == other.nyquist.unstable_poles
        assert one.nyquist.vector_margin == pytest.approx(other.nyquist.vector_margin, rel=0.05)


def test_a_measured_grid_goes_on_beyond_its_ends_as_a_series_rl():
    grid = SeriesRL(0.05, 0.5, OMEGA_0)
    seen = measured_grid(sampled(grid, np.geomspace(10.0, 1000.0, 50)), 60.0)
    frequency = np.array([0.1, 9.0, 30.0, 5000.0])
    np.testing.assert_allclose(
        seen.impedance(frequency), grid.impedance(frequency), rtol=1e-4, atol=1e-5
    )


def test_a_grid_that_gives_instead_of_taking_is_questioned():
    frequency = np.geomspace(1.0, 1000.0, 20)
    seen = sampled(SeriesRL(0.05, 0.5, OMEGA_0), frequency).points[0]
    turned = Sweep((replace(seen, admittance=-np.asarray(seen.admittance)),), source="turned.csv")
    assert any("counted" in one for one in measured_grid(turned, 60.0).warnings)


def test_a_grid_file_must_hold_one_sweep_at_the_same_nominal_frequency():
    with pytest.raises(IbridError, match="one sweep, found 2"):
        measured_grid(measured(["p=1,q=0.3", "p=1,q=0"]), 60.0)
    with pytest.raises(IbridError, match="60 and 50 Hz"):
        measured_grid(measured(["p=1,q=0.3"]), 50.0)


def test_interpolation_passes_through_the_measured_points():
    grid = SeriesRL(0.05, 0.5, OMEGA_0)
    frequency = np.geomspace(1.0, 1000.0, 9)
    seen = MeasuredGrid("grid", frequency, grid.impedance(frequency), OMEGA_0)
    np.testing.assert_allclose(seen.impedance(frequency), grid.impedance(frequency), rtol=1e-12)


def test_a_grid_file_on_other_bases_gives_the_answer_of_its_ohms_and_says_what_is_assumed():
    """The per-unit values of a file on 100 MVA are 100 / 2.75 times those of the same ohms on 2.75
    MVA.
    """
    based = replace(
        fitted(), settings={**fitted().settings, "bases": {"s_base_va": 2.75e6, "v_base_v": 690.0}}
    )
    own = sampled(of_ratio(1.3, XR, OMEGA_0), np.geomspace(1.0, 5000.0, 20))
    other = (replace(own.points[0], admittance=own.points[0].admittance * 2.75 / 100),)
    cases = [
        (based, replace(own, s_base_va=2.75e6, v_base_v=690.0), None),
        (
            based,
            Sweep(other, s_base_va=100e6, v_base_v=690.0, source="a grid"),
            "a grid is on a base of 1e+08 VA and 690 V",
        ),
        (based, own, "a grid does not tell both s_base_va"),
        (
            fitted(),
            replace(own, s_base_va=1e6, v_base_v=690.0),
            "the record does not tell both s_base_va",
        ),
        (fitted(), own, None),
    ]
    margins = []
    for record, sweep, words in cases:
        (point,) = stability(record, grid=measured_grid(sweep, 60.0), op=POINTS[0]).points
        margins.append(point.cases[0].nyquist.vector_margin)
        assert [one for one in point.warnings if "base" in one] == [
            one for one in point.warnings if words and words in one
        ]
        assert words is None or any(words in one for one in point.warnings)
    np.testing.assert_allclose(margins, margins[0], rtol=1e-9)


def test_margins_count_a_real_unstable_pole_as_the_least_damping():
    case = found_at(POINTS[0]).cases[-1]
    assert case.stable
    lost = replace(case, modes=(Mode(27.5 + 0j, ()), *(case.modes or ())))
    assert (lost.margins["gain"], lost.margins["phase_deg"], lost.margins["least_damping"]) == (
        None,
        None,
        -1.0,
    )


# --- command line and page
# ----------------------------------------------------------------------------------------------


@pytest.fixture
def record_file(tmp_path):
    fitted().write(tmp_path / "fit.json")
    return tmp_path / "fit.json"


@pytest.mark.slow
def test_the_command_prints_the_answer_and_writes_json_and_page(record_file, capsys):
    out, page = record_file.with_name("stability.json"), record_file.with_name("stability.html")
    command = [
        "stability",
        str(record_file),
        "--scr",
        "1:4:5",
        "--op",
        "p=1,q=0.3",
        "--json",
        str(out),
        "--report",
        str(page),
    ]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "unstable below SCR 1.122" in printed
    assert max(map(len, printed.splitlines())) <= 110
    content = json.loads(out.read_text())
    assert content["schema"] == "ibrid.stability/1"
    (point,) = content["points"]
    assert point["critical"][0]["scr"] == pytest.approx(1.122, abs=1e-3)
    assert len(point["grids"]) == 5
    for grid in point["grids"]:
        assert set(grid["margins"]) == {"gain", "phase_deg", "frequency_hz", "least_damping"}
        gain, phase, _, damping = grid["margins"].values()
        if not grid["stable"]:
            assert (grid["grade"], gain, phase, damping < 0) == ("unstable", None, None, True)
            continue
        slim = phase < 10 or gain < 1.25 or damping < 0.01
        assert grid["grade"] == ("barely stable" if slim else "stable")
    assert "barely stable" in {
        grid["grade"] for grid in point["grids"]
    }  # phase margins of 1 degree
    assert "barely stable at SCR" in " ".join(printed.split())
    assert " degrees" in printed
    assert len(point["passivity"]["index"]) == len(point["passivity"]["frequency_hz"])
    text = page.read_text()
    assert "http" not in text.replace("http-equiv", "")
    assert text.count("<svg role") == 3
    assert "critical SCR" in Reader(text).text
    assert '<span class="good">stable' not in text
    assert "real part of the eigenvalue" in text


@pytest.mark.slow
def test_one_grid_by_its_values_and_one_by_its_file(record_file, capsys):
    assert main(["stability", str(record_file), "--grid", "r=0.05,x=0.5", "--op", "p=1,q=0.3"]) == 0
    assert "stable at SCR 1.99" in capsys.readouterr().out
    file = record_file.with_name("grid.csv")
    ibrid.write_sweep(sampled(of_ratio(1.05, XR, OMEGA_0), np.geomspace(1.0, 5000.0, 100)), file)
    assert main(["stability", str(record_file), "--grid", str(file), "--op", "p=1,q=0.3"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "UNSTABLE on" in printed
    assert "by the Nyquist count alone" in printed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--scr", "0:10"], "positive number, found 0"),
        (["--scr", "-1:10"], "positive number, found -1"),
        (["--scr", "10:1.5"], "the weaker grid first"),
        (["--scr", "2:2"], "write 2 for one"),
        (["--scr", "10:2"], "the weaker grid first"),
        (["--scr", "few"], "found 'few'"),
        (["--scr", "1:2:3:4"], "found '1:2:3:4'"),
        (["--scr", "inf"], "positive number, found inf"),
        (["--scr", "1:10", "--xr", "0"], "positive number"),
        (["--scr", "1:10", "--op", "nonsense"], "no operating point 'nonsense'"),
        (["--scr", "1:10", "--op", "p=9,q=0"], "no real operating point"),
        (["--scr", "1:10", "--report", "/nowhere/page.html"], "no folder"),
        (["--scr", "1:10", "--json", "/nowhere/out.json"], "no folder"),
        (["--grid", "r=0.1"], "both r and x"),
        (["--grid", "r=-1,x=0.2"], "zero or positive"),
        (["--grid", "r=1e308,x=1e308"], "the resistance r of a grid must be 0 to 1e+09 per unit"),
        (["--grid", "r=0,x=1e-320"], "the reactance x of a grid must be 1e-18 to 1e+09 per unit"),
        (["--grid", "r=0.1,x=0.2,r=0.3"], "each once"),
        (["--grid", "missing.csv"], "no such file"),
        (["--grid", "r=0.1,x=0.2", "--xr", "3"], "--xr belongs to --scr"),
        (["--grid", "r=0.1,x=0.2", "--scr", "1:2"], "; give one"),
    ],
)
def test_wrong_inputs_get_one_sentence(record_file, capsys, options, words):
    assert main(["stability", str(record_file), *options]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1


def test_damaged_records_get_one_sentence(tmp_path, capsys):
    content = fitted().to_json()
    for change in (
        {"program": "g.add("},
        {"settings": {}},
        {"parameters": {"p=1,q=0.3": {}}},
        {"outcome": "failed"},
    ):
        (tmp_path / "broken.json").write_text(json.dumps({**content, **change}))
        assert main(["stability", str(tmp_path / "broken.json"), "--scr", "1:10"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_an_unstable_model_is_called_one():
    found = found_at("p=0,q=0")
    assert any("unstable by itself" in one for one in found.warnings)
    assert any("outside the measured range" in one for one in found.warnings)
    assert not found_at("p=1,q=0.3").warnings


def test_usual_ratios_are_asked_where_none_are_said():
    record = ibrid.evaluate("gfl_l_filter", "gfl_l_filter", restarts=0)
    (first, *_) = ibrid.stability(record).points
    assert [case.grid.scr for case in first.cases] == pytest.approx([1.5, 2.0, 3.0, 5.0, 10.0])
