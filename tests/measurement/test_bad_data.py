"""Wrong, thin and odd measurements: refused in one sentence, or fitted as far as they go."""

from dataclasses import replace

import numpy as np
import pytest
from fitted import GRID, benchmark, changed, evaluated, measured

import ibrid
from ibrid.errors import IbridError, SweepError
from ibrid.measurement.conventions.contradictions import check_conventions
from ibrid.measurement.formats.frd import from_responses
from ibrid.measurement.importing.foreign_table import frame_table
from ibrid.measurement.recordings.events import EventRecord
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.plants import PLANTS

EXACT = "gfl_pll_filter_exact"


def fitted(sweep, name: str = EXACT, **options):
    record = ibrid.evaluate(ibrid.textbook(name), sweep, **options)
    assert record.outcome == "ok", record.reasons
    assert record.nrmse is not None
    return record


# refused


@pytest.mark.parametrize("value", ["nan", "inf", "-", ""])
def test_a_value_that_is_no_number_is_refused_with_file_and_line(tmp_path, value):
    path = tmp_path / "measured.csv"
    ibrid.write_sweep(benchmark(), path)
    lines = path.read_text(encoding="utf-8").splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("op,")) + 1
    cells = lines[first + 2].rsplit(",", 1)
    lines[first + 2] = f"{cells[0]},{value}"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(SweepError, match=rf"measured\.csv.*{first + 3}") as raised:
        ibrid.read_sweep(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_array_with_a_value_that_is_no_number_is_refused(value):
    with pytest.raises(SweepError, match="finite"):
        changed(benchmark(), lambda y: np.where(np.arange(16)[:, None, None] == 3, value, y))


HZ = np.geomspace(5.0, 500.0, 4)
MASK = np.arange(4) == 2
Y = np.stack([(1 + 0.1j * k) * np.eye(2) for k in range(4)])
MASKED_Y = np.ma.array(Y, mask=np.broadcast_to(MASK[:, None, None], Y.shape))


@pytest.mark.parametrize(
    ("frequency", "matrices", "words"),
    [
        (np.ma.array(HZ, mask=MASK), Y, "frequencies must have no masked numbers.* found 1"),
        (HZ, MASKED_Y, "the response must have no masked numbers.* found 4"),
        (HZ, list(MASKED_Y), "the response must have no masked numbers.* found 4"),
    ],
)
def test_masked_numbers_are_not_taken_as_measured(frequency, matrices, words):
    with pytest.raises(SweepError, match=words):
        ibrid.read_sweep((frequency, matrices), p=0.8, q=0.1)
    with pytest.raises(SweepError, match=words):
        from_responses(frequency, matrices, p=0.8, q=0.1)
    with pytest.raises(SweepError, match="masked"):
        PointSweep(benchmark().points[0].op, frequency, np.ma.array(matrices))


def test_arrays_in_which_nothing_is_masked_are_read():
    sweep = ibrid.read_sweep((np.ma.array(HZ), np.ma.array(Y)), p=0.8, q=0.1)
    np.testing.assert_array_equal(sweep.points[0].admittance, Y)


def test_masked_samples_of_a_record_are_refused():
    still = np.tile([1.0, 0.0], (4, 1))
    with pytest.raises(SweepError, match="i of record full must have no masked numbers"):
        EventRecord(
            OperatingPoint("full", 1.0, 0.0), HZ, still, np.ma.masked_greater(still, 0.5), 0.1
        )


def test_masked_cells_of_a_table_are_empty():
    """As of a table of astropy, which has columns with a mask."""

    class Columns(dict):
        columns = property(dict.keys)

    table = frame_table(Columns(f=np.ma.array(HZ, mask=MASK), n=np.ma.array([1, 2, 3, 4])))
    np.testing.assert_array_equal(table.columns["f"], np.where(MASK, np.nan, HZ))
    np.testing.assert_array_equal(table.columns["n"], [1, 2, 3, 4])


@pytest.mark.parametrize("names", ["f,p,q,x,x", "op,p,q,freq_hz,p"])
def test_a_column_that_is_there_twice_is_named(names):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(np.ones((4, 5)), columns=names.split(","))
    with pytest.raises(
        SweepError, match=f"column '{names[-1]}' must be there once; found it twice"
    ):
        ibrid.read_sweep(frame)


def test_an_admittance_of_zero_at_one_frequency_is_refused_by_name():
    blank = changed(benchmark(), lambda y: np.where(np.arange(16)[:, None, None] == 3, 0.0, y))
    with pytest.raises(
        SweepError,
        match=r"the admittance of p=1,q=0\.3 is zero at 19\.9\d* Hz; leave that frequency out",
    ):
        ibrid.evaluate(ibrid.textbook("naive"), blank)


def test_an_admittance_of_zero_throughout_is_refused():
    with pytest.raises(SweepError, match="must not be zero throughout"):
        changed(benchmark(), lambda y: 0 * y)


# thin


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 3, 8, 15])
def test_a_single_frequency_is_fitted_and_the_rest_called_open(row):
    record = fitted(changed(benchmark(), kept=lambda _: slice(row, row + 1)))
    assert record.nrmse < 1e-4  # 16 numbers for 13 parameters
    one = fitted(changed(benchmark(), kept=lambda _: slice(row, row + 1)).only("p=1,q=0.3"))
    assert one.nrmse < 1e-4
    assert any("changing" in sentence or "together" in sentence for sentence in one.identifiability)


