"""evaluate: errors by part against direct formulas, the reward, outcomes, and work that is
counted.
"""

import itertools
import math
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from fitted import benchmark, changed, evaluated

import ibrid
from ibrid.errors import IbridError, OperatingPointError
from ibrid.evaluation.errors_by_part import error_parts
from ibrid.evaluation.outcome import reward
from ibrid.fit import ipopt
from ibrid.fit.settings import EFFORTS, FitSettings, fit_settings
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.published import PLANTS
from ibrid.plants.sweeping import sweep as swept
from ibrid.signals import Signal

BANDS = {"5-50": (0, 50), "50-500": (50, 500), "500-2000": (500, 2000), "2000-5000": (2000, np.inf)}
ENTRIES = {"dd": (0, 0), "dq": (0, 1), "qd": (1, 0), "qq": (1, 1)}
NAIVE = ibrid.program_text(ibrid.textbook("naive"))


# errors by part


@pytest.mark.slow
@pytest.mark.parametrize("name", ["naive", "gfl_exact"])
def test_errors_by_point_band_and_entry_follow_their_formulas(name):
    record = evaluated(name)
    bands, entries, shares = ({key: [] for key in keys} for keys in (BANDS, ENTRIES, BANDS))
    for point in benchmark().points:
        error = record.response(point.op.name, point.frequency) - point.admittance
        size = point.admittance
        assert record.nrmse_by_op[point.op.name] == pytest.approx(
            np.sqrt((np.abs(error) ** 2).sum() / (np.abs(size) ** 2).sum())
        )
        for band, (low, high) in BANDS.items():
            here = (point.frequency >= low) & (point.frequency < high)
            bands[band].append(np.linalg.norm(error[here]) / np.linalg.norm(size[here]))
            shares[band].append(np.linalg.norm(error[here]) ** 2 / np.linalg.norm(error) ** 2)
            for entry, (i, j) in ENTRIES.items():
                part = np.linalg.norm(error[here, i, j]) / np.linalg.norm(size[here, i, j])
                assert record.nrmse_by_part[point.op.name][band][entry] == pytest.approx(part)
        for entry, (i, j) in ENTRIES.items():
            entries[entry].append(np.linalg.norm(error[:, i, j]) / np.linalg.norm(size[:, i, j]))
    assert record.nrmse == pytest.approx(np.mean(list(record.nrmse_by_op.values())))
    assert record.nrmse_by_band == pytest.approx(
        {key: np.mean(values) for key, values in bands.items()}
    )
    assert record.nrmse_by_entry == pytest.approx(
        {key: np.mean(values) for key, values in entries.items()}
    )
    assert record.share_by_band == pytest.approx(
        {key: np.mean(values) for key, values in shares.items()}
    )
    assert sum(record.share_by_band.values()) == pytest.approx(1)


@pytest.mark.parametrize(("frequencies", "told"), [(1, True), (2, False)])
def test_as_many_free_numbers_as_measured_ones_are_told(frequencies, told):
    points = tuple(
        replace(one, frequency=one.frequency[:frequencies], admittance=one.admittance[:frequencies])
        for one in benchmark().points[:1]
    )
    diagram = ibrid.textbook("gfl_pll_filter_exact")
    record = ibrid.evaluate(diagram, replace(benchmark(), points=points), restarts=0)
    sentence = "13 free numbers were fitted to 8 measured ones at p=1,q=0.3"
    assert any(one.startswith(sentence) for one in record.warnings) is told


def part_errors(frequencies: list[list[float]], seed: int = 0):
    rng = np.random.default_rng(seed)
    points, responses = [], []
    for number, frequency in enumerate(frequencies):
        shape = (len(frequency), 2, 2)
        measured, model = (rng.normal(size=shape) + 1j * rng.normal(size=shape) for _ in range(2))
        points.append(
            PointSweep(OperatingPoint(f"point {number}", 1.0, 0.0), np.array(frequency), measured)
        )
        responses.append(model)
    return error_parts(responses, tuple(points))


def test_the_first_and_last_band_are_open_and_edges_belong_to_the_band_above():
    parts = part_errors([[0.1, 50.0, 500.0, 2000.0, 1e5]])
    assert all(value is not None for value in parts.by_band.values())
    only_high = part_errors([[2000.0, 1e5]])
    assert only_high.by_band["500-2000"] is None
    assert only_high.share_by_band == {
        "5-50": None,
        "50-500": None,
        "500-2000": None,
        "2000-5000": pytest.approx(1),
    }
    assert only_high.table["point 0"]["5-50"] == dict.fromkeys(ENTRIES)


def test_shares_add_up_to_one_where_operating_points_have_different_bands():
    parts = part_errors([[10.0, 20.0], [10.0, 100.0, 1000.0, 4000.0], [100.0, 4000.0]])
    assert sum(
        value for value in parts.share_by_band.values() if value is not None
    ) == pytest.approx(1)


