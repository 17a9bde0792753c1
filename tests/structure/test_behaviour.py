"""What a block does is found from its declaration: the kinds that ship, copies of them, and kinds
of one's own.
"""

from dataclasses import replace

from collecting import each_of

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import VOCABULARY, find_kind, usual_kind
from ibrid.signals import Signal

ELEMENTS = {
    Element.GAIN: "Gain Gain_dq",
    Element.COUPLING: "JMul",
    Element.PI: "PI PI_dq",
    Element.PLL: "SRF_PLL SRF_PLL_P SRF_PLL_ref",
    Element.DELAY: "Delay",
    Element.INTEGRATOR: "Integrator",
    Element.LOW_PASS: "LPF1 LPF1_dq",
    Element.NOTCH: "Notch",
    Element.PADE: "Pade1 Pade1_dq Pade2_dq Pade3_dq Pade4_dq",
    Element.SIGN: "Negate Negate_dq",
    Element.COUPLING_AT_FREQUENCY: "JMul_omega",
    Element.PACK: "PackDQ",
    Element.SLICE_D: "SliceD",
    Element.SLICE_Q: "SliceQ",
    Element.MAGNITUDE: "Magnitude",
    Element.ZERO: "ConstZero",
    Element.ROTATION_IN: "Rot_v",
    Element.ROTATION_OUT: "Rot_i",
    Element.POWER: "PQ_calc",
    Element.FREQUENCY_METER: "PLL_frequency",
    Element.OSCILLATOR: "dVOC",
    Element.FILTER: "LCL LFilter LCL_R LCL_RC LLFilter LCL_trap LCL_saturated",
    Element.SHUNT: "Shunt_RC",
    Element.DC_LINK: "DC_link",
    Element.SHARE: "Share",
    Element.CONVERTER_LOSS: "DeadTime",
    Element.TURN: "Turn",
    Element.HOLD: "ZOH_dq",
    Element.BAND_PASS: "SOGI_dq SOGI_fixed",
    Element.POSITIVE_SEQUENCE: "DSOGI_dq DDSRF_dq DSOGI_fixed",
    Element.RESONATOR: "Resonant_dq",
    Element.NEGATIVE_PI: "PI_negative_dq",
    Element.REFERENCE: "Ref_pq",
}


def _second_order(omega_c):
    return [[0, omega_c], [-omega_c, -1.4 * omega_c]], [[0], [omega_c]], [[1, 0]], [[0]]


OWN = ModuleKind(
    name="Smooth",
    family="dynamic control",
    law="out = omega_c^2/(s^2 + 1.4 omega_c s + omega_c^2) in_",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("rate", "filtered"),
    parameters={"omega_c": Range(1.0, 1e5, 300.0, "rad/s", "corner frequency")},
    state_space=_second_order,
    reference="one's own",
    dc_gain=1.0,
)


def test_every_kind_that_ships_is_told_what_it_is():
    told = {kind.name: kind.element for kind in VOCABULARY}
    assert told == {name: element for element, names in ELEMENTS.items() for name in names.split()}


@each_of("kind", VOCABULARY, ids=lambda kind: kind.name)
def test_a_copy_under_another_name_does_the_same(kind):
    copy = replace(kind, name="My" + kind.name)
    facts = (
        "element",
        "in_line",
        "signal",
        "per_axis",
        "passes",
        "shapes",
        "regulates",
        "integrates",
    )
    assert [getattr(copy, fact) for fact in facts] == [getattr(kind, fact) for fact in facts]


def test_a_filter_of_ones_own_is_a_filter():
    assert OWN.element is Element.LOW_PASS
    assert OWN.shapes
    assert OWN.passes
    assert not OWN.regulates


def test_kinds_with_other_numbers_are_what_their_law_says():
    gain = find_kind("Gain", VOCABULARY)
    assert (
        replace(gain, name="Square", state_space=lambda k: ([], [], [[]], [[k * k]])).element
        is None
    )
    assert (
        replace(gain, name="Wire", parameters={}, state_space=lambda: ([], [], [[]], [[1]])).element
        is None
    )
    zero = replace(gain.parameters["k"], typical=0.0)
    assert replace(gain, name="Trim", parameters={"k": zero}).element is Element.GAIN
    axes = find_kind("Gain_dq", VOCABULARY)
    salient = replace(
        axes, name="Salient", state_space=lambda k: ([], [], [[], []], [[k, 0], [0, 2 * k]])
    )
    assert salient.element is None
    assert salient.passes


def test_what_adds_a_block_takes_the_first_kind_of_the_vocabulary_that_does_it():
    assert usual_kind(Element.SIGN, Signal.DQ_VEC).name == "Negate_dq"
    assert usual_kind(Element.LOW_PASS, Signal.SCALAR, (OWN,)) is OWN
    assert usual_kind(Element.PI, Signal.SCALAR, (OWN,)).name == "PI"
