"""A dead zone and a current limit, hidden in devices that are simulated in time, in the gap
workflow: named, or refused.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effects_page import effects_list
from ibrid_bench.hidden.__main__ import main as generate
from ibrid_bench.hidden.case import Case, write_case
from ibrid_bench.hidden.nonlinear import Nonlinearity
from ibrid_bench.hidden.nonlinear_case import AMPLITUDES, NonlinearKind, draw_nonlinear_case
from sharing import shared

from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.gap.amplitudes.amplitude_data import AmplitudeData, build_amplitude_data
from ibrid.gap.amplitudes.nonlinearity_edits import NonlinearityEdit, list_nonlinearity_edits
from ibrid.gap.amplitudes.nonlinearity_fit import NonlinearityFitter, NonlinearityPoint
from ibrid.gap.refitting.prior import build_prior
from ibrid.gap.results.files import gap_json
from ibrid.gap.results.gap import Gap
from ibrid.gap.workflow import find_gap
from ibrid.measurement.sweeps.amplitudes import at_amplitudes, joined
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.plant.nonlinear import NONLINEAR
from ibrid.report.texts.gap_text import gap_text
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

#: Of devices of one structure, which is compiled once.
SEED = {"pll_deadband": 7, "current_limit": 0, "nothing": 2}


@shared
def case(kind: NonlinearKind) -> Case:
    return draw_nonlinear_case(kind, SEED[kind], noise_db=50.0, grid="4:1500:7")


@shared
def answer(kind: NonlinearKind) -> Gap:
    one = case(kind)
    return find_gap(parse_program(one.program), one.sweep, one.values)


def hidden(kind: NonlinearKind) -> float:
    (effect,) = case(kind).truth["effects"]
    (threshold,) = effect["parameters"].values()
    return threshold


def searched(
    kind: NonlinearKind, sweep: Sweep, effect: str
) -> tuple[NonlinearityFitter, AmplitudeData]:
    """What fits a place to a sweep, with the case's nominal values."""
    diagram = parse_program(case(kind).program)
    wiring = wire(diagram, VOCABULARY)
    prior = build_prior(case(kind).values, wiring, parameter_table(wiring, "exact"))
    place = next(
        one
        for one in list_nonlinearity_edits(diagram, VOCABULARY)
        if effect in (one.effect, one.words)
    )
    data = build_amplitude_data(sweep)
    assert data is not None
    return NonlinearityFitter(place, diagram, VOCABULARY, data, prior), data


def at_truth(
    kind: NonlinearKind, effect: str, threshold: float
) -> tuple[NonlinearityPoint, AmplitudeData, NonlinearityEdit]:
    search, data = searched(kind, case(kind).sweep, effect)
    start = search.parameter_prior.start(case(kind).truth["values"])
    beside = search._open_model(start)
    assert beside is not None
    counted = threshold
    if search.edit.nonlinearity.is_limit:  # from the largest current at rest
        counted = threshold / np.linalg.norm(beside[1], axis=1).max() - 1.0
    state = search.evaluate(np.append(start, np.log(counted)))
    assert state is not None
    return state, data, search.edit


# harmonic balance against the simulation in time


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["pll_deadband", "current_limit"])
def test_harmonic_balance_at_the_true_values_gives_what_the_simulation_measured(kind):
    state, data, _ = at_truth(kind, kind, hidden(kind))
    assert state.threshold == pytest.approx(hidden(kind), rel=1e-12)
    assert state.motion.converged.all()
    away = np.linalg.norm(state.Y - data.admittance, axis=(-2, -1)) / np.linalg.norm(
        data.admittance, axis=(-2, -1)
    )
    slow = (
        data.frequency < 200.0
    )  # the resonance carries more current than any product term is meant for
    # noise 0.3 %, products of signals a^2, harmonics above the third
    assert away[slow][:, :, :2].max() < 0.02
    assert away[slow].max() < 0.05
    linear, _, _ = at_truth(kind, kind, 1e-9 if kind == "pll_deadband" else 100.0)
    assert np.abs(linear.Y - state.Y).max() > 10 * np.abs(state.Y - data.admittance)[slow].max()


@pytest.mark.slow
def test_a_limit_raises_the_mean_of_the_reference_and_holds_that_of_the_current():
    state, data, place = at_truth("current_limit", "current_limit", hidden("current_limit"))
    shape = (*data.amplitude.shape, 2, 2)
    entering, leaving = (
        one[..., 0].reshape(shape) for one in (state.motion.entering, state.motion.leaving)
    )
    at_rest = state.steady / np.linalg.norm(state.steady, axis=1, keepdims=True)
    along = np.einsum("kmlji,mi->kmlj", entering, at_rest)
    assert along[0, :, -1].max() > 1e-3
    assert np.abs(leaving).max() < 1e-2 * along.max()
    assert np.abs(along[:, :, 0]).max() < 1e-9  # the smallest amplitude does not reach it
    assert place.where == "i_ref.out"


# the workflow


