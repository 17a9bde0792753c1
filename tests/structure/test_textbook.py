"""The textbook diagrams that ship as program files."""

import pytest
from collecting import each_of

from ibrid.errors import ProgramError
from ibrid.modules import PAPER_VOCABULARY, VOCABULARY
from ibrid.structure import (
    parse_program,
    structure_hash,
    textbook,
    textbook_names,
    textbook_text,
    violations,
    warnings,
    wire,
)

#: Sum of the states: LCL 6 or L filter 2, PLL 2, two power loops 1 each, current control 2; a Delay
#: counts 2. A DC link adds 1; a frame of its own 1, each droop 1, an oscillator 1, voltage control
#: 2, damping by the voltage 2.
ORDERS = {
    "naive": 2,
    "gfl": 12,
    "gfl_exact": 12,
    "gfl_pll_filter": 13,
    "gfl_pll_filter_exact": 13,
    "gfl_power_filter": 14,
    "gfl_delay": 14,
    "gfl_l_filter": 8,
    "gfl_l_filter_delay": 10,
    "gfl_dc_link": 13,
    "gfm_droop": 15,
    "gfm_vsm": 17,
    "gfm_dvoc": 14,
    "hybrid_gfl_gfm": 14,
    "parallel_gfl_gfm": 23,
}
IN_THE_PAPERS_KINDS = ("naive", "gfl", "gfl_pll_filter")


def test_the_shipped_programs_are_these():
    assert set(textbook_names()) == set(ORDERS)


@pytest.mark.slow
@each_of("name", textbook_names())
def test_a_textbook_diagram_is_legal_without_a_warning(name):
    diagram = textbook(name)
    assert violations(diagram) == ()
    assert warnings(diagram) == ()
    assert violations(diagram, equilibrium="paper") == ()


@each_of("name", textbook_names())
def test_only_the_papers_diagrams_use_the_papers_kinds_alone(name):
    assert (violations(textbook(name), PAPER_VOCABULARY) == ()) == (name in IN_THE_PAPERS_KINDS)


@pytest.mark.parametrize("name", IN_THE_PAPERS_KINDS)
def test_the_papers_diagrams_are_legal_in_the_papers_mode_without_a_warning(name):
    assert warnings(textbook(name), PAPER_VOCABULARY, equilibrium="paper") == ()


@each_of("name", textbook_names())
def test_a_textbook_diagram_has_its_order(name):
    assert (
        sum(kind.order for kind in wire(textbook(name), VOCABULARY).kinds.values()) == ORDERS[name]
    )


@each_of("name", textbook_names())
def test_a_textbook_program_says_what_it_is(name):
    text = textbook_text(name)
    assert text.startswith("def build_")
    assert '"""' in text.splitlines()[1]


def test_the_textbook_diagrams_differ_in_structure():
    assert len({structure_hash(textbook(name)) for name in textbook_names()}) == len(
        textbook_names()
    )


def test_the_naive_program_is_the_start_of_the_search():
    start = """
def build_gfl_skeleton(g):
    g.add("LFilter", "plant")
    g.add("Gain_dq", "gain")
    g.add("ConstZero", "no_frequency")
    g.connect("v_DQ", "plant.v_in")
    g.connect("v_DQ", "gain.in_")
    g.connect("gain.out", "plant.u_r")
    g.connect("no_frequency.out", "plant.delta_omega")
    g.connect("plant.i_g", "i_DQ")
"""
    assert textbook("naive") == parse_program(start)


def test_an_unknown_textbook_name_is_refused_with_near_names():
    with pytest.raises(ProgramError, match="did you mean gfl_delay"):
        textbook("gfl_dealy")
