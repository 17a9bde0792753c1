"""A whole run: the folder it leaves, how it goes on, what it refuses, and what the keyboard does to
it.
"""

import csv
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import ibrid_search
import numpy as np
import pytest
from ibrid_search.edits import edit_between
from ibrid_search.evaluation import assess
from ibrid_search.evaluation.assess import EFFORTS
from ibrid_search.proposal import Context, Proposal
from ibrid_search.recursion.loop import BUDGET, STOPPED, TARGET
from ibrid_search.requirements import Requirements
from ibrid_search.run.run_folder import read_run_toml
from ibrid_search.run.selection import read_selection
from ibrid_search.run.stop_request import is_stop_requested, request_stop
from ibrid_search.run.store import Store
from ibrid_search.running import Run
from ibrid_search.settings import Goal, SearchSettings, Workers
from ibrid_search.step import EVALUATED, Status
from scripted_search import NAIVE, PLAIN, QUICK, steps_of, study

import ibrid
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record, read_record
from ibrid.fit.settings import FitSettings
from ibrid.writing import write_whole

SWEEP = study().sweep
FILES = {
    "run.toml",
    "archive.sqlite",
    "best.py",
    "best.json",
    "trajectory.csv",
    "selection.json",
    "report.html",
}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch):
    """Pages take seconds and have their own tests; these are about the run, not about the fits."""
    monkeypatch.setattr(
        "ibrid_search.running.write_run_page", lambda store, path, **_: write_whole(path, "a page")
    )
    monkeypatch.setattr(assess, "EFFORTS", dict.fromkeys(EFFORTS, (QUICK, QUICK, QUICK)))


@pytest.fixture
def real_fits(monkeypatch: pytest.MonkeyPatch):
    """The fits that a user gets."""
    monkeypatch.setattr(assess, "EFFORTS", EFFORTS)


def ran(folder: Path, sweep=SWEEP, **options) -> Run:
    return ibrid.search(
        sweep, folder, **{"budget": 5, "start": NAIVE, "proposer": "rules", **options}
    )


def steps_in(folder: Path):
    return steps_of(folder / "archive.sqlite")


class Observer:
    """A proposer that looks around, then tries gains."""

    name, attempts, window = "observer", 1, 1

    def __init__(self, look: Callable[[Context], None] = lambda _: None) -> None:
        self.look, self.asked = look, 0

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        self.asked += 1
        self.look(context)
        other = NAIVE.replace('"gain")', f'"gain", k={self.asked / 100})')
        return Proposal(
            edit_between(context.parent.record.program, other), note=f"gain {self.asked}"
        )


def test_the_public_names_stay_what_they_are_whatever_is_imported():
    for path in Path(ibrid_search.__file__).parent.rglob("*.py"):
        assert path.stem not in ibrid_search.__all__, (
            "importing this module would hide the public name"
        )
    for _ in range(2):
        assert callable(ibrid.search)
        assert ibrid_search.Run is Run
        assert ibrid_search.SearchSettings is SearchSettings


# the folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A small run with everything written, its page too."""
    return ibrid.search(
        SWEEP,
        tmp_path_factory.mktemp("runs") / "out" / "run",
        start=NAIVE,
        proposer="rules",
        budget=8,
        seed=1,
    )


@pytest.mark.nightly
def test_a_run_leaves_the_files_of_the_contract(finished):
    assert {path.name for path in finished.folder.iterdir()} >= FILES
    assert finished.ending == BUDGET
    assert finished.finished
    assert finished.evaluations == 8


@pytest.mark.slow
def test_the_page_of_a_run_is_whole(finished):
    text = (finished.folder / "report.html").read_text(encoding="utf-8")
    assert text.lower().startswith("<!doctype html>")
    assert text.rstrip().endswith("</html>")
    assert len(text) < 5_000_000


@pytest.mark.slow
def test_the_best_program_and_its_record_belong_together(finished):
    record = read_record(finished.folder / "best.json")
    assert record.outcome == "ok"
    assert all(record.stable.values())
    assert (
        (finished.folder / "best.py").read_text(encoding="utf-8")
        == record.program
        == finished.answer_program
    )
    assert ibrid.violations(record.diagram) == ()
    assert finished.best is not None
    assert record.nrmse == finished.best.nrmse


