"""The benchmark of the search scores answers against what is hidden, keeps what it has measured,
and says what failed.
"""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_bench.ledger import NAME, Ledger
from ibrid_bench.search import side_by_side, speed_table
from ibrid_bench.search.__main__ import main
from ibrid_bench.search.inverters import hardware, inverter
from ibrid_bench.search.page import page
from ibrid_bench.search.scoring import (
    EXACT_ERROR,
    PAPER_ERROR,
    finding,
    first_at,
    perform,
    score,
    succeeded,
)
from ibrid_bench.search.speed import (
    Pace,
    archive_milliseconds,
    candidates,
    fits_a_second,
    local,
    policy_step,
)
from ibrid_bench.search.tables import findings, heading, seed_line, summary
from ibrid_bench.search.trials import PROPOSERS, TABLES, Trial, trials
from ibrid_search.recursion.progress import Snapshot
from ibrid_search.settings import SearchSettings

import ibrid
from ibrid.errors import IbridError

FOLDER = Path("nowhere")
NAIVE = ibrid.program_text(ibrid.textbook("naive"))
TRUTH = inverter("paper_like").program


@dataclass(frozen=True)
class Found:
    """An answer of a search that was never made."""

    answer_program: str
    best: Any
    evaluations: int = 40
    finished: bool = True
    seconds: float = 3.0
    selection: Any = field(default_factory=dict)
    trajectory: tuple = (
        (0, 0.9, 0.9),
        (1, None, 0.9),
        (2, 0.04, 0.04),
        (3, 0.05, 0.04),
        (4, 1e-9, 1e-9),
    )


def answering(program: str, seen: list | None = None, **changes: Any):
    """A search that gives this program whatever it sees."""

    def search(sweep, folder, *, parameters, equilibrium, vocabulary, **options):
        if seen is not None:
            seen.append((sweep, folder, options))
        fit = ibrid.evaluate(
            ibrid.parse_program(program),
            sweep,
            parameters=parameters,
            equilibrium=equilibrium,
            vocabulary=vocabulary,
        )
        return Found(program, fit, **changes)

    return search


def trial(**changes: Any) -> Trial:
    return replace(Trial("structure", "paper_like", "rules", 0, 500), **changes)


def row_of(one: Trial, program: str, **changes: Any) -> dict[str, Any]:
    return perform(one, FOLDER, search=answering(program, **changes), workers=1)


def test_the_true_program_scores_full_marks():
    row = row_of(trial(), TRUTH)
    assert row["success"] is True
    assert (row["modules_f1"], row["connections_f1"]) == (1.0, 1.0)
    # a solved fit ends below 1e-7
    assert max(row["nrmse"], row["answer_nrmse"], row["truth_nrmse"], row["holdout"]) < 1e-6
    assert row["first"] == 4
    assert json.loads(json.dumps(row, allow_nan=False)) == row


def test_the_naive_program_scores_what_it_is_worth():
    row = row_of(trial(), NAIVE)
    assert row["success"] is False
    assert row["bic_over_truth"] is None  # clean data have no likelihood
    assert row["answer_nrmse"] > 0.5
    assert row["holdout"] > 0.5
    assert row["modules_f1"] < 0.5


def test_a_good_fit_is_no_success_without_the_structure_nor_when_it_is_unstable():
    row = row_of(trial(), TRUTH)
    for change in (
        {"connections_f1": 0.89},
        {"modules_f1": 0.89},
        {"answer_stable": False},
        {"answer_nrmse": 1.01 * EXACT_ERROR},
        {"answer_nrmse": None},
    ):
        assert succeeded(trial(), {**row, **change}) is False


def test_the_search_never_gets_the_held_out_point():
    seen: list[Any] = []
    perform(trial(seed=3), FOLDER, search=answering(TRUTH, seen), workers=2)
    ((sweep, folder, options),) = seen
    assert sweep.names == inverter("paper_like").sweep.names
    assert folder == FOLDER
    assert options == {
        "proposer": "rules",
        "budget": 500,
        "seed": 3,
        "workers": 2,
        "holdout_op": (),
        "start": ibrid.textbook("naive"),
        "settings": SearchSettings(),
    }