@pytest.mark.parametrize("top", [60.0, 60.0 * (1 + 1e-9)])
def test_a_sweep_up_to_the_nominal_frequency_is_fitted(top):
    """At f0 the sequence resonance makes the matrix S of the high-frequency seed singular."""
    record = fitted(
        measured(["p=1,q=0.3", "p=1,q=-0.3"], frequency=np.array([5.0, 10.0, 20.0, 40.0, top]))
    )
    assert record.nrmse < 1e-5
    assert record.nrmse_by_band["500-2000"] is None


def test_one_operating_point_is_enough_for_a_fit():
    record = fitted(benchmark().only("p=1,q=-0.3"))
    assert record.nrmse < 1e-5
    assert list(record.parameters) == ["p=1,q=-0.3"]


@pytest.mark.slow
def test_operating_points_may_have_different_frequencies():
    apart = changed(benchmark(), kept=lambda number: slice(0, 9) if number == 0 else slice(4, 16))
    record = fitted(apart)
    assert record.nrmse < 1e-5
    assert record.settings["frequency_hz"] == [5.0, 5000.0]
    biased = fitted(apart, "gfl_exact")
    assert sum(
        share for share in biased.share_by_band.values() if share is not None
    ) == pytest.approx(1)
    assert biased.nrmse_by_part["p=1,q=0.3"]["2000-5000"]["dd"] is None
    assert biased.nrmse_by_part["p=1,q=-0.3"]["2000-5000"]["dd"] is not None


def test_two_operating_points_with_the_same_setpoint_are_fitted_together():
    twice = replace(
        benchmark(),
        points=(
            benchmark().points[0],
            replace(benchmark().points[0], op=replace(benchmark().points[0].op, name="again")),
        ),
    )
    record = fitted(twice)
    assert record.nrmse < 1e-5
    assert any("same p, q, v" in warning for warning in ibrid.inspect(twice).warnings)


# wrong


@pytest.mark.slow
def test_an_entry_that_is_zero_throughout_leaves_a_finite_record():
    record = fitted(
        changed(benchmark(), lambda y: y * np.array([[1, 0], [1, 1]])), "gfl_exact", restarts=0
    )
    assert 0.05 < record.nrmse < 1.5
    assert record.nrmse_by_entry["dq"] is None


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["relative", "band"])
def test_every_objective_copes_with_an_entry_that_is_zero(objective):
    blank = changed(benchmark(), lambda y: y * np.array([[1, 0], [1, 1]]))
    assert 0.05 < fitted(blank, "naive", objective=objective, restarts=0).nrmse < 2


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_data_in_wrong_units_fit_badly_and_inspection_says_so(factor):
    wrong = changed(
        measured(["p=1,q=0.3", "p=1,q=-0.3"], frequency=np.concatenate([[1.0, 1.1], GRID])),
        lambda y: factor * y,
    )
    assert fitted(wrong, restarts=1).nrmse > 0.3
    warnings = ibrid.inspect(wrong).warnings
    assert any("unit" in warning or "base" in warning for warning in warnings), warnings


