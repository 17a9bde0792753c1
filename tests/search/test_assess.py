"""What is done for a candidate: a quick fit, and a thorough one where the error, as the run
measures it, promises something.
"""

from dataclasses import replace

import numpy as np
import pytest
from ibrid_search.evaluation.assess import QUICK, THOROUGH, Assessor
from ibrid_search.evaluation.job import Job
from ibrid_search.screening.selection_criterion import estimate_noise_floor
from scripted_search import NAIVE, study

from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.study import Study

#: Noise of 1 %, so that a misfit of 1 is an error of 0.01.
NOISY = add_noise(study().sweep, 40, rng=np.random.default_rng(0))

FOUND: dict[FitSettings, Record] = {}


@pytest.fixture
def efforts(monkeypatch: pytest.MonkeyPatch) -> list[FitSettings]:
    """The efforts that were made, in place of fits; `FOUND` says what each finds."""
    made: list[FitSettings] = []

    def record_of(self: Assessor, program: str, settings: FitSettings, warm=None) -> Record:
        made.append(settings)
        return FOUND[settings]

    monkeypatch.setattr(Assessor, "record_of", record_of)
    return made


def record(nrmse: float, misfit: float | None = None, seconds: float = 1.0) -> Record:
    return Record("ok", nrmse=nrmse, over_noise=misfit, seconds=seconds)


def assessed(
    quick: Record, thorough: Record, promising: float | None, *, noisy: bool = False
) -> Record:
    FOUND.update({QUICK: quick, THOROUGH: thorough})
    sweep = NOISY if noisy else study().sweep
    return Assessor(Study(sweep)).assess(Job(1, NAIVE, {}, promising))


def test_what_promises_nothing_gets_a_quick_fit(efforts):
    found = assessed(record(0.5), record(0.1), 0.5)
    assert efforts == [QUICK]
    assert found.nrmse == 0.5


def test_what_promises_something_gets_a_thorough_fit_too(efforts):
    found = assessed(record(0.49), record(0.1), 0.5)
    assert efforts == [QUICK, THOROUGH]
    assert found == replace(record(0.1), seconds=2.0)


@pytest.mark.parametrize(
    ("free", "error", "thorough"), [(7, 0.505, True), (6, 0.505, False), (7, 0.52, False)]
)
def test_an_edit_that_adds_something_and_ends_at_its_parents_error_gets_a_thorough_fit_too(
    efforts, free, error, thorough
):
    """The parent has six free numbers and an error of 0.505; below 0.5 anything promises
    something.
    """
    FOUND.update({QUICK: replace(record(error), free_parameters=free), THOROUGH: record(0.1)})
    found = Assessor(study()).assess(Job(1, NAIVE, {}, 0.5, free_before=6))
    assert efforts == ([QUICK, THOROUGH] if thorough else [QUICK])
    assert found.nrmse == (0.1 if thorough else error)


def test_without_a_parent_everything_promises_something(efforts):
    assessed(record(0.9), record(0.8), None)
    assert efforts == [QUICK, THOROUGH]


def test_the_better_of_both_fits_counts(efforts):
    assert assessed(record(0.4), record(0.45), 0.5).nrmse == 0.4
    failed = Record("failed", reasons=("no operating point",))
    assert assessed(record(0.4), failed, 0.5).nrmse == 0.4
    assert assessed(failed, record(0.1), 0.5) is failed


def test_with_known_noise_the_misfit_promises_and_not_the_nrmse(efforts):
    level = estimate_noise_floor(NOISY).level
    assert level == pytest.approx(0.01, rel=0.02)
    promising = 2.0 * level
    assessed(record(0.9, misfit=1.9), record(0.8, misfit=1.5), promising, noisy=True)
    assert efforts == [QUICK, THOROUGH]
    efforts.clear()
    assessed(record(1e-9, misfit=2.1), record(1e-9, misfit=1.5), promising, noisy=True)
    assert efforts == [QUICK]


def test_with_known_noise_the_lower_misfit_counts(efforts):
    found = assessed(record(0.02, misfit=1.5), record(0.03, misfit=1.2), None, noisy=True)
    assert found.over_noise == 1.2
    found = assessed(record(0.03, misfit=1.2), record(0.02, misfit=1.5), None, noisy=True)
    assert found.over_noise == 1.2
