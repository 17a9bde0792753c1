"""A second device behind the terminals: proposed only where it is asked for, with shares that a
device can have.
"""

from dataclasses import replace

import pytest
from ibrid_search.archives.appraisal import Appraisal
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.running import _devices
from ibrid_search.screening.candidate_edits import list_family_edits
from ibrid_search.screening.plausibility import find_impossible_values
from ibrid_search.screening.selection_criterion import build_criterion
from ibrid_search.settings import SearchSettings
from ibrid_search.step import Status, Step

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.parts.editing.device import device_parts
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.study import Study

PAIR = ibrid.textbook("parallel_gfl_gfm")


@pytest.fixture(scope="module")
def study() -> Study:
    """Of data of two devices, asked for one."""
    return Study(ibrid.read_sweep(ibrid.benchmarks()["parallel_gfl_gfm"]), devices=1)


@pytest.mark.slow
@pytest.mark.parametrize("devices", [1, 2])
def test_a_second_device_is_an_idea_only_where_two_are_asked_for(study, devices):
    asked = replace(study, devices=devices)
    ideas = [one.diagram for one in list_family_edits(ibrid.textbook("gfl_l_filter"), asked)]
    assert max(len(device_parts(one, asked.kinds)) for one in ideas) == devices
    parent = Evaluated(0, ibrid.textbook("naive"), ibrid.Record("ok", nrmse=0.0))
    assert Context(asked, parent).is_new(PAIR) == (devices == 2)


def test_a_start_of_two_devices_says_that_there_are_two(study):
    everything = replace(study, devices=2)
    assert _devices(None, everything.kinds) == _devices("nonsense", everything.kinds) == 1
    assert _devices(program_text(PAIR), everything.kinds) == _devices(PAIR, everything.kinds) == 2


def test_the_vocabulary_keeps_its_name_without_a_second_device(study):
    assert study.vocabulary_name == "extended"
    assert [kind.name for kind in study.kinds if kind.shares] == []


def _with_shares(binding: str) -> str:
    return program_text(PAIR).replace(
        'g.add("Share", "gfl_share")', f'g.add("Share", "gfl_share"{binding})'
    )


def test_a_share_lies_between_nothing_and_everything_unless_its_binding_says_otherwise():
    kinds, wide = (
        Study(ibrid.read_sweep(ibrid.benchmarks()["parallel_gfl_gfm"])).kinds,
        ", share_q=(-2.0, 3.0)",
    )
    diagrams = [PAIR, parse_program(_with_shares(wide), "the pair")]
    tables = [
        {one.name: one for one in parameter_table(wire(diagram, kinds), "exact").free}
        for diagram in diagrams
    ]
    boxes = [(table["gfl_share.share_q"].low, table["gfl_share.share_q"].high) for table in tables]
    assert boxes == [(0.0, 1.0), (-2.0, 3.0)]
    assert len({structure_hash(diagram, kinds) for diagram in diagrams}) == 2
    assert (tables[1]["gfl_share.share_p"].low, tables[1]["gfl_share.share_p"].high) == (0.0, 1.0)


@pytest.fixture(scope="module")
def records(study) -> dict[float, ibrid.Record]:
    """share_q -> record of the pair, with everything else as typical."""
    kinds, sweep = replace(study, devices=2).kinds, study.sweep
    typical = {one.name: one.typical for one in parameter_table(wire(PAIR, kinds), "exact").free}
    return {
        share: record_at(PAIR, sweep, {**typical, "gfl_share.share_q": share})
        for share in (0.0, 0.5)
    }


def test_a_share_at_the_end_of_its_box_is_impossible(records):
    assert find_impossible_values(records[0.0]) == ("gfl_share.share_q",)
    assert find_impossible_values(records[0.5]) == ()


def test_what_is_impossible_ranks_behind_all_that_is_possible(study, records):
    """However small its error."""

    class Stored:
        def record(self, number, kinds):
            return (replace(records[0.0], nrmse=1e-6, over_noise=0.1), records[0.5])[number]

    two = replace(study, devices=2)
    appraisal = Appraisal(Stored(), build_criterion(two, SearchSettings()), two.kinds)  # pyright: ignore[reportArgumentType]
    text = program_text(PAIR)
    steps = [
        Step(number=number, program=text, status=Status.OK, nrmse=1.0, free=25, order=23)
        for number in (0, 1)
    ]
    assert min(steps, key=appraisal.rank).number == 1
    assert not appraisal.at_floor(steps[0])