@pytest.mark.slow
def test_the_answer_fits_at_least_as_well_as_the_step_it_comes_from(finished):
    step = steps_in(finished.folder)[finished.selection["answer"]]
    assert finished.best is not None
    assert finished.best.nrmse is not None
    assert step.nrmse is not None
    assert finished.best.nrmse <= step.nrmse
    assert step.stable


@pytest.mark.slow
def test_the_trajectory_has_a_row_for_every_evaluation(finished):
    with (finished.folder / "trajectory.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["evaluation", "step", "nrmse", "best", "what changed"]
    assert [int(row["evaluation"]) for row in rows] == list(range(1, 9))
    evaluated = [step.number for step in steps_in(finished.folder) if step.status in EVALUATED]
    assert [int(row["step"]) for row in rows] == evaluated
    best = [float(row["best"]) for row in rows if row["best"]]
    assert best == sorted(best, reverse=True)
    assert finished.trajectory[-1][2] == best[-1]


@pytest.mark.slow
def test_the_options_and_versions_are_written_down(finished):
    found = read_run_toml((finished.folder / "run.toml").read_text(encoding="utf-8"), "run.toml")
    assert (found["seed"], found["budget"], found["proposer"]) == (1, 8, "rules:1")
    assert (found["parameters"], found["equilibrium"], found["vocabulary"]) == (
        "shared",
        "exact",
        "extended",
    )
    assert found["settings"]["window"] == SearchSettings().window
    assert found["versions"]["ibrid"] == ibrid.__version__


@pytest.mark.slow
def test_the_selection_names_the_answer(finished):
    found = read_selection(finished.folder / "selection.json")
    assert found is not None
    assert found.answer == finished.selection["answer"]
    assert found.answer in [one.step for one in found.front]


@pytest.mark.slow
def test_the_statuses_are_counted(finished):
    steps = [step for step in steps_in(finished.folder) if step.number > 0]
    assert sum(finished.statuses.values()) == len(steps)
    assert finished.statuses["ok"] == sum(step.status is Status.OK for step in steps)


@pytest.mark.slow
def test_the_best_so_far_can_be_read_from_the_first_valid_candidate_on(tmp_path):
    found: list[float] = []

    def look(context: Context) -> None:
        record = read_record(tmp_path / "run" / "best.json")
        assert (tmp_path / "run" / "best.py").read_text(encoding="utf-8") == record.program
        found.append(float(record.nrmse or 0.0))

    ran(tmp_path / "run", proposer=Observer(look), settings=PLAIN, budget=6)
    assert len(found) == 5
    assert found == sorted(found, reverse=True)


def test_a_run_works_in_a_folder_that_is_there_and_keeps_what_lies_in_it(tmp_path):
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    ran(tmp_path, budget=1)
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.slow
@pytest.mark.usefixtures("real_fits")
def test_a_budget_of_one_is_the_fit_of_the_start(tmp_path):
    found = ran(tmp_path / "run", budget=1)
    assert found.evaluations == 1
    assert found.best is not None
    assert found.best.nrmse == pytest.approx(
        ibrid.evaluate(ibrid.textbook("naive"), SWEEP).nrmse, rel=1e-6
    )


def test_a_target_ends_a_run(tmp_path):
    assert ran(tmp_path / "run", budget=Goal(50, target=2.0)).ending == TARGET
    assert len([step for step in steps_in(tmp_path / "run") if step.status in EVALUATED]) < 50


@pytest.mark.slow
@pytest.mark.parametrize("form", [ibrid.parse_program, str])
def test_a_start_of_ones_own_is_where_it_begins(tmp_path, form):
    text = NAIVE.replace("Gain_dq", "PI_dq")
    found = ran(tmp_path / "run", start=form(text), budget=1)
    assert found.best is not None
    assert ibrid.compare(found.best.diagram, ibrid.parse_program(text)).same


# what the proposer may not know


@pytest.mark.slow
def test_the_truth_reaches_neither_the_proposer_nor_the_candidates(tmp_path):
    text = ibrid.program_text(ibrid.textbook("gfl_exact")).replace("decoupling", "zz_secret")
    seen: list[bytes] = []

    def look(context: Context) -> None:
        known = replace(context, seen=bool)  # a method of the loop's dictionary cannot be pickled
        seen.append(pickle.dumps(replace(known, study=replace(known.study, vocabulary=()))))
        assert not any(
            context.seen(one) for one in (ibrid.structure_hash(ibrid.parse_program(text)),)
        )

    ran(tmp_path / "with", truth=ibrid.parse_program(text), proposer=Observer(look), settings=PLAIN)
    ran(tmp_path / "without", proposer=Observer(), settings=PLAIN)
    assert len(seen) == 4
    assert not any(b"zz_secret" in one for one in seen)
    assert steps_in(tmp_path / "with") == steps_in(tmp_path / "without")
    with Store.open(tmp_path / "with" / "archive.sqlite", read_only=True) as store:
        assert "zz_secret" in store.meta["truth"]  # for the page


@pytest.mark.slow
def test_a_held_out_point_reaches_neither_the_proposer_nor_the_fit(tmp_path):
    held = SWEEP.names[1]
    points: set[tuple[str, ...]] = set()
    ran(
        tmp_path / "run",
        holdout_op=held,
        proposer=Observer(lambda context: points.add(context.study.sweep.names)),
    )
    assert points == {(SWEEP.names[0],)}
    record = read_record(tmp_path / "run" / "best.json")
    assert set(record.holdout) == {held}
    assert set(record.nrmse_by_op) == {SWEEP.names[0]}


# going on


@pytest.mark.slow
def test_a_folder_with_a_run_is_refused_and_stays_as_it_is(tmp_path):
    ran(tmp_path / "run", budget=2)
    before = {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()}
    with pytest.raises(IbridError, match="holds a run already; go on with it by --resume"):
        ran(tmp_path / "run", budget=2)
    assert {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"seed": 7}, "seed = 0, now it is 7"),
        ({"proposer": "random"}, "proposer = rules:1, now it is random:1"),
        ({"parameters": "per-op"}, "parameters = shared, now it is per-op"),
        ({"start": ibrid.textbook("gfl")}, "start of other content"),
        ({"settings": SearchSettings(window=3)}, "settings.window"),
        ({"budget": Goal(3, require="stable")}, "require"),
        ({"settings": SearchSettings(history=2)}, "settings.history = 0, now it is 2"),
    ],
)
def test_a_run_goes_on_with_its_own_options_only(tmp_path, change, told):
    ran(tmp_path / "run", budget=1)
    before = steps_in(tmp_path / "run")
    with pytest.raises(IbridError, match="the run was made with") as caught:
        ran(tmp_path / "run", **{"budget": 3, "resume": True, **change})
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
    assert steps_in(tmp_path / "run") == before


