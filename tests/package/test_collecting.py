"""Cases that a test loops over are all checked, and all that fail are told together."""

import pytest
from collecting import collecting, each_of


def test_each_case_is_checked_and_all_failures_are_told_together():
    seen = []

    @each_of("number", [1, 2, 3], ids=["first", "second", "third"])
    @each_of(("sign", "word"), [pytest.param(1, "plus", id="up"), (-1, "minus")])
    def checked(number, sign, word):
        seen.append((number, sign, word))
        assert number * sign != 2, word

    with pytest.raises(
        AssertionError, match=r"1 of 3 cases fail\nsecond: .*1 of 2 cases fail\nup: .*plus"
    ):
        checked()
    assert len(seen) == 6


def test_a_loop_is_skipped_only_where_all_its_cases_are():
    def loop(skipped):
        with collecting() as failures:
            for case in (1, 2):
                with failures.case(case):
                    if case in skipped:
                        pytest.skip("not here")

    loop([1])
    with pytest.raises(pytest.skip.Exception):
        loop([1, 2])
