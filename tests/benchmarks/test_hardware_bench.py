"""The bench of simulated hardware: the cases it draws, what its table counts, what its devices are;
no gap is looked for here.
"""

from dataclasses import replace

import numpy as np
from ibrid_bench.gap.hardware import design, report
from ibrid_bench.hidden.device import admittance
from ibrid_bench.hidden.further import FURTHER
from ibrid_bench.hidden.hardware import HARDWARE, draw_hardware

import ibrid
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE, insertions
from ibrid.structure.diagrams.program import parse_program

ROW = {"holdout": 1.2, "all_named": None, "seconds": 10.0, "named_first": True}


def test_every_effect_comes_alone_and_in_a_pair_and_the_same_seed_gives_the_same_cases():
    cases = design(44, 1)
    assert cases == design(44, 1)
    assert {one[0] for one in cases if len(one) == 1} == {one.key for one in HARDWARE}
    assert {name for one in cases if len(one) == 2 for name in one} == {one.key for one in HARDWARE}


def test_a_wrong_scale_of_powers_lies_in_the_labels_and_the_held_out_point_is_right():
    case = draw_hardware(5, ["power_scale"], frequencies=4, points=1)
    plain = draw_hardware(5, ["delay_angle"], frequencies=4, points=1)
    (wrong,), (right,), (held_out,) = case.sweep.points, plain.sweep.points, case.held_out.points
    assert abs(wrong.op.p / right.op.p - 2**0.5) < 1e-12
    assert held_out.op.p == 0.6


def test_the_table_counts_by_what_is_hidden():
    rows = [
        {**ROW, "hidden": ["dead_time:add:converter"]},
        {**ROW, "hidden": ["delay_angle:add:command"], "named_first": False, "holdout": 3.0},
        {
            **ROW,
            "hidden": ["dead_time:add:converter", "delay_angle:add:command"],
            "all_named": True,
        },
    ]
    told = report(rows)
    assert "| alone | 2 | 1 of 2 |  | 1 of 2 | 2.10 | 10 |" in told
    assert "| in pairs | 1 | 1 of 1 | 1 of 1 | 1 of 1 | 1.20 | 10 |" in told
    assert "| dead_time:add:converter | 2 | 2 of 2 | 1 of 1 | 2 of 2 | 1.20 | 10 |" in told


def test_what_else_is_hidden_answers_as_the_catalogue_says():
    """The device's own equations against a fit of the model with the catalogue's edit, drawn and
    assembled by other code.
    """
    wrong = []
    for effect in FURTHER:
        case = draw_hardware(3, [effect.key], frequencies=16, points=2, pool=FURTHER)
        exact = [
            replace(
                one,
                admittance=admittance(
                    case.device, one.op, one.frequency, power_node=case.sweep.power_node
                ),
            )
            for one in case.sweep.points
        ]
        sweep, model = (
            replace(case.sweep, points=tuple(replace(one, sigma=None) for one in exact)),
            case.program,
        )
        edits = [
            one
            for one in insertions(parse_program(model), VOCABULARY, CATALOGUE)
            if one.effect == effect.id
        ]
        errors = [
            ibrid.evaluate(one.diagram, sweep, restarts=1).nrmse or np.inf
            for one in edits
            if one.change == effect.change
        ]
        # the catalogue's hold is rational, 1e-3 at the top of the band
        close = 1e-4 if effect.id == "zero_order_hold" else 1e-9
        wrong += [(effect.key, errors)] if not min(errors, default=np.inf) < close else []
    assert not wrong
