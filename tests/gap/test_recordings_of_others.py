"""A gap on recordings that are samples of a voltage that goes on between them: clean ones, and
edges shorter than a sample.
"""

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.events.__main__ import EFFECTS, case_of
from ibrid_bench.events.cases import EventCase, draw
from ibrid_bench.events.recorder import Recorder

import ibrid
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.gap.results.gap import Gap
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint


def answered(case: EventCase) -> Gap:
    return ibrid.find_gap(
        case.diagram,
        case.sweep,
        case.values,
        events=case.events,
        holdout_op=(case.held,),
        progress="silent",
    )


@pytest.fixture(scope="module")
def limited() -> Gap:
    """Of a clean recording at 5 kHz with edges of a millisecond, of a device with a current
    limit.
    """
    return answered(draw("current_limit", 0, None, swept=False))


@pytest.mark.nightly
def test_a_limit_is_named_in_a_clean_recording(limited: Gap) -> None:
    assert limited.verdict == "named"
    assert [one.id for one in limited.effects] == ["current_limit"]
    truth = draw("current_limit", 0, None, swept=False).limits["current_limit"]["i_max"]
    estimate, *_ = limited.effects[0].parameters["current_limit.i_max"]
    assert estimate == pytest.approx(truth, rel=1e-3)


@pytest.mark.nightly
def test_the_floor_of_each_recording_is_said_and_holds_for_the_one_that_was_kept_out(
    limited: Gap,
) -> None:
    assert limited.events is not None
    floors, (held,) = limited.events.floors, limited.held_out
    assert "what sampling leaves open" in limited.noise
    assert set(floors) == {one.record.name for one in limited.events.after.records}
    assert limited.noise_floor == pytest.approx(
        np.mean([floors[name] for name in floors if name != held])
    )
    assert limited.after["holdout"] is not None
    assert limited.after["holdout"] < 1.5 * floors[held]


@pytest.mark.nightly
@each_of(
    ("hidden", "seed"),
    [
        ("current_limit", 0),  # 2 kHz, and other parameters explain as much as sampling leaves open
        ("reference_ramp", 8),  # the same, and another block
        ("delay", 0),  # 1 kHz, as the first
        ("delay", 12),  # the same beside a sweep, and what is edited is doubted in its turn
        ("feedforward_filter", 8),  # another filter explains what nominal values leave open
        ("virtual_impedance", 8),  # in a valley of the samples as steps of a program
    ],
)
def test_what_is_hidden_is_named_where_sampling_leaves_much_open(hidden: str, seed: int) -> None:
    case, _ = case_of(hidden, seed)
    assert [one.id for one in answered(case).effects][:1] == [EFFECTS.get(hidden, hidden)]


@pytest.mark.slow
@pytest.mark.parametrize("rise", [1e-3, 1e-4])
def test_nothing_is_named_where_nothing_is_hidden(rise: float) -> None:
    gap = answered(draw("nothing", 0, None, swept=False, recorder=Recorder(5000.0), rise=rise))
    assert gap.verdict in ("no-gap", "parameters-only")
    assert gap.repaired.grade == "explains"


@pytest.mark.slow
def test_offsets_and_unequal_gains_of_channels_are_no_effect() -> None:
    recorder = Recorder(5000.0, frame="abc", bits=16, noise_db=80.0, offset=5e-4, unbalance=5e-4)
    gap = answered(draw("nothing", 1, 80.0, swept=False, recorder=recorder))
    assert gap.verdict in ("no-gap", "parameters-only")


@pytest.mark.parametrize("sigma", [None, 1e-3])
def test_a_floor_is_told_of_a_device_that_delivers_nothing_at_rest(sigma: float | None) -> None:
    time = np.arange(600) / 5000
    v = np.stack([np.where(time < 0.06, 1.0, 0.9), np.zeros(600)], axis=1)
    i = np.where(time < 0.06, 0.0, 0.05)[:, None] * np.ones(2)
    stated = None if sigma is None else np.full(600, sigma)
    record = EventRecord(
        OperatingPoint("dip", 0.0, 0.0, 1.0), time, v, i, 0.059, sigma=stated, f0_hz=60.0
    )
    events = Events((record,), f0_hz=60.0)
    problem = build_event_problem(ibrid.textbook("gfl_exact"), None, None, events, {})
    noise = problem.build_dataset({}).noise
    assert np.isfinite(noise.of["dip"].sigma).all()
    assert 0 < noise.floors["dip"] < np.inf
    assert noise.noise_dof > 0
