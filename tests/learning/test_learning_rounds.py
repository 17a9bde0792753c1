"""Which step is which answer, and what it may see: both follow from the steps alone."""

import numpy as np
from ibrid_policy.learning.rounds import AnswerPlace as Place
from ibrid_policy.learning.rounds import Rounds
from ibrid_search.step import Status, Step


def fed(
    words: str, contexts: int = 2, group: int = 3, window: int = 4, *, waits: bool = True
) -> tuple[Rounds, list[int]]:
    """Rounds that saw steps: `L` of the one that learns, `-` of others; and the horizon before each
    step that follows.
    """
    rounds, horizons = Rounds("toy", contexts, group, window, waits=waits), []
    for number, word in enumerate(words):
        proposer = {"L": "toy", "-": "pruning", "0": ""}[word]
        rounds.add(Step(number, proposer=proposer, status=Status.OK))
        horizons.append(rounds.horizon)
    return rounds, horizons


def test_steps_fill_groups_and_groups_fill_batches():
    places = []
    for length in range(1, 9):
        rounds, _ = fed("0" + "L" * (length - 1))
        places.append((rounds.next, rounds.leader))
    assert places == [
        (Place(0, 0, 0), None),
        (Place(0, 0, 1), 1),
        (Place(0, 0, 2), 1),
        (Place(0, 1, 0), None),
        (Place(0, 1, 1), 4),
        (Place(0, 1, 2), 4),
        (Place(1, 2, 0), None),
        (Place(1, 2, 1), 7),
    ]


def test_a_batch_sees_the_results_of_the_batches_before_and_none_of_its_own():
    _, horizons = fed("0" + "L" * 13)
    assert [max(one, 0) for one in horizons] == [0] * 6 + [6] * 6 + [12] * 2


def test_steps_of_others_in_between_do_not_count():
    rounds, horizons = fed("0L-L-L--L")
    assert rounds.numbers == [1, 3, 5, 8]
    assert rounds.next == Place(0, 1, 1)
    assert rounds.leader == 8
    assert max(horizons) <= 0


def test_many_steps_of_others_in_a_row_see_what_they_would_without_learning():
    _, horizons = fed("0LL------LL")
    # the fourth of the others is step 6; from then on the last but `window`
    assert [max(one, 0) for one in horizons] == [0, 0, 0, 0, 0, 0, 3, 4, 5, 5, 5]


def test_where_an_update_needs_no_results_every_step_sees_what_it_would_without_learning():
    _, horizons = fed("0LL-L----LLLL", waits=False)
    assert [max(one, 0) for one in horizons] == [0, 0, 0, *range(10)]


def test_what_a_step_may_see_never_becomes_less():
    rng = np.random.default_rng(0)
    for _ in range(200):
        words = "0" + "".join(rng.choice(list("L-"), size=60, p=[0.6, 0.4]))
        _, horizons = fed(
            words, contexts=2, group=int(rng.integers(2, 5)), window=int(rng.integers(1, 6))
        )
        assert horizons == sorted(horizons)
        assert all(one <= number for number, one in enumerate(horizons))


def test_a_batch_is_complete_until_the_next_begins():
    assert [
        fed("0" + "L" * 5 + more)[0].complete for more in ("", "L", "L-", "L--", "LL", "L-L")
    ] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]
    rounds, _ = fed("0" + "L" * 6 + "-")
    assert rounds.numbers == [1, 2, 3, 4, 5, 6]
    assert rounds.batches == 1