def test_only_diagnosis_begins_with_what_ships_and_never_in_the_papers_setting():
    assert trial(proposer="diagnosis").start is None
    assert {trial(table="paper", proposer=name).start for name in PROPOSERS} == {"naive"}
    assert trial().start == "naive"
    assert trial(inverter="parallel_gfl_gfm").devices == 2


def test_noise_asks_for_no_less_than_the_refitted_truth_and_has_the_trials_seed():
    noisy = trial(noise_db=40.0, seed=2)
    row = row_of(noisy, TRUTH)
    assert row["success"] is True
    assert row["data"] == "40 dB"
    # 1 % of noise; a fit takes a little of it away
    assert row["noise_floor"] == pytest.approx(0.01, rel=0.01)
    assert 0.005 < row["answer_nrmse"] < 0.012
    assert row["holdout"] < row["answer_nrmse"]  # the held-out point is clean
    assert row["bic_over_truth"] == 0.0
    naive = row_of(noisy, NAIVE)
    assert (naive["success"], naive["bic_over_truth"] > 1000) == (False, True)
    other = replace(noisy, seed=3)
    sweeps = [one.hidden().sweep.points[0].admittance for one in (noisy, noisy, other)]
    np.testing.assert_array_equal(sweeps[0], sweeps[1])
    assert (sweeps[0] != sweeps[2]).all()


def test_the_papers_table_asks_for_its_error_in_time():
    paper = trial(table="paper")
    program = ibrid.program_text(ibrid.textbook("gfl_pll_filter"))
    row = row_of(paper, program)
    # paper mode predicts nothing; the reference value of the contract
    assert row["holdout"] is None
    assert row["truth_nrmse"] == pytest.approx(0.0432, abs=1e-4)
    assert row["truth_nrmse"] < PAPER_ERROR
    assert (row["first"], row["success"]) == (2, True)
    for change in ({"seconds": 601.0}, {"first": 501}, {"first": None}):
        assert succeeded(paper, {**row, **change}) is False


def test_the_error_counts_as_reached_at_the_first_evaluation_with_such_a_best():
    course = ((0, None, None), (1, 0.5, 0.5), (2, 0.02, 0.5), (3, 0.04, 0.04), (4, 0.03, 0.03))
    assert first_at(course, 0.0435) == 3  # evaluation 2 was unstable
    assert first_at(course, 0.5) == 1
    assert first_at(course, 0.01) is None


def test_without_a_truth_there_is_no_verdict():
    measured = replace(inverter("l_filter"), program="", values=None)
    one = trial(table="inverters", inverter="l_filter")
    fit = ibrid.evaluate(ibrid.parse_program(inverter("l_filter").program), measured.sweep)
    row = score(one, measured, Found(fit.program, fit))
    assert row["success"] is None
    assert row["modules_f1"] is None
    assert row["holdout"] < 1e-6
    assert seed_line(
        {
            **row,
            "table": "inverters",
            "inverter": "x",
            "data": "clean",
            "proposer": "rules",
            "seed": 0,
        }
    )


def test_what_is_not_found_is_listed_or_preferred_where_the_data_do_not_decide():
    found, absent, unknown = {"success": True}, {"success": False}, {"success": None}
    listed, preferred = (
        absent | {"rival_f1": 0.95},
        absent | {"bic_over_truth": -3.0, "rival_f1": 0.5},
    )
    rows = (found, listed, preferred, absent | {"bic_over_truth": 40.0}, absent, unknown)
    assert [finding(row) for row in rows] == ["yes", "listed", "preferred", "no", "no", "-"]
    assert findings(rows) == "1 of 5, 1 listed, 1 preferred"
    assert findings((found, absent)) == "1 of 2"
    assert findings((unknown,)) == "-"