@pytest.mark.nightly
def test_data_with_the_other_sign_of_current_fit_badly_and_the_convention_test_says_so():
    turned = changed(benchmark(), lambda y: -y)
    assert fitted(turned, restarts=1).nrmse > 0.3
    found = check_conventions(turned)
    assert found.status == "doubt"
    assert any("current" in warning for warning in found.warnings)
    assert check_conventions(benchmark()).status == "agree"


@pytest.mark.slow
def test_data_with_the_other_q_axis_fit_badly():
    mirror = np.array([[1, -1], [-1, 1]])
    assert fitted(changed(benchmark(), lambda y: y * mirror), restarts=1).nrmse > 0.05


@pytest.mark.parametrize("p", [5.0, -20.0, 5000.0])
def test_a_power_that_the_grid_cannot_carry_is_a_failure_in_one_sentence(p):
    far = changed(benchmark(), op=lambda op: replace(op, p=p))
    record = ibrid.evaluate(ibrid.textbook(EXACT), far)
    assert record.outcome == "failed"
    (reason,) = record.reasons
    assert "no start has a real operating point" in reason
    assert "check p, q, v and their per-unit base" in reason
    assert record.nrmse is None
    assert record.reward < 0


def test_an_impossible_point_among_the_held_out_ones_is_a_failure_in_one_sentence():
    first, second = benchmark().points
    far = replace(benchmark(), points=(first, replace(second, op=replace(second.op, p=6.0))))
    record = ibrid.evaluate(ibrid.textbook(EXACT), far, holdout_op=second.op.name)
    assert record.outcome == "failed"
    assert record.reasons == (
        "the best parameters have no real operating point at p=1,q=-0.3; check p, q and v",
    )


# odd


@pytest.mark.nightly
def test_forty_operating_points_are_fitted_at_once():
    texts = [
        f"p={p:.3g},q={q:.3g}" for p in np.linspace(0.1, 1, 10) for q in (-0.3, -0.1, 0.1, 0.3)
    ]
    record = fitted(measured(texts))
    assert record.nrmse < 1e-5
    assert len(record.poles) == 40
    apart = fitted(measured(texts), parameters="per-op", restarts=0)
    assert apart.nrmse < 1e-5
    assert apart.free_parameters == 40 * 13


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [('"quoted", ü\\', "0"), ("a/b", "a.b"), ("None", "nan"), ("__class__", "{op}")]
)
def test_operating_points_may_have_odd_names(names, tmp_path):
    points = tuple(
        replace(point, op=replace(point.op, name=name))
        for point, name in zip(benchmark().points, names, strict=True)
    )
    record = fitted(replace(benchmark(), points=points))
    assert record.nrmse == pytest.approx(evaluated(EXACT).nrmse, abs=1e-9)
    assert list(record.nrmse_by_op) == list(names)
    record.write(tmp_path / "record.json")
    again = ibrid.read_record(tmp_path / "record.json")
    assert list(again.parameters) == list(names)
    assert again.state_space(names[1]).nstates == 13


@pytest.mark.slow
def test_another_voltage_and_nominal_frequency_are_taken_into_account():
    sweep = measured(["p=0.9,q=0.1,v=1.05", "p=0.6,q=-0.2,v=0.95"], "kuleuven_600mva")
    assert sweep.f0_hz == 50.0
    record = ibrid.evaluate(ibrid.parse_program(PLANTS["kuleuven_600mva"].program), sweep)
    assert record.nrmse is not None
    assert record.nrmse < 1e-5
    wrong_v = changed(sweep, op=lambda op: replace(op, v=1.0))
    biased = ibrid.evaluate(ibrid.parse_program(PLANTS["kuleuven_600mva"].program), wrong_v)
    assert biased.nrmse is not None
    assert biased.nrmse > 1e-4


def test_unordered_frequencies_are_refused():
    point = benchmark().points[0]
    with pytest.raises(IbridError, match="ascend"):
        PointSweep(point.op, point.frequency[::-1], point.admittance)