@pytest.mark.slow
def test_a_run_does_not_go_on_with_other_data(tmp_path):
    ran(tmp_path / "run", budget=1)
    other = ibrid.read_sweep(ibrid.benchmarks()["random_00"])
    with pytest.raises(IbridError, match="the run was made with data"):
        ibrid.search(other, tmp_path / "run", start=NAIVE, proposer="rules", budget=2, resume=True)


@pytest.mark.slow
def test_a_truth_that_comes_when_a_run_goes_on_is_on_its_page_and_changes_nothing_else(tmp_path):
    truth = ibrid.textbook("gfl_exact")
    ran(tmp_path / "with", budget=3)
    ran(tmp_path / "with", budget=5, resume=True, truth=truth)
    ran(tmp_path / "without", budget=5)
    assert steps_in(tmp_path / "with") == steps_in(tmp_path / "without")
    texts = []
    for name in ("with", "without"):
        with Store.open(tmp_path / name / "archive.sqlite", read_only=True) as store:
            texts.append(store.meta)
    assert [one.pop("truth") for one in texts] == [ibrid.program_text(truth), ""]
    for one in texts:
        del one["started"], one["seconds"], one["refits"]
    assert texts[0] == texts[1]
    ran(tmp_path / "with", budget=5, resume=True)  # not given again, it stays
    with Store.open(tmp_path / "with" / "archive.sqlite", read_only=True) as store:
        assert store.meta["truth"] == ibrid.program_text(truth)