def test_every_search_has_its_own_name_and_the_baseline_beside_it():
    found = list(trials(range(10)))
    assert len({one.key for one in found}) == len(found)
    absent = (
        set() if list(hardware()) else {"hardware"}
    )  # measured sweeps lie beside the project, or nowhere
    assert {one.table for one in found} == set(TABLES) - absent
    assert {one.noise_db for one in found if one.table == "structure"} == {None, 60.0, 40.0}
    assert len({one.inverter for one in found if one.table == "inverters"}) >= 20
    for together in zip(*(found[k :: len(PROPOSERS)] for k in range(len(PROPOSERS))), strict=True):
        assert tuple(one.proposer for one in together) == PROPOSERS
        assert len({(one.table, one.inverter, one.noise_db, one.seed) for one in together}) == 1
    assert {one.inverter for one in trials(range(1), 5, only=["droop"])} == {"droop"}
    assert {one.table for one in trials(range(1), 5, only=["paper"])} == {"paper"}
    assert {one.noise_db for one in trials(range(1), 5, data=["40 dB"])} == {40.0}
    assert len(list(trials(range(1), 5, few=True))) < len(list(trials(range(1), 5)))


def test_a_finished_benchmark_measures_nothing_again(tmp_path, capsys):
    seen: list[Any] = []
    arguments = ["--only", "l_filter", "--seeds", "2", "--budget", "7", "--out", str(tmp_path)]
    program = inverter("l_filter").program
    assert main(arguments, search=answering(program, seen)) == 0
    first = capsys.readouterr().out
    assert len(seen) == 18
    assert first.count("yes") == 18
    assert "2 of 2" in first
    assert len((tmp_path / NAME).read_text(encoding="utf-8").splitlines()) == 18
    assert main(arguments, search=answering(program, seen)) == 0
    assert len(seen) == 18
    assert capsys.readouterr().out == first
    assert main([*arguments, "--proposer", "other"], search=answering(program, seen)) == 0
    assert len(seen) == 24


def test_a_search_that_fails_is_said_and_tried_again(tmp_path, capsys):
    program = inverter("l_filter").program
    good = answering(program)

    def moody(sweep, folder, **options):
        if options["proposer"] == "random":
            raise IbridError("the server must answer; it did not")
        return good(sweep, folder, **options)

    arguments = ["--only", "l_filter", "--seeds", "1", "--out", str(tmp_path)]
    assert main(arguments, search=moody) == 1
    assert "l_filter-clean-random-1000-0: the server must answer" in capsys.readouterr().out
    assert main(arguments, search=good) == 0
    assert "1 of 1" in capsys.readouterr().out


def test_ctrl_c_says_how_to_go_on(tmp_path, capsys):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    assert main(["--only", "l_filter", "--out", str(tmp_path)], search=stopped) == 1
    assert f"--out {tmp_path}" in capsys.readouterr().err


def test_an_unknown_name_gets_one_sentence_with_the_near_ones(tmp_path, capsys):
    assert main(["--only", "drop", "--out", str(tmp_path)], search=answering(NAIVE)) == 2
    assert "droop" in capsys.readouterr().err


def test_the_torn_last_line_of_a_killed_benchmark_is_dropped(tmp_path):
    Ledger(tmp_path).add({"key": "a", "nrmse": 1.0})
    with (tmp_path / NAME).open("a", encoding="utf-8") as stream:
        stream.write('{"key": "b", "nrm')
    again = Ledger(tmp_path)
    assert set(again.rows) == {"a"}
    again.add({"key": "c", "nrmse": None})
    assert set(Ledger(tmp_path).rows) == {"a", "c"}


@pytest.mark.parametrize("line", ["[1]", "no JSON", 200_000 * "["])
def test_a_line_that_is_no_result_is_refused_with_its_number(tmp_path, line):
    (tmp_path / NAME).write_text(f'{{"key": "a"}}\n{line}\n', encoding="utf-8")
    with pytest.raises(IbridError, match="line 2"):
        Ledger(tmp_path)


