"""What learning may count: nothing invalid ever earns more than something valid."""

from collecting import each_of
from ibrid_search.step import REFUSED, Status, rl_reward

VALID = (0.0, 3.2, -0.7, -40.0)


@each_of(
    "status",
    [
        *REFUSED,
        Status.DUPLICATE,
        Status.UNCHANGED,
        Status.FAILED,
        Status.UNFINISHED,
        Status.REQUIRED,
    ],
)
def test_nothing_invalid_earns_as_much_as_the_worst_valid_candidate(status):
    worst = min(rl_reward(Status.OK, reward) or 0.0 for reward in VALID)
    earned = rl_reward(status, 5.0)
    assert earned is not None
    assert earned < worst == 0.0


def test_no_edit_earns_least_and_a_failed_fit_most_of_what_is_invalid():
    ladder = [Status.NO_EDIT, Status.UNCHANGED, Status.ILLEGAL, Status.FAILED]
    earned = [rl_reward(status, None) for status in ladder]
    assert earned == [-0.4, -0.3, -0.25, -0.2]


def test_what_is_not_the_candidates_fault_is_not_counted():
    assert rl_reward(Status.LOST, None) is None
    assert rl_reward(Status.PENDING, None) is None