@pytest.mark.slow
def test_a_run_goes_on_with_a_larger_budget(tmp_path):
    first = ran(tmp_path / "run", budget=3)
    before = steps_in(tmp_path / "run")
    again = ran(tmp_path / "run", budget=6, resume=True)
    assert (first.evaluations, again.evaluations) == (3, 6)
    with Store.open(tmp_path / "run" / "archive.sqlite", read_only=True) as store:
        assert "budget = 6" in store.meta["settings"]  # what the page says
    assert "budget = 3" in (tmp_path / "run" / "run.toml").read_text(encoding="utf-8")
    assert steps_in(tmp_path / "run")[: len(before)] == before
    assert again.trajectory[:3] == first.trajectory


@pytest.mark.slow
def test_a_finished_run_can_be_summed_up_again(tmp_path):
    first = ran(tmp_path / "run", budget=3)
    (tmp_path / "run" / "best.json").unlink()
    again = ran(tmp_path / "run", budget=3, resume=True)
    assert again.evaluations == 3
    assert again.answer_program == first.answer_program
    assert read_record(tmp_path / "run" / "best.json").program == first.answer_program


@pytest.mark.slow
def test_without_its_options_file_a_run_is_known_by_its_archive(tmp_path):
    ran(tmp_path / "run", budget=1)
    (tmp_path / "run" / "run.toml").unlink()
    with pytest.raises(IbridError, match="seed = 0, now it is 9"):
        ran(tmp_path / "run", budget=2, seed=9, resume=True)
    assert ran(tmp_path / "run", budget=2, resume=True).evaluations == 2


@pytest.mark.slow
@pytest.mark.parametrize("content", [b"seed = = 1", b"\xff\xfe\x00", b"seed = " + b"[" * 100_000])
def test_a_damaged_options_file_is_a_sentence(tmp_path, content):
    ran(tmp_path / "run", budget=1)
    (tmp_path / "run" / "run.toml").write_bytes(content)
    with pytest.raises(IbridError, match=r"run\.toml: must be"):
        ran(tmp_path / "run", budget=2, resume=True)


@pytest.mark.parametrize("there", [False, True])
def test_to_go_on_where_no_run_is_is_refused_and_makes_nothing(tmp_path, there):
    if there:
        (tmp_path / "run").mkdir()
    with pytest.raises(IbridError, match=r"no run to go on with; .* leave --resume out"):
        ran(tmp_path / "run", budget=1, resume=True)
    assert [path.name for path in tmp_path.rglob("*")] == ["run"] * there


#: What a run has written when it ends, and not while its archive is made.
ANSWERS = ("best.py", "best.json", "selection.json", "trajectory.csv", "report.html")


@pytest.mark.slow
def test_a_run_that_died_while_its_archive_was_made_can_go_on(tmp_path):
    ran(tmp_path / "run", budget=1)
    for name in ("archive.sqlite-wal", "archive.sqlite-shm", *ANSWERS):
        (tmp_path / "run" / name).unlink(missing_ok=True)
    (tmp_path / "run" / "archive.sqlite").write_bytes(b"")
    assert ran(tmp_path / "run", budget=2, resume=True).evaluations == 2


@pytest.mark.slow
def test_a_run_that_died_before_its_archive_was_made_can_go_on(tmp_path):
    ran(tmp_path / "run", budget=1)
    for name in ("archive.sqlite", "archive.sqlite-wal", "archive.sqlite-shm", *ANSWERS):
        (tmp_path / "run" / name).unlink(missing_ok=True)
    assert ran(tmp_path / "run", budget=2, resume=True).evaluations == 2


