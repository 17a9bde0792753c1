"""What finished searches teach the diagnosis: counts from their archives, the law of the bonus, and
the order that follows.
"""

import json
from dataclasses import replace
from math import log
from pathlib import Path

import numpy as np
import pytest
from ibrid_search.archives.experience import PRIOR, Experience, experience_of, read_experience
from ibrid_search.proposal import Context
from ibrid_search.proposers.choose import Proposers
from ibrid_search.proposers.diagnosis import CURIOSITY, Diagnosis
from ibrid_search.run.run_folder import ARCHIVE, SELECTION
from ibrid_search.run.store import Store
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.edit_screening import ScreeningFit
from ibrid_search.step import Status, Step
from scripted_search import NAIVE, context_of, fixed

import ibrid
from ibrid import cli
from ibrid.errors import IbridError


def a_run(folder: Path, *, answer: int | None = 3) -> Path:
    """A start; a filter that is dropped; a delay that is kept, and on top of it a filter that is
    kept.
    """
    tried = (("filter", 0, 0.2, 0.3), ("delay", 0, 0.1, 0.2), ("filter", 2, 0.01, 0.02))
    folder.mkdir()
    with Store.create(folder / ARCHIVE, {"start": NAIVE}) as store:
        store.propose(Step(0, status=Status.OK, nrmse=0.9, program=NAIVE))
        for number, (part, parent, nrmse, look) in enumerate(tried, 1):
            usage = {"family": part, "look": look}
            store.propose(
                Step(
                    number,
                    parent,
                    usage=usage,
                    status=Status.OK,
                    nrmse=nrmse,
                    stable=True,
                    program=fixed(number),
                )
            )
        store.propose(Step(4, 0, usage={"family": "damping"}, status=Status.ILLEGAL))
    if answer is not None:
        found = {"schema": "ibrid.selection/1", "front": [{"step": answer}], "answer": answer}
        (folder / SELECTION).write_text(json.dumps(found), encoding="utf-8")
    return folder


def test_an_archive_says_which_ideas_were_tried_and_which_stayed(tmp_path: Path):
    found = experience_of([a_run(tmp_path / "a"), a_run(tmp_path / "b")])
    assert found.tried == {"filter": 4, "delay": 2}
    assert found.kept == {"filter": 2, "delay": 2}
    beyond = [log(0.2 / 0.3), log(0.1 / 0.2), log(0.01 / 0.02)] * 2
    assert found.tau == pytest.approx(np.std(beyond))


def test_the_bonus_is_the_logarithm_of_the_odds_within_the_spread_of_looks():
    known = Experience({"a": 8, "b": 8}, {"a": 8, "b": 0}, tau=0.5)
    mean = 8.5 / 17
    assert known.bonus("a") == pytest.approx(0.5 * log((8 + PRIOR * mean) / (8 + PRIOR) / mean))
    assert known.bonus("b") < 0 < known.bonus("a")
    assert known.bonus("never tried") == pytest.approx(0.0)


@pytest.mark.parametrize(("first", "chosen"), [(0.010, "good"), (0.002, "bad")])
def test_what_was_kept_before_comes_first_where_looks_are_alike(
    monkeypatch, first: float, chosen: str
):
    """A gain of the first look beyond the bonus still decides: data come before experience."""
    draws = {"bad": ("LPF1_dq", first), "good": ("PI_dq", 0.012)}
    looks = [
        ScreeningFit(
            CandidateEdit(
                ibrid.parse_program(NAIVE.replace('g.add("Gain_dq"', f'g.add("{kind}"')),
                part,
                part,
                {},
            ),
            e,
            5,
            log(e),
        )
        for part, (kind, e) in draws.items()
    ]
    monkeypatch.setattr(Context, "lacks", lambda self, number=1: looks[:number])
    assert np.random.default_rng(1).random() > CURIOSITY  # this draw asks the diagnosis
    known = Experience({"good": 20, "bad": 20}, {"good": 20, "bad": 0}, tau=0.5)
    assert abs(known.bonus("good") - known.bonus("bad")) < log(0.012 / 0.002)
    proposal = Diagnosis(known).propose(
        context_of(ibrid.textbook("naive")), np.random.default_rng(1)
    )
    assert proposal.note == chosen
    assert proposal.usage["look"] == draws[chosen][1]
    alone = Diagnosis().propose(context_of(ibrid.textbook("naive")), np.random.default_rng(1))
    assert alone.note == "bad"


def test_the_command_keeps_it_and_a_search_by_diagnosis_reads_it(tmp_path: Path, capsys):
    run, out = a_run(tmp_path / "run"), tmp_path / "out"
    assert cli.main(["policy", "train", "--from", str(run), "--out", str(out)]) == 0
    assert "delay" in capsys.readouterr().out
    found = Proposers("diagnosis", policy=out)
    ((proposer, _),) = found.weighted()
    assert isinstance(proposer, Diagnosis)
    assert proposer.experience == read_experience(out) == experience_of([run])
    assert set(found.weights()) == {"policy", "policy_sha256"}
    with pytest.raises(IbridError, match="belongs to the proposer diagnosis"):
        Proposers("rules", policy=out).weighted()


def test_what_is_no_finished_run_or_no_experience_is_one_sentence(tmp_path: Path):
    with pytest.raises(IbridError, match="holds no finished run"):
        experience_of([a_run(tmp_path / "a", answer=None)])
    known = Experience({"a": 2}, {"a": 1}, 0.1)
    for change in ({"tau": -1.0}, {"tau": float("nan")}, {"kept": {"a": 3}}, {"kept": {"b": 0}}):
        replace(known, **change).write(tmp_path)
        with pytest.raises(IbridError, match=r"experience\.json"):
            read_experience(tmp_path)
    (tmp_path / "experience.json").write_text("[" * 10_000)
    with pytest.raises(IbridError, match="is no experience"):
        read_experience(tmp_path)
