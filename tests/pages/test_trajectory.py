"""The course of a search: best so far, milestones with the band that got better, line of descent,
and their figures.
"""

# pyright: reportReturnType=false

import csv
import io
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from ibrid_search.report.page import lineage
from ibrid_search.run.selection import plain_selection
from ibrid_search.run.tally import Tally, counts
from ibrid_search.run.trajectory import (
    ROUNDING,
    band_that_got_better,
    best_step,
    milestones,
    trajectory,
    trajectory_csv,
)
from ibrid_search.step import EVALUATED, REFUSED, Status, Step
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from ibrid.evaluation.record import Record
from ibrid.report.figures.trajectory import (
    CELLS,
    ErrorAgainstCost,
    Trajectory,
    draw_front,
    draw_trajectory,
)
from ibrid.report.look.figure import inline_svg
from ibrid.structure.comparison.compare import difference

BANDS = ("5-50", "50-500", "500-2000", "2000-5000")


def step(number: int, nrmse: float | None = None, parent: int | None = 0, **more) -> Step:
    """A step that was fitted, stable unless told otherwise."""
    given = {
        "status": Status.OK,
        "stable": True,
        "order": 4,
        "free": 5,
        "note": f"edit {number}",
        **more,
    }
    return Step(number=number, parent=None if number == 0 else parent, nrmse=nrmse, **given)


def record(
    nrmse: float, shares: tuple[float | None, ...], errors: tuple[float | None, ...]
) -> Record:
    """A record with shares of the squared error and relative errors of the four bands."""
    return Record(
        outcome="ok",
        nrmse=nrmse,
        share_by_band=dict(zip(BANDS, shares, strict=True)),
        nrmse_by_band=dict(zip(BANDS, errors, strict=True)),
    )


def test_best_so_far_never_rises_and_counts_stable_candidates_alone():
    steps = [step(0, 0.9), step(1, 0.5), step(2, 0.1, stable=False), step(3, 0.7), step(4, 0.4)]
    points = trajectory(steps)
    assert [one.best for one in points] == [0.9, 0.5, 0.5, 0.5, 0.4]
    assert [one.better for one in points] == [True, True, False, False, True]
    assert [one.nrmse for one in points] == [0.9, 0.5, 0.1, 0.7, 0.4]


def test_evaluations_count_fits_alone_and_the_start_is_the_first():
    refused = [
        replace(step(1), status=status) for status in (*REFUSED, Status.DUPLICATE, Status.UNCHANGED)
    ]
    refused = [replace(one, number=number) for number, one in enumerate(refused, 1)]
    failed = [
        replace(step(20 + number), status=status)
        for number, status in enumerate(EVALUATED)
        if status != "ok"
    ]
    points = trajectory(
        [step(0, 0.9), *refused, *failed, step(40, 0.5), replace(step(41), status=Status.PENDING)]
    )
    assert [one.step for one in points] == [0, *(one.number for one in failed), 40]
    assert [one.evaluation for one in points] == list(range(1, len(failed) + 3))
    assert [one.best for one in points] == [0.9] * (len(failed) + 1) + [0.5]


def test_a_candidate_that_is_not_what_was_required_is_never_the_best():
    assert best_step([step(0, 0.9), step(1, 0.1, status=Status.REQUIRED)]).number == 0


@pytest.mark.parametrize(
    "bad", [{"stable": None}, {"stable": False}, {"nrmse": None}, {"nrmse": float("nan")}]
)
def test_nothing_is_the_best_before_a_stable_candidate_is_fitted(bad):
    steps = [replace(step(0, 0.9), **bad)]
    assert best_step(steps) is None
    assert trajectory(steps)[0].best is None
    assert milestones(trajectory(steps), {0: steps[0]}, lambda _: None) == ()


def test_errors_that_are_rounding_are_ties_and_the_simplest_of_them_is_the_best():
    steps = [
        step(0, 0.9),
        step(1, 1e-15, free=9),
        step(2, 0.5 * ROUNDING, free=5),
        step(3, 1e-16, free=5, order=8),
    ]
    assert best_step(steps).number == 2
    assert [one.better for one in trajectory(steps)] == [True, True, False, False]


def test_a_gain_of_less_than_a_thousandth_is_no_milestone_but_many_of_them_are():
    steps = [step(0, 1.0), *(step(number, 1.0 - 4e-4 * number) for number in range(1, 6))]
    points = trajectory(steps)
    assert [one.better for one in points] == [True, False, False, True, False, False]
    assert [one.best for one in points] == [one.nrmse for one in steps]