# what is refused


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"budget": 0}, "budget must be 1"),
        ({"budget": -1}, "budget must be 1"),
        ({"budget": 1.5}, "budget must be a whole number"),
        ({"seed": -1}, "seed must be a whole number, 0 or more, found -1"),
        ({"start": 3}, "start must be a Diagram or text"),
        (
            {"start": None, "vocabulary": "paper", "settings": SearchSettings(devices=2)},
            "no shipped diagram of two devices has a response",
        ),
        ({"workers": 0}, "workers must be"),
        ({"workers": -1}, "workers must be"),
        ({"workers": 1.5}, "workers must be"),
        ({"budget": Goal(5, choose="op")}, "holdout_op"),
        ({"proposer": "ruels"}, "did you mean rules"),
        ({"proposer": "rules:-1"}, "a weight is a number above zero"),
        ({"proposer": "llm"}, "needs a model"),
        ({"proposer": []}, "at least one proposer"),
        ({"proposer": 7}, "given by name, as an object"),
        ({"proposer": [(Observer(), float("inf"))]}, "weight above zero"),
        ({"proposer": [(Observer(), "much")]}, "weight above zero"),
        ({"vocabulary": "papr"}, "did you mean paper"),
        ({"equilibrium": "rough"}, "equilibrium"),
        ({"parameters": "own"}, "parameters"),
        ({"holdout_op": "p=9"}, "p=9"),
        ({"start": "import os"}, "start"),
        ({"start": NAIVE.replace("Gain_dq", "Gian_dq")}, "Gain_dq"),
        ({"progress": "loud"}, "progress"),
    ],
)
def test_a_wrong_option_is_a_sentence_and_leaves_no_run_behind(tmp_path, options, told):
    with pytest.raises(IbridError, match=told) as caught:
        ran(tmp_path / "run", **options)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists() or list((tmp_path / "run").iterdir()) == []


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: Goal(target=-1.0), "target must be"),
        (lambda: Goal(choose="luck"), "error, frequencies, op"),
        (lambda: Goal(require="lively"), "--require takes"),
        (lambda: SearchSettings(history=-1), "history must be"),
        (lambda: Workers(0, "auto"), "workers must be"),
        (lambda: Workers(10**5000), "workers must be a whole number from 1 to 1000"),
    ],
)
def test_a_wrong_setting_is_refused_where_it_is_written(made, told):
    with pytest.raises(IbridError, match=told):
        made()


class Broken(Observer):
    """Answers with what no search can use."""

    def __init__(self, answer: Callable[[], Proposal]) -> None:
        super().__init__()
        self.answer = answer

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        return self.answer()


@pytest.mark.slow
def test_a_proposer_that_fails_is_named_and_the_run_goes_on_when_it_is_mended(tmp_path):
    for answer, told in (
        (lambda: {}["missing"], "KeyError: 'missing'"),
        (lambda: None, "TypeError: it must answer with a Proposal, found NoneType"),
        (lambda: Proposal(b"bytes"), "TypeError: edit of a Proposal must be text, found bytes"),
    ):
        with pytest.raises(
            IbridError, match=f"the proposer observer failed, {told}.*--resume"
        ) as caught:
            ran(tmp_path / "run", proposer=Broken(answer), resume=(tmp_path / "run").exists())
        assert isinstance(caught.value.__cause__, KeyError | TypeError)
    assert ran(tmp_path / "run", proposer=Observer(), resume=True).evaluations == 5


@pytest.mark.slow
def test_a_study_is_searched_as_its_parts_are(tmp_path):
    study = ibrid.Study(SWEEP, seed=3, equilibrium="paper", vocabulary="paper")
    ran(tmp_path / "study", sweep=study, budget=2)
    ran(tmp_path / "parts", budget=2, seed=3, equilibrium="paper", vocabulary="paper")
    assert steps_in(tmp_path / "study") == steps_in(tmp_path / "parts")
    texts = [
        (tmp_path / name / "run.toml").read_text(encoding="utf-8") for name in ("study", "parts")
    ]
    assert texts[0] == texts[1]


def test_a_start_without_a_fit_leaves_nothing_behind_and_a_better_one_can_follow(tmp_path):
    # an LCL whose R_g leaves no operating point at these powers: no root of the capacitor's voltage
    text = ibrid.program_text(ibrid.textbook("gfl"))
    hopeless = text.replace('"LCL", "plant"', '"LCL", "plant", L_g=0.9, R_g=0.9')
    with pytest.raises(IbridError, match="the start must have a fit"):
        ran(tmp_path / "run", start=hopeless)
    assert list((tmp_path / "run").iterdir()) == []
    assert ran(tmp_path / "run", budget=1).evaluations == 1