@pytest.mark.nightly
def test_a_dead_zone_before_the_pll_is_named_by_the_command_and_everything_is_written(
    tmp_path, capsys
):
    one = case("pll_deadband")
    write_case(one, tmp_path / "case", tmp_path / "truth")
    folder, out = tmp_path / "case", tmp_path / "out"
    arguments = [
        str(folder / "model.py"),
        str(folder / "sweep.csv"),
        "--values",
        str(folder / "nominal.json"),
    ]
    assert main(["gap", *arguments, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    found = json.loads((out / "gap.json").read_text())
    assert found["verdict"] == "named"
    (effect,) = found["effects"]
    assert (effect["id"], effect["change"], effect["where"]) == ("pll_deadband", "add", "pll.e_q")
    width, low, high = effect["parameters"]["width"]
    assert width == pytest.approx(hidden("pll_deadband"), rel=0.05)
    assert low < hidden("pll_deadband") < high
    assert effect["indistinguishable_from"] == []
    assert found["after"]["refit"] < 0.3 * found["before"]["refit"]
    assert {"op", "band", "entry", "z"} <= set(found["amplitude_dependent"][0])
    assert found["amplitudes"] == list(AMPLITUDES)
    assert 4.0 in found["refused_hz"]
    # a program cannot hold it: the model stays, and is said to be the linear part
    assert parse_program((out / "model.py").read_text()) == parse_program(one.program)
    assert "linear program cannot hold it" in found["sentence"]
    assert (out / "model.json").is_file()
    assert "pll_deadband" in said
    assert "amplitudes" in said
    assert all(len(line) <= 96 for line in said.splitlines())
    page = (out / "report.html").read_text()
    assert "How the response depends on the amplitude" in page
    assert 'id="port-gain-' in page


@pytest.mark.nightly
def test_a_limit_of_the_current_reference_is_named_with_its_size():
    gap = answer("current_limit")
    assert gap.verdict == "named", gap.sentence
    (effect,) = gap.effects
    assert effect.id == "current_limit"
    limit, low, high = effect.parameters["limit"]
    assert limit == pytest.approx(hidden("current_limit"), rel=0.01)
    assert low is not None
    assert high is not None
    assert low < hidden("current_limit") < high
    assert gap.after["refit"] < 0.5 * gap.before["refit"]  # type: ignore[operator]


@pytest.mark.nightly
def test_the_measured_gains_of_a_named_place_fall_on_its_describing_function():
    gap = answer("current_limit")
    assert gap.amplitude is not None
    gain = gap.amplitude.port_gain
    assert gain is not None
    curve = np.interp(gain.amplitude, *gain.curve)
    away = np.abs(gain.gain - curve) / np.maximum(gain.deviation, 1e-3)
    assert len(away) > 10
    assert np.median(away) < 2.0
    assert np.real(gain.gain).min() < 0.9  # it was reached


@pytest.mark.nightly
def test_where_nothing_nonlinear_is_hidden_neither_is_named():
    gap = answer("nothing")
    assert gap.verdict in ("no-gap", "parameters-only"), gap.sentence
    assert gap.effects == ()
    assert gap.amplitude is not None
    assert all(one.products for one in gap.amplitude.linearity.bands)
    assert gap_json(gap)["refused_hz"] == []
    assert "Swept with 3 amplitudes" in gap_text(gap).replace("\n", " ")


@pytest.mark.nightly
def test_a_nonlinearity_without_a_name_is_not_called_by_one_that_has():
    """The data are those of a saturation of e_q, which is no effect of the catalogue."""
    kind, words = "nothing", "a saturation at the input of the PLL"
    state, _, _ = at_truth(kind, words, 0.004)
    one = case(kind)
    sweeps = []
    for level, sweep in enumerate(at_amplitudes(one.sweep)):
        points = tuple(
            replace(
                point, admittance=point.admittance + (state.Y - linear(kind, words).Y)[:, m, level]
            )
            for m, point in enumerate(sweep.points)
        )
        sweeps.append(replace(sweep, points=points))
    gap = find_gap(parse_program(one.program), joined(sweeps), one.values, catalogue=())
    assert gap.verdict == "located-unnamed", gap.sentence
    assert gap.effects == ()
    assert gap.amplitude is not None
    assert gap.amplitude.words == words
    assert gap.amplitude.tried[0].threshold == pytest.approx(0.004, rel=0.05)


def linear(kind: NonlinearKind, words: str) -> NonlinearityPoint:
    return at_truth(kind, words, 1.0)[0]


# the generator and the catalogue


@pytest.mark.nightly
def test_the_generator_writes_nonlinear_cases_and_keeps_the_truth_apart(tmp_path):
    words = [
        "--seed",
        "7",
        "--kind",
        "nonlinear",
        "--effect",
        "pll_deadband",
        "--frequencies",
        "2",
        "--noise-db",
        "60",
    ]
    assert (
        generate([*words, "--out", str(tmp_path / "case"), "--truth", str(tmp_path / "truth")]) == 0
    )
    truth = json.loads((tmp_path / "truth" / "truth.json").read_text())
    assert truth["effects"][0]["id"] == "pll_deadband"
    assert "deadband" not in (tmp_path / "case" / "sweep.csv").read_text()
    assert "amplitude" in (tmp_path / "case" / "sweep.csv").read_text()


def test_what_the_generator_cannot_hide_is_one_clear_sentence(tmp_path, capsys):
    words = [
        "--seed",
        "1",
        "--kind",
        "nonlinear",
        "--effect",
        "hysteresis",
        "--out",
        "a",
        "--truth",
        "b",
    ]
    assert generate(words) == 2
    assert "hides pll_deadband, current_limit, nothing" in capsys.readouterr().err
    with pytest.raises(IbridError, match="ascending"):
        draw_nonlinear_case("nothing", 0, amplitudes=(0.02, 0.01))
    with pytest.raises(IbridError, match="zero or positive"):
        Nonlinearity(deadband=-1.0)
    with pytest.raises(IbridError, match="must be positive"):
        Nonlinearity(limit=0.0)


def test_the_page_for_people_lists_the_nonlinear_effects():
    page = (
        Path(__file__)
        .resolve()
        .parents[2]
        .joinpath("docs", "effects.md")
        .read_text(encoding="utf-8")
    )
    assert effects_list(NONLINEAR) in page, (
        "docs/effects.md: put in what effects_list(NONLINEAR) returns"
    )