def test_milestone_names_the_band_whose_part_of_the_squared_error_fell_most():
    # shares times NRMSE^2: (0.5, 0.3, 0.2, 0) * 1 before, (0.2, 0.8, 0, 0) * 0.25 after: falls
    # 0.45, 0.10, 0.20, 0
    before, after = (
        record(1.0, (0.5, 0.3, 0.2, 0.0), (0.9, 0.8, 0.7, 0.6)),
        record(0.5, (0.2, 0.8, 0.0, 0.0), (0.1,) * 4),
    )
    assert band_that_got_better(before, after) == "5-50"
    found = milestones(
        trajectory([step(0, 1.0), step(1, 0.5)]),
        {0: step(0, 1.0), 1: step(1, 0.5)},
        {0: before, 1: after}.get,
    )
    assert (found[1].band, found[1].band_before, found[1].band_after) == ("5-50", 0.9, 0.1)
    assert (found[1].before, found[1].after, found[1].note) == (1.0, 0.5, "edit 1")
    assert (found[0].before, found[0].note, found[0].band) == (None, "edit 0", "")


def test_band_and_error_before_are_those_of_the_edited_parent():
    steps = {0: step(0, 0.9), 1: step(1, 0.5), 2: step(2, 0.4, parent=0)}
    records = {
        0: record(0.9, (0, 0, 1.0, 0), (0.1, 0.1, 0.9, 0.1)),
        1: record(0.5, (1.0, 0, 0, 0), (0.5, 0.1, 0.1, 0.1)),
        2: record(0.4, (0.5, 0, 0.5, 0), (0.2, 0.1, 0.2, 0.1)),
    }
    last = milestones(trajectory(steps.values()), steps, records.get)[-1]
    assert last.before == 0.9
    assert (last.band, last.band_before, last.band_after) == ("500-2000", 0.9, 0.2)


def test_no_band_is_named_where_records_lack_or_no_band_got_better():
    one = record(0.5, (1.0, None, None, None), (0.5, None, None, None))
    assert band_that_got_better(None, one) == ""
    assert band_that_got_better(one, None) == ""
    assert band_that_got_better(one, one) == ""
    assert band_that_got_better(Record(outcome="failed"), one) == ""


def test_trajectory_csv_reads_back_with_any_note():
    note = 'a "quoted", comma\nand line'
    points = trajectory(
        [step(0, 0.9), step(1, None, status=Status.FAILED, note=note), step(2, 1 / 3)]
    )
    rows = list(csv.DictReader(io.StringIO(trajectory_csv(points))))
    assert list(rows[0]) == ["evaluation", "step", "nrmse", "best", "what changed"]
    assert [row["evaluation"] for row in rows] == ["1", "2", "3"]
    assert rows[1]["nrmse"] == ""
    assert rows[1]["what changed"] == 'a "quoted", comma and line'
    assert float(rows[2]["best"]) == 1 / 3


def test_lineage_leads_from_the_start_to_the_step_with_what_each_edit_changed():
    texts = [
        "def b(g):\n    a\n    b\n    c\n",
        "def b(g):\n    a\n    x\n    c\n",
        "def b(g):\n    a\n    x\n",
    ]
    steps = {
        number: step(number, 1.0 - number / 10, parent=number - 1, program=text)
        for number, text in enumerate(texts)
    }
    steps[7] = step(7, 0.3, parent=1)
    steps[8] = step(8, 0.2, parent=1)
    path = lineage(steps, 2)
    assert [one.step.number for one in path] == [0, 1, 2]
    assert path[0].difference == ()
    assert [line for line in path[1].difference if line[0] in "+-"] == ["-    b", "+    x"]
    assert [line for line in path[2].difference if line[0] in "+-"] == ["-    c"]
    assert [other.number for other in path[2].others] == [8, 7]


def test_lineage_ends_where_a_parent_is_missing_and_does_not_run_in_circles():
    assert [one.step.number for one in lineage({5: step(5, 0.1, parent=4)}, 5)] == [5]
    circle = {1: step(1, 0.1, parent=2), 2: step(2, 0.1, parent=1)}
    assert [one.step.number for one in lineage(circle, 1)] == [2, 1]
    assert lineage(circle, 9) == ()


def test_difference_of_equal_programs_is_empty_and_gaps_are_marked():
    text = "\n".join(f"line {number}" for number in range(20))
    assert difference(text, text) == ()
    found = difference(text, text.replace("line 3\n", "").replace("line 15", "other"))
    assert found.count("...") == 2
    assert "-line 3" in found
    assert "+other" in found


def test_tally_puts_every_status_in_one_place_and_leaves_out_the_start():
    steps = [
        step(0, 0.9),
        *(replace(step(number), status=one) for number, one in enumerate(Status, 1)),
    ]
    found = Tally.of(counts(steps))
    assert found.answered + found.pending == len(Status)
    assert (found.valid, found.duplicate, found.unchanged, found.refused) == (1, 1, 1, len(REFUSED))
    assert found.failed == 4  # failed, timeout, lost, required
    assert sum(
        found.share(name) for name in ("valid", "duplicate", "unchanged", "refused", "failed")
    ) == pytest.approx(1)
    assert Tally().share("valid") == 0.0


