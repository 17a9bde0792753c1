"""What the tables of docs/events.md are made of: twins are twins, CVODES integrates the same
laws.
"""

import numpy as np
from ibrid_bench.playback.cost import HEADER, cost_of
from ibrid_bench.playback.twins import drawn, twin_of, values_of

from ibrid.evaluation.evaluate import record_at
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.structure.diagrams.library import textbook


def test_the_twin_has_the_admittance_of_the_device_and_is_its_own_twin():
    numbers, frequency = drawn(3), np.geomspace(1, 5000, 20)
    twin = twin_of(numbers)
    assert abs(twin["kP_c"] / numbers["kP_c"] - 1) > 0.3
    np.testing.assert_allclose(list(twin_of(twin).values()), list(numbers.values()))
    point = PointSweep(
        OperatingPoint("it", 0.8, 0.1),
        frequency,
        np.broadcast_to(np.eye(2, dtype=complex), (20, 2, 2)),
    )
    sweep = Sweep((point,), power_node="pcc")
    one, other = (
        record_at(textbook("gfl_exact"), sweep, values_of(each)).response("it", frequency)
        for each in (numbers, twin)
    )
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(one).max())


def test_cvodes_integrates_the_laws_that_the_compiled_steps_play():
    cost = cost_of("gfl_l_filter")
    assert cost.apart < 1e-5  # its tolerance, 1e-8 a step
    assert len(cost.cells) == len(HEADER)
    assert cost.states == 8
