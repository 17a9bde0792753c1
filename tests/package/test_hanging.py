"""The safety net under processes: what hangs is told from what works or waits for its turn by its
processor time alone.
"""

import pytest

from ibrid.errors import IbridError
from ibrid.hanging import HangWatch


def looked(used: list[float], **options) -> list[str]:
    """What a watch says at each look, at a process that has taken so much processor time by
    then.
    """
    readings = iter([0.0, *used])
    watch = HangWatch(lambda: next(readings), **options)
    return [watch.why_it_hangs() for _ in used]


def test_a_process_that_works_does_not_hang():
    assert looked([0.9 * look for look in range(1, 40)], still=5) == [""] * 39


def test_a_process_that_gets_a_fiftieth_of_a_core_waits_for_its_turn():
    assert looked([0.02 * look for look in range(1, 40)], still=5) == [""] * 39


def test_a_process_that_does_nothing_hangs_after_so_many_looks():
    assert looked([0.0] * 5, still=5) == [""] * 4 + ["did nothing in 5 looks"]


def test_what_keeps_a_process_in_touch_with_others_is_no_work():
    assert (
        looked([0.01 * (look // 4) for look in range(1, 13)], still=12)[-1]
        == "did nothing in 12 looks"
    )


def test_work_between_two_rests_begins_the_count_anew():
    assert looked([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], still=4) == [""] * 7


def test_far_more_processor_time_than_any_job_takes_is_a_hang():
    assert looked([50.0, 101.0], limit=100.0) == ["", "took more than 100 s of processor time"]


def test_a_limit_that_means_nothing_is_refused():
    with pytest.raises(IbridError, match="must be above 0 s"):
        HangWatch(lambda: 0.0, limit=0.0)
