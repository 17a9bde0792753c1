"""Results that tests share: one value however it is asked for, and a test that changes it is
told.
"""

from dataclasses import dataclass, field

import numpy as np
import pytest
from sharing import asked_for, changed_results, digest, shared

import ibrid


@dataclass(frozen=True)
class Made:
    numbers: np.ndarray = field(default_factory=lambda: np.zeros(3))
    names: dict[str, list[float]] = field(default_factory=lambda: {"a": [1.0]})
    diagram: ibrid.Diagram = field(default_factory=lambda: ibrid.textbook("naive"))


@shared
def made(name: str, factor: float = 1.0) -> Made:
    return Made()


def change_numbers(value: Made) -> None:
    value.numbers[1] = 1e-300


def change_names(value: Made) -> None:
    value.names["a"].append(2.0)


def change_diagram(value: Made) -> None:
    value.diagram.add("Gain", "another")


def test_one_result_however_its_arguments_are_written():
    first = made("one")
    assert made(name="one") is first
    assert made("one", 1.0) is first
    assert made("two") is not first


@pytest.mark.parametrize("change", [change_numbers, change_names, change_diagram])
def test_a_test_that_changes_what_others_share_is_told(change):
    value = made(change.__name__)
    assert changed_results() == []
    change(value)
    assert changed_results() == [f"made{(change.__name__, 1.0)}"]
    asked_for.clear()  # as at the end of a test: this one changes it on purpose


def test_what_is_kept_beside_the_fields_of_a_value_is_no_change():
    value = Made()
    before = digest(value)
    value.__dict__["cache"] = 3.0
    assert digest(value) == before
    assert digest(Made()) == before