@pytest.mark.parametrize(
    "name", ["best.py", "best.json", "trajectory.csv", "selection.json", "report.html"]
)
def test_a_file_of_somebody_else_is_not_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine", encoding="utf-8")
    with pytest.raises(IbridError, match=f"{name}: is there already"):
        ran(tmp_path, budget=1)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("folder", ["", "  "])
def test_a_run_without_a_folder_is_refused(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(IbridError, match="needs a folder"):
        ibrid.search(SWEEP, folder, start=NAIVE, budget=1)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_what_is_required_holds_for_the_answer(tmp_path):
    found = ran(tmp_path / "run", budget=Goal(10, require="stable,passive:100-2000"), seed=2)
    steps = steps_in(tmp_path / "run")
    assert any(step.status is Status.REQUIRED for step in steps)
    if found.best is not None:
        assert steps[found.selection["answer"]].status is Status.OK


@pytest.mark.slow
def test_the_last_fit_is_dropped_when_its_values_are_not_as_required(tmp_path, monkeypatch):
    class NotTooGood(Requirements):
        def unmet(self, record: Record) -> str:
            return "" if record.nrmse is not None and record.nrmse > 0.99 else "it must be bad"

    whole = FitSettings()  # finds 0.978 where little effort ends at 0.9999
    monkeypatch.setattr(assess, "EFFORTS", dict.fromkeys(EFFORTS, (QUICK, QUICK, whole)))
    monkeypatch.setattr("ibrid_search.settings.parse_requirements", lambda _: NotTooGood())
    found = ran(tmp_path / "picky", budget=1)
    monkeypatch.setattr("ibrid_search.settings.parse_requirements", lambda _: Requirements())
    other = ran(tmp_path / "content", budget=1)
    assert found.best is not None
    assert found.best.nrmse is not None
    assert other.best is not None
    assert other.best.nrmse is not None
    assert other.best.nrmse < 0.98 < 0.99 < found.best.nrmse


def test_without_a_candidate_that_will_do_there_is_no_answer(tmp_path):
    # the fitted gain of the naive start is a little above 1: it feeds the grid's voltage back too
    # strongly
    found = ran(tmp_path / "run", budget=Goal(1, require="passive:5-5000"))
    assert found.best is None
    assert found.answer_program == ""
    assert found.finished
    assert not (tmp_path / "run" / "best.json").exists()


# the keyboard


@pytest.mark.slow
def test_the_first_ctrl_c_finishes_what_is_under_way_and_the_run_goes_on_later(tmp_path, capsys):
    def press(context: Context) -> None:
        if observer.asked == 3:
            os.kill(os.getpid(), signal.SIGINT)

    observer = Observer(press)
    before = signal.getsignal(signal.SIGINT)
    found = ran(tmp_path / "run", proposer=observer, settings=PLAIN, budget=9, progress="plain")
    assert signal.getsignal(signal.SIGINT) is before
    assert (found.ending, found.finished) == (STOPPED, False)
    assert found.best is not None
    assert "--resume" in capsys.readouterr().out
    assert not any(step.status is Status.PENDING for step in steps_in(tmp_path / "run"))
    again = ran(tmp_path / "run", proposer=Observer(), settings=PLAIN, budget=9, resume=True)
    assert (again.ending, again.evaluations) == (BUDGET, 9)


@pytest.mark.slow
def test_the_second_ctrl_c_stops_at_once_and_nothing_is_lost(tmp_path):
    def press(context: Context) -> None:
        if observer.asked >= 3:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)

    observer = Observer(press)
    with pytest.raises(KeyboardInterrupt):
        ran(tmp_path / "run", proposer=observer, settings=PLAIN, budget=9)
    assert observer.asked == 3
    assert [step.number for step in steps_in(tmp_path / "run")] == [0, 1, 2]
    again = ran(tmp_path / "run", proposer=Observer(), settings=PLAIN, budget=5, resume=True)
    assert again.evaluations == 5