def test_a_folder_that_cannot_be_written_gets_one_sentence(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(IbridError, match="another --out"):
        Ledger(tmp_path / "file")


def test_the_summary_gives_medians_and_counts_of_each_group():
    row = {
        "table": "structure",
        "inverter": "droop",
        "data": "clean",
        "proposer": "rules",
        "budget": 5,
        "nrmse": 1e-3,
        "answer_nrmse": 2e-3,
        "truth_nrmse": 0.0,
        "holdout": None,
        "modules_f1": 1.0,
        "connections_f1": 0.5,
        "evaluations": 10,
        "first": 4,
        "seconds": 2.0,
        "success": True,
        "seed": 0,
    }
    worse = {**row, "nrmse": 3e-3, "first": None, "success": False, "seconds": 4.0, "seed": 1}
    lines = summary([row, worse, {**row, "proposer": "random"}])
    assert len(lines) == 2
    assert lines[0].split()[4:] == [
        *("3.00e-03", "2.00e-03", "0.00e+00", "-", "1.00/0.50", "10"),
        "-",  # unknown: half of the seeds never got to the limit
        *("4.0", "1", "of", "2"),
    ]
    assert lines[1].split()[-4:] == ["2.0", "1", "of", "1"]
    assert len(seed_line(row)) == len(heading())


def test_the_page_shows_the_sums_of_several_seeds_and_single_searches_whole_and_what_is_missing():
    row = {
        "table": "structure",
        "inverter": "paper_like",
        "data": "clean",
        "proposer": "rules",
        "budget": 1000,
        "nrmse": 1e-9,
        "answer_nrmse": 2e-9,
        "truth_nrmse": 1e-15,
        "holdout": 3e-9,
        "modules_f1": 1.0,
        "connections_f1": 1.0,
        "workers": 1,
        "evaluations": 250,
        "first": 120,
        "seconds": 90.0,
        "success": True,
        "seed": 11,
        "free_parameters": 13,
    }
    lost = {**row, "seed": 10, "nrmse": 0.01, "first": None, "success": False, "modules_f1": 0.5}
    nobody_knows = dict.fromkeys(("success", "modules_f1", "connections_f1", "truth_nrmse"))
    alone = {**row, "seed": 13, "table": "hardware", "inverter": "gti_pq", **nobody_knows}
    text = page(
        {str(number): one for number, one in enumerate([row, {**row, "seed": 13}, lost, alone])}
    )
    sections = {part.partition("\n")[0]: part for part in text.split("\n## ")[1:]}
    lines = [line for line in sections["paper_like, clean"].splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert cells[0][4:8] == ["10 to 11, 13", "2 of 3", "2 of 3", "1.0e-09 (1.0e-09 to 0.0100)"]
    assert cells[0][8:] == ["1.00 / 1.00", "120", "90"]
    assert len(cells) == 1
    two = [{**row, "table": "inverters"}, {**lost, "table": "inverters", "inverter": "delay"}]
    other = page({one["inverter"]: one for one in two}).partition("## Other hidden inverters")[2]
    assert "| clean | rules | 2 | 2 | 1 of 2 | 1 of 2 | 250 | 90 |" in other
    assert [line.split(" | ")[4:7] for line in other.splitlines() if line.startswith("| `")] == [
        *[["11", "1.0e-09", "2.0e-09"], ["10", "0.0100", "2.0e-09"]]
    ]
    assert sections["Measured hardware"].count("| `gti_pq`") == 1  # one search has no medians
    assert text.count("Not measured yet.") == 6


def test_the_page_in_the_docs_is_that_of_the_shipped_results():
    docs = Path(__file__).resolve().parents[2] / "docs"
    rows = Ledger(docs / "measured" / "search").rows
    assert (docs / "search_results.md").read_text(encoding="utf-8") == page(rows)
    searches = [row for row in rows.values() if row["table"] not in ("beside", "speed")]
    names = [Trial(**{name: row[name] for name in asdict(trial())}).key for row in searches]
    assert names == [row["key"] for row in searches]


def test_the_candidates_of_the_speed_table_are_80_structures_of_13_states():
    programs = candidates()
    diagrams = [ibrid.parse_program(text) for text in programs]
    assert all(ibrid.violations(one) == () for one in diagrams)
    assert (
        len({ibrid.structure_hash(one, ibrid.VOCABULARY, equilibrium="exact") for one in diagrams})
        == 80
    )
    kinds = {kind.name: kind for kind in ibrid.VOCABULARY}
    assert {sum(kinds[part.kind].order for part in one.instances) for one in diagrams} == {13}


def test_the_archive_is_timed_at_its_cap():
    assert 0 < archive_milliseconds(entries=300, rounds=50) < 1e3


def test_the_speed_table_measures_each_figure_once(tmp_path, monkeypatch):
    measured: list[str] = []

    def once(name: str, value: Any):
        def measure(*_: Any, **options: Any) -> Any:
            measured.append(name)
            return (
                Pace(options["workers"], 100, 10.0 / options["workers"], 9.6)
                if value is None
                else value
            )

        return measure

    monkeypatch.setattr(speed_table, "archive_milliseconds", once("archive", 0.06))
    monkeypatch.setattr(speed_table, "fits_a_second", once("fits", 12.0))
    monkeypatch.setattr(speed_table, "pace", once("pace", None))
    monkeypatch.setattr(speed_table, "learns", lambda: True)
    step = {"answers": 512, "sampling": 10.0, "update": 5.5}
    monkeypatch.setattr(speed_table, "policy_step", once("step", step))
    lines = list(speed_table.speed_lines(Ledger(tmp_path), answering(NAIVE), tmp_path))
    assert measured == ["archive", "fits", "fits", "pace", "pace", "step"]
    assert "0.060 ms" in lines[0]
    assert "not fitting 4.0%" in lines[3]
    assert "2.00 x" in lines[4]
    assert "512 answers                15.5 s" in lines[5]
    assert list(speed_table.speed_lines(Ledger(tmp_path), answering(NAIVE), tmp_path)) == lines
    assert len(measured) == 6


def test_the_speed_table_says_why_a_step_of_the_policy_is_not_timed(tmp_path, monkeypatch):
    monkeypatch.setattr(speed_table, "learns", lambda: False)
    ledger = Ledger(tmp_path)
    for name in ("archive", "fits-1", "fits-2", "search-1-500", "search-2-500"):
        ledger.add(
            {
                "key": f"speed-{name}",
                "milliseconds": 1.0,
                "rate": 2.0,
                "workers": 1,
                "evaluations": 500,
                "overhead": 0.1,
            }
        )
    lines = list(speed_table.speed_lines(ledger, answering(NAIVE), tmp_path))
    assert lines[-1].endswith("not measured, it needs torch and transformers; make setup-llm")
    assert not any("policy" in key for key in ledger.rows)


@pytest.mark.skipif(not speed_table.learns(), reason="needs torch and transformers; make setup-llm")
@pytest.mark.filterwarnings("default")  # torch and transformers have warnings of their own
def test_a_step_of_the_policy_is_timed_in_a_search(tmp_path):
    found = policy_step(ibrid.search, tmp_path / "run", answers=16)
    assert found["answers"] == 16
    assert 0 < found["sampling"] < 100
    assert 0 < found["update"] < 100


def test_programs_become_records_at_a_rate():
    assert fits_a_second(local, [NAIVE, NAIVE]) > 0


def test_a_course_keeps_the_best_error_within_each_limit_and_ends_beyond_all_of_them(monkeypatch):
    spent = iter([0.0, 14.0, 16.0, 40.0, 61.0])
    monkeypatch.setattr(side_by_side.time, "process_time", lambda: next(spent))

    def search(sweep, folder, *, progress, **options):
        for evaluations, best in ((1, 0.9), (31, 0.5), (99, 0.2), (101, 0.1)):
            progress.update(Snapshot(evaluations=evaluations, best=best))
        raise AssertionError("it was to end")

    row = side_by_side.course(trial(noise_db=50.0), FOLDER, search)
    assert row["after"] == {
        "evaluations": {"10": 0.9, "30": 0.9, "100": 0.2},
        "seconds": {"15": 0.9, "30": 0.5, "60": 0.2},
    }
    assert row["truth_nrmse"] == pytest.approx(10 ** (-50 / 20), rel=0.2)


def test_the_table_of_courses_counts_what_reached_the_noise_and_shows_the_median_of_the_rest():
    after = {
        "evaluations": {"10": None, "30": 0.02, "100": 0.0109},
        "seconds": {"15": 0.5, "30": 0.012, "60": 0.012},
    }
    rows = [{"proposer": "rules", "truth_nrmse": 0.01, "table": "beside", "after": after}]
    ((name, number, *cells),) = side_by_side.lines(rows)
    assert (name, number) == ("rules", "1")
    assert cells == ["0, 0, 1", "-, 2, 1.09", "0, 0, 0", "50, 1.2, 1.2"]
    assert "| rules | 1 | 0, 0, 1 | -, 2, 1.09 |" in page({"beside-it": rows[0]})