@pytest.mark.slow
def test_an_entry_that_is_measured_as_zero_has_no_relative_error():
    record = ibrid.evaluate(
        ibrid.textbook("gfl_exact"),
        changed(benchmark(), lambda y: y * np.array([[1, 0], [1, 1]])),
        restarts=0,
    )
    assert record.outcome == "ok"
    assert record.nrmse_by_entry["dq"] is None
    assert record.nrmse is not None
    assert record.nrmse > 0.05


# reward and outcomes


def test_the_reward_is_minus_the_logarithm_of_the_error():
    assert evaluated("naive").reward == pytest.approx(-math.log(evaluated("naive").nrmse + 1e-8))
    assert reward(0.0) == pytest.approx(8 * math.log(10))
    assert reward(0.0432) == pytest.approx(3.1419, abs=1e-4)
    errors = np.logspace(-12, 12, 40)
    rewards = [reward(error) for error in errors]
    assert all(better > worse for better, worse in itertools.pairwise(rewards))


def test_nothing_without_a_fit_beats_the_worst_fit():
    for nothing in (None, math.nan, math.inf):
        assert reward(nothing) < reward(1e300)
    diagram = ibrid.parse_program(NAIVE.replace('    g.connect("v_DQ", "gain.in_")\n', ""))
    invalid = ibrid.evaluate(diagram, benchmark())
    assert invalid.outcome == "invalid"
    assert "gain.in_" in invalid.reasons[0]
    assert invalid.reward < reward(1e30)


def test_a_diagram_in_another_vocabulary_is_invalid_with_a_reason_per_violation():
    record = ibrid.evaluate(ibrid.textbook("gfl_exact"), benchmark(), vocabulary="paper")
    assert record.outcome == "invalid"
    assert any("JMul_omega" in reason for reason in record.reasons)
    assert record.nrmse is None
    assert record.parameters == {}


class Broken:
    """State space of a unit gain that raises once `broken`."""

    broken: BaseException | None = None

    def __call__(self, k):
        if self.broken is not None:
            raise self.broken
        return [], [], [[], []], [[k, 0], [0, k]]


@pytest.mark.parametrize("error", [KeyError("no such gain"), SystemExit(3), ZeroDivisionError()])
def test_what_a_kind_of_ones_own_breaks_off_with_is_one_sentence(error):
    law = Broken()
    kind = ModuleKind(
        name="Odd",
        family="static",
        law="out = k in_",
        inputs={"in_": Signal.DQ_VEC},
        outputs={"out": Signal.DQ_VEC},
        states=(),
        parameters={"k": Range(0.1, 10.0, 1.0, "1", "gain")},
        state_space=law,
        reference="a test",
    )
    diagram = ibrid.parse_program(NAIVE.replace('"Gain_dq", "gain"', '"Odd", "gain"'))
    law.broken = error
    try:
        with pytest.raises(
            IbridError, match=f"the law of Odd broke off with {type(error).__name__}"
        ):
            ibrid.evaluate(diagram, benchmark(), vocabulary=(*VOCABULARY, kind))
    finally:
        law.broken = None
    assert (
        ibrid.evaluate(diagram, benchmark(), vocabulary=(*VOCABULARY, kind), restarts=0).outcome
        == "ok"
    )


def test_a_mistake_of_ours_is_no_fault_of_a_kind(monkeypatch):
    def mistaken(*_, **__):
        raise KeyError("ours")

    monkeypatch.setattr(sys.modules["ibrid.evaluation.evaluate"], "fit", mistaken)
    with pytest.raises(KeyError, match="ours"):
        ibrid.evaluate(ibrid.textbook("naive"), benchmark())


def test_a_fit_counts_its_work_and_no_clock_ends_it(monkeypatch):
    expected = evaluated("gfl_exact").to_json()
    readings = itertools.count(0.0, 3600.0)
    for name in ("time", "monotonic", "perf_counter", "process_time"):
        monkeypatch.setattr(time, name, lambda: next(readings))
    assert ibrid.evaluate(ibrid.textbook("gfl_exact"), benchmark()).to_json() == expected


def test_a_round_of_hops_more_than_may_be_is_not_made():
    few, many = (
        ibrid.evaluate(
            ibrid.textbook("gfl"), benchmark(), settings=FitSettings(restarts=0, most_hops=most)
        )
        for most in (1, 4)
    )
    assert few.starts["evaluations"] < many.starts["evaluations"]
    assert many.nrmse <= few.nrmse * (1 + 1e-12)  # hops only ever gain