def test_plain_front_keeps_what_nothing_beats_in_error_order_and_parameters():
    steps = [
        step(0, 0.9, order=2, free=3),
        step(1, 0.5, order=6, free=6),
        step(2, 0.6, order=6, free=6),
        step(3, 0.5, order=8, free=5),
        step(4, 0.01, order=9, free=9, stable=False),
        step(5, 1e-12, order=9, free=9),
        step(6, 1e-14, order=9, free=10),
    ]
    found = plain_selection(steps)
    assert {one.step for one in found.front} == {0, 1, 3, 5}
    assert found.answer == 5
    assert set(found.equally_good) == {5, 6}
    assert plain_selection([]).front == ()


def labels_of(shown: Trajectory) -> list[tuple[str, np.ndarray]]:
    """Words and outlines, in pixels, of the labels in a drawn figure, without the lines that lead
    to them.
    """
    figure = Figure(figsize=(11.5, 4.4), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    draw_trajectory([axes], shown)
    canvas.draw()
    return [
        (one.get_text(), Text.get_window_extent(one, canvas.get_renderer()).extents)
        for one in axes.texts
    ]


def descending(number: int, milestones: int, seed: int = 0) -> Trajectory:
    """A search that gets better in random jumps."""
    rng = np.random.default_rng(seed)
    jumps = np.sort(rng.choice(np.arange(1, number), milestones - 1, replace=False))
    best = np.full(number, 0.9)
    for jump in jumps:
        best[jump:] *= rng.uniform(0.3, 0.95)
    nrmse = best * np.exp(rng.exponential(1.0, number))
    spots = [(float(at), float(best[at]), f"an edit of a usual length {at}") for at in (0, *jumps)]
    return Trajectory(
        np.arange(float(number)), nrmse, rng.random(number) > 0.1, best, tuple(spots), 0.02, 0.03
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_labels_of_milestones_do_not_cover_each_other(seed):
    found = [
        (words, box)
        for words, box in labels_of(descending(200, 12, seed))
        if words.startswith("an edit")
    ]
    assert len(found) >= 6
    for (_, one), (_, other) in combinations(found, 2):
        apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
        assert apart


def test_a_label_with_foreign_letters_and_mathematics_is_drawn_as_it_stands():
    shown = replace(descending(20, 2), milestones=((0.0, 0.9, "costs $5 and $x^2$ <b>&漢\x1b[2J"),))
    svg = inline_svg(
        lambda axes: draw_trajectory(axes, shown), name="t", label="t", size=(11.5, 4.4)
    )
    assert "costs $5 and $x^2$ &lt;b&gt;&amp;??[2J" in svg


@pytest.mark.slow
def test_many_candidates_are_thinned_so_that_the_figure_stays_small():
    shown = descending(100_000, 10)
    svg = inline_svg(
        lambda axes: draw_trajectory(axes, shown), name="t", label="t", size=(11.5, 4.4)
    )
    assert svg.count("<use") < 2.1 * CELLS[0] * CELLS[1]  # two kinds of dots, and ticks
    assert len(svg) < 2_000_000


@pytest.mark.slow
@pytest.mark.parametrize(
    "shown",
    [
        Trajectory(np.array([0.0]), np.array([np.nan]), np.array([False]), np.array([np.nan])),
        Trajectory(
            np.array([0.0]),
            np.array([0.9]),
            np.array([True]),
            np.array([0.9]),
            ((0.0, 0.9, "the start"),),
        ),
        Trajectory(
            np.arange(3.0),
            np.array([0.9, 1e9, 1e-15]),
            np.array([True, False, True]),
            np.array([0.9, 0.9, 1e-15]),
            ((0.0, 0.9, "the start"), (2.0, 1e-15, "all of it")),
            None,
            1e-3,
        ),
    ],
)
def test_trajectories_of_any_length_and_range_are_drawn(shown):
    assert "<svg" in inline_svg(
        lambda axes: draw_trajectory(axes, shown), name="t", label="t", size=(11.5, 4.4)
    )


def test_fronts_are_drawn_with_and_without_an_answer():
    front = ((2.0, 0.9), (4.0, 0.1))
    stable = np.array([True, False])
    full = ErrorAgainstCost(
        np.array([2.0, 4.0]), np.array([0.9, 0.1]), stable, front, front[1], "order", 0.05
    )
    empty = ErrorAgainstCost(
        np.array([]), np.array([]), np.array([], dtype=bool), (), None, "order"
    )
    for shown in (full, empty):
        assert "order" in inline_svg(
            lambda axes, shown=shown: draw_front(axes, shown), name="f", label="f", size=(5, 3)
        )