# a process that dies


#: The plainest search: its steps cost least.
BASELINE = ("--start", "naive", "--proposer", "rules", "--workers", "1")


def child(folder: Path, *words: str) -> subprocess.Popen[str]:
    """`ibrid search` in a process of its own."""
    command = [
        sys.executable,
        "-m",
        "ibrid",
        "search",
        "paper_like",
        "--out",
        str(folder),
        *BASELINE,
        *words,
    ]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def wait_for(folder: Path, number: int, process: subprocess.Popen[str]) -> None:
    """Until the run has that many evaluations."""
    limit = time.monotonic() + 600
    while time.monotonic() < limit and process.poll() is None:
        time.sleep(0.1)
        if (folder / "best.json").exists():
            found = [step for step in steps_in(folder) if step.status in EVALUATED]
            if len(found) >= number:
                return
    raise AssertionError(
        f"the run did not come to {number} evaluations: {process.communicate()[1]}"
    )


@pytest.mark.nightly
@pytest.mark.usefixtures("real_fits")
def test_a_run_that_sigkill_ended_goes_on_and_ends_as_the_uninterrupted_one(tmp_path):
    process = child(tmp_path / "killed", "--budget", "11")
    wait_for(tmp_path / "killed", 2, process)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=600)
    assert process.returncode == -signal.SIGKILL
    assert any(step.status is Status.PENDING for step in steps_in(tmp_path / "killed"))
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    again = ibrid.search(
        sweep, tmp_path / "killed", start=NAIVE, proposer="rules", budget=11, resume=True
    )
    whole = ibrid.search(sweep, tmp_path / "whole", start=NAIVE, proposer="rules", budget=11)
    assert steps_in(tmp_path / "killed") == steps_in(tmp_path / "whole")
    assert again.answer_program == whole.answer_program
    assert again.trajectory == whole.trajectory


@pytest.mark.slow
def test_the_live_page_stops_a_search_which_goes_on_later(tmp_path, capsys):
    def press(context: Context) -> None:
        if observer.asked == 3:
            request_stop(tmp_path / "run")

    observer = Observer(press)
    found = ran(tmp_path / "run", proposer=observer, settings=PLAIN, budget=9, progress="plain")
    assert (found.ending, found.finished) == (STOPPED, False)
    assert "the live page asks to stop" in capsys.readouterr().out
    assert not is_stop_requested(tmp_path / "run")
    assert not any(step.status is Status.PENDING for step in steps_in(tmp_path / "run"))
    again = ran(tmp_path / "run", proposer=Observer(), settings=PLAIN, budget=9, resume=True)
    assert (again.ending, again.evaluations) == (BUDGET, 9)


@pytest.mark.nightly
@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_or_a_schedulers_sigterm_says_how_to_go_on(tmp_path, first):
    process = child(tmp_path / "run", "--budget", "400")
    wait_for(tmp_path / "run", 3, process)
    process.send_signal(first)
    out, err = process.communicate(timeout=600)
    assert process.returncode == 130
    assert "stopped by Ctrl-C, a signal or its live page" in out
    assert "a second Ctrl-C stops at once" in out + err
    assert f"--out {tmp_path / 'run'} --resume" in err
    assert "Traceback" not in err
    steps = steps_in(tmp_path / "run")
    assert not any(step.status is Status.PENDING for step in steps)
    assert {path.name for path in (tmp_path / "run").iterdir()} >= FILES - {"selection.json"}


@pytest.mark.slow
def test_ctrl_c_twice_in_a_terminal_ends_it_at_once(tmp_path):
    process = child(tmp_path / "run", "--budget", "400")
    wait_for(tmp_path / "run", 3, process)
    process.send_signal(signal.SIGINT)
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=600)
    assert process.returncode == 130
    assert "--resume" in err
    assert "Traceback" not in err
    # what the second one interrupted waits for the next sitting, and is not taken for a failure
    assert not any(step.status is Status.FAILED for step in steps_in(tmp_path / "run"))
