"""The one value for the data and how they are looked at."""

import pickle
from typing import Any

import pytest
from scripted_search import NAIVE, QUICK

import ibrid
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.study import Study


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


def test_a_held_out_point_is_neither_fitted_nor_seen_by_who_is_blind(sweep: Sweep):
    study = Study(sweep, holdout_op="p=1,q=-0.3")
    assert study.held == ("p=1,q=-0.3",)
    assert study.held_out == (sweep.point("p=1,q=-0.3"),)
    assert study.fitted.names == study.blind.sweep.names == ("p=1,q=0.3",)
    assert study.blind.held == ()
    assert Study(sweep).blind.sweep.names == sweep.names


def test_points_share_their_parameters_or_have_their_own(sweep: Sweep):
    assert [len(group) for group in Study(sweep).groups] == [2]
    assert [len(group) for group in Study(sweep, parameters="per-op").groups] == [1, 1]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"parameters": "both"}, "parameters must be one of shared, per-op"),
        ({"equilibrium": "exakt"}, "did you mean exact"),
        ({"vocabulary": "papre"}, "no vocabulary is called 'papre'; did you mean paper"),
        ({"holdout_op": "p=1"}, "no operating point 'p=1' to hold out"),
        ({"holdout_op": "p=1,q=0.3", "parameters": "per-op"}, "only with shared parameters"),
        ({"holdout_op": ("p=1,q=0.3", "p=1,q=-0.3")}, "leave at least one to fit"),
    ],
)
def test_a_study_that_cannot_be_is_refused(sweep: Sweep, options: dict[str, Any], says: str):
    with pytest.raises(IbridError, match=says):
        Study(sweep, **options)


def test_a_study_is_of_a_sweep():
    with pytest.raises(
        IbridError,
        match=r"Study: sweep must be a Sweep, found .data.csv.; make one with ibrid.read_sweep",
    ):
        Study("data.csv")  # pyright: ignore[reportArgumentType]


def test_a_study_stands_in_the_place_of_its_sweep(sweep: Sweep):
    study, naive = Study(sweep, seed=3, vocabulary="paper"), ibrid.parse_program(NAIVE)
    record = ibrid.evaluate(naive, study, settings=QUICK)
    assert record.settings["seed"] == 3
    assert record.settings["vocabulary"] == "paper"
    plain = ibrid.evaluate(naive, sweep, seed=3, vocabulary="paper", settings=QUICK)
    assert {**plain.to_json(), "seconds": 0} == {**record.to_json(), "seconds": 0}
    assert ibrid.evaluate(naive, study, seed=4, settings=QUICK).settings["seed"] == 4
    assert Study.of(study) is study
    assert Study.of(study, seed=4).vocabulary == "paper"


def test_a_gap_is_sought_with_shared_parameters_alone(sweep: Sweep):
    with pytest.raises(IbridError, match="shared parameters and the exact equilibrium"):
        ibrid.find_gap(ibrid.textbook("gfl_exact"), Study(sweep, parameters="per-op"))


def test_a_vocabulary_is_told_by_its_name_or_by_what_differs(sweep: Sweep):
    fewer = [kind for kind in VOCABULARY if kind.name != "Delay"]
    assert Study(sweep, vocabulary=PAPER_VOCABULARY).vocabulary_name == "paper"
    assert Study(sweep, vocabulary=fewer).vocabulary_name == "extended - Delay"


def test_what_travels_is_what_was_said(sweep: Sweep):
    study = Study(sweep, holdout_op="p=1,q=-0.3")
    study.examined(ibrid.parse_program(NAIVE), NAIVE)
    there = pickle.loads(pickle.dumps(study))
    assert "examined" not in vars(there)
    assert there.held == study.held
    assert there.kinds == study.kinds
    assert there.hash_of(ibrid.parse_program(NAIVE)) == study.hash_of(ibrid.parse_program(NAIVE))