@pytest.mark.parametrize("effort", EFFORTS)
def test_a_fit_says_its_effort_and_more_of_it_is_never_worse(effort):
    record = ibrid.evaluate(ibrid.textbook("gfl"), benchmark(), settings=fit_settings(effort))
    assert record.settings["effort"] == effort
    best = ibrid.evaluate(ibrid.textbook("gfl"), benchmark(), settings=fit_settings("high")).nrmse
    assert record.nrmse >= best * (1 - 1e-6)


@pytest.mark.slow
def test_an_interruption_inside_the_solver_gets_out(monkeypatch, capfd):
    """Ctrl-C while Ipopt calls back: CasADi would print a traceback and go on."""
    real, calls = ipopt._LastPoint.gradient, []

    def interrupted(self, x):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(self, x)

    monkeypatch.setattr(ipopt._LastPoint, "gradient", interrupted)
    with pytest.raises(KeyboardInterrupt):
        ibrid.evaluate(ibrid.textbook("gfl_exact"), benchmark(), restarts=0)
    assert "Traceback" not in "".join(capfd.readouterr())


# threads


@pytest.mark.slow
def test_a_fit_in_another_thread_gives_the_same_record():
    found = {}

    def work(number: int) -> None:
        record = ibrid.evaluate(ibrid.textbook("gfl_exact"), benchmark())
        found[number] = {key: value for key, value in record.to_json().items() if key != "seconds"}

    threads = [threading.Thread(target=work, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    expected = {
        key: value for key, value in evaluated("gfl_exact").to_json().items() if key != "seconds"
    }
    assert [found[number] for number in range(3)] == [expected] * 3


# options


@each_of(
    ("options", "words"),
    [
        ({"parameters": "share"}, "did you mean shared"),
        ({"equilibrium": "exakt"}, "did you mean exact"),
        ({"vocabulary": "extendet"}, "did you mean extended"),
        ({"objective": "nrms"}, "did you mean nrmse"),
        ({"objective": "log"}, "objective must be one of nrmse, relative, band, sigma"),
        ({"restarts": -1}, "restarts must be a whole number of 0 or more, found -1"),
        ({"restarts": "many"}, "restarts must be a whole number or None, found 'many'"),
        ({"restarts": 1.5}, "restarts must be a whole number"),
        ({"holdout_op": "p=1,q=0.2"}, r"did you mean p=1,q=0\.3"),
        ({"holdout_op": ("p=1,q=0.3", "p=1,q=-0.3")}, "leave at least one to fit"),
        ({"holdout_op": "p=1,q=0.3", "parameters": "per-op"}, "only with shared parameters"),
        (
            {"holdout_op": "p=1,q=0.3", "equilibrium": "paper"},
            "only with shared parameters and the exact equilibrium",
        ),
    ],
)
def test_a_wrong_option_is_one_sentence_that_names_the_near_ones(options, words):
    with pytest.raises((IbridError, OperatingPointError), match=words) as raised:
        ibrid.evaluate(ibrid.textbook("naive"), benchmark(), **options)
    assert "\n" not in str(raised.value)


@each_of(
    ("options", "words"),
    [
        ({"objective": "relativ"}, "did you mean relative"),
        ({"most_hops": -1}, "most_hops must be a whole number of 0 or more"),
        ({"descents": 0}, "descents must be a whole number of 1 or more"),
        ({"starts": 0}, "starts must be a whole number of 1 or more"),
        ({"kept_misfit": 0}, "kept_misfit must be"),
        ({"iterations": -1}, "iterations must be"),
        ({"ipopt_iterations": -1}, "ipopt_iterations must be"),
        ({"hops": -1}, "hops must be"),
    ],
)
def test_wrong_settings_are_one_sentence(options, words):
    with pytest.raises(IbridError, match=words) as raised:
        FitSettings(**options)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"starts": 1, "kept": 1},
        {"kept": 300},
        {"halving": ()},
        {"iterations": 0},
        {"ipopt_iterations": 0},
    ],
)
def test_unusual_settings_still_fit(options):
    record = ibrid.evaluate(
        ibrid.textbook("naive"), benchmark(), settings=FitSettings(restarts=1, **options)
    )
    assert record.outcome == "ok"
    assert record.nrmse is not None
    assert record.nrmse < 1.2


@pytest.mark.slow
def test_grid_forming_inverters_that_absorb_power_are_fitted():
    missed = []
    for name, *powers in (("gfm_droop", 0.8, -0.5), ("gfm_vsm", -0.9), ("hybrid_gfl_gfm", -1.0)):
        points = [OperatingPoint(f"p = {p}", p, 0.1) for p in powers]
        sweep = swept(PLANTS[name], points, np.geomspace(5.0, 1000.0, 20))
        record = ibrid.evaluate(ibrid.textbook(name), sweep)
        missed += (
            []
            if record.nrmse is not None and record.nrmse < 1e-9
            else [(name, record.reasons, record.nrmse)]
        )
    assert not missed
