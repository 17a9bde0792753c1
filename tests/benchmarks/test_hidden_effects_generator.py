"""Devices that hide effects: their responses are right in two independent ways, and cases say what
they should and no more.
"""

import ast
import json
from dataclasses import fields, replace
from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np
import pytest
from collecting import collecting, each_of
from ibrid_bench.hidden.__main__ import main
from ibrid_bench.hidden.bases import BASES, draw_base
from ibrid_bench.hidden.case import KINDS, UNDERSTATED, Case, Kind, draw_case, write_case
from ibrid_bench.hidden.declaration import SEVERITIES, HiddenEffect
from ibrid_bench.hidden.device import (
    OMEGA_60,
    Device,
    Linearised,
    admittance,
    linearise,
    power_node_of,
    stable,
)
from ibrid_bench.hidden.effects import HIDDEN
from ibrid_bench.hidden.elsewhere import CONVENTIONS, FOREIGN
from ibrid_bench.hidden.equations import equations, values_of
from ibrid_bench.hidden.hardware import HARDWARE, draw_hardware
from ibrid_bench.hidden.nominal import nominal_values
from ibrid_bench.hidden.points import HELD_OUT
from ibrid_bench.hidden.program import block_diagram
from ibrid_bench.hidden.rest import at_rest
from ibrid_bench.hidden.winding import unstable_zeros
from ibrid_bench.hidden.written import Measurement
from ibrid_bench.search.hidden import exact_model
from scipy.linalg import block_diag
from sharing import shared

from ibrid.errors import IbridError, OperatingPointError
from ibrid.evaluation.evaluate import record_at
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants import PLANTS, frequency_grid, state_space
from ibrid.plants.gfl import GFLParameters
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.compiling.check import violations
from ibrid.structure.diagrams.library import textbook, textbook_names
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

PACKAGE = Path(__file__).resolve().parents[2] / "ibrid"
FREQUENCY = frequency_grid("5:5000:16")
OP = OperatingPoint("p=1,q=0.3", 1.0, 0.3)
J = np.array([[0.0, -1.0], [1.0, 0.0]])
LCL = Device(
    L_F=0.12,
    R_F=0.006,
    C_F=0.05,
    L_g=0.1,
    R_g=0.008,
    kP_pll=90.0,
    kI_pll=3000.0,
    kP_p=0.02,
    kI_p=20.0,
    kP_q=0.02,
    kI_q=20.0,
    kP_current=0.4,
    kI_current=20.0,
    k_ff=1.0,
    decoupling="pll",
    L_decoupling=0.12,
)
L = replace(LCL, filter="L", C_F=None, L_g=0.0, R_g=0.0)
#: The table of effects in the design.
IDS = {
    *(
        "control_delay",
        "pll_missing",
        "power_loop_missing",
        "reactive_loop_missing",
        "pll_prefilter",
        "power_filter",
    ),
    *(
        "current_filter",
        "voltage_feedforward",
        "voltage_feedforward_filter",
        "decoupling",
        "active_damping",
    ),
    *(
        "ac_voltage_loop",
        "dc_link",
        "frequency_droop",
        "virtual_impedance",
        "series_impedance",
        "shunt_capacitance",
    ),
    *("capacitor_damping", "filter_capacitor", "frame_misalignment"),
}


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def from_diagram(
    text: str, values: dict[str, float], op: OperatingPoint, node: PowerNode
) -> np.ndarray:
    """The response of a program assembled from modules, at given values."""
    return exact_model(text, values, [op], 60.0, node).response(op.name, FREQUENCY)


def kind_of(effect: HiddenEffect) -> Kind:
    return "effect" if effect in HIDDEN else "foreign" if effect in FOREIGN else "convention"


@shared
def case_of(effect: HiddenEffect) -> Case:
    return draw_case(kind_of(effect), 3, effects=[effect.key])


# the device


def _same_as(m: GFLParameters) -> Device:
    names = (
        "filter",
        "L_F",
        "R_F",
        "L_g",
        "R_g",
        "kP_pll",
        "kI_pll",
        "omega_c_pll",
        "omega_c_power",
    )
    return Device(
        **{name: getattr(m, name) for name in (*names, "kP_current", "kI_current", "decoupling")},
        C_F=m.C_F if m.filter == "LCL" else None,
        p_loop=m.p_loop,
        q_loop=m.q_loop,
        kP_p=m.kP_power if m.p_loop == "power" else m.kP_dc,
        kI_p=m.kI_power if m.p_loop == "power" else m.kI_dc,
        kP_q=m.kP_power if m.q_loop == "power" else m.kP_ac,
        kI_q=m.kI_power if m.q_loop == "power" else m.kI_ac,
        C_dc=m.C_dc,
        k_damping=m.k_damping or None,
        k_ff=m.feedforward,
        L_decoupling=m.assumed_inductance or None,
    )


_OPTIONS = [
    {},
    {"omega_c_pll": None},
    {"omega_c_power": 200.0},
    {"decoupling": "nominal"},
    {"decoupling": "none"},
    {"feedforward": 0.0},
    {"feedforward": 0.7, "L_decoupling": 0.1},
    {"filter": "L", "C_F": 0.0, "L_g": 0.0, "R_g": 0.0},
]


@each_of("options", _OPTIONS, ids=str)
@each_of(("p", "q", "v"), [(1.0, 0.3, 1.0), (-0.6, -0.2, 1.03)])
def test_without_hidden_effects_a_device_is_the_reference_inverter(options, p, q, v):
    plant, op = PLANTS["paper_like"], OperatingPoint("one", p, q, v)
    plant = replace(plant, parameters=replace(plant.parameters, **options))
    found = admittance(_same_as(plant.parameters), op, FREQUENCY, plant.omega_0)
    assert relative(found, state_space(plant, op).admittance(FREQUENCY)) < 1e-10


@each_of(
    "name", [name for name, plant in PLANTS.items() if isinstance(plant.parameters, GFLParameters)]
)
def test_published_inverters_are_the_same_in_both_models(name):
    plant = PLANTS[name]
    found = admittance(_same_as(plant.parameters), OP, FREQUENCY, plant.omega_0)
    assert relative(found, state_space(plant, OP).admittance(FREQUENCY)) < 1e-10


@each_of("effect", HIDDEN, ids=lambda effect: effect.key)
def test_device_and_model_of_every_effect_are_what_modules_assemble_to(effect):
    case = case_of(effect)
    node, op = case.sweep.power_node, case.sweep.points[1].op
    for device in (case.device, case.model):
        diagram = block_diagram(device, OMEGA_60)
        expected = from_diagram(diagram.text, dict(diagram.values), op, node)
        assert relative(admittance(device, op, FREQUENCY, power_node=node), expected) < 1e-9


def _on_the_error(diagram: str, modules: list[str], wires: list[tuple[str, str]]) -> str:
    """A program with further modules, the control error available at `error.out`."""
    rest = diagram.replace(
        'g.connect("i_ref.out", "current.in_")', 'g.connect("i_ref.out", "error.in_")'
    )
    rest = rest.replace(
        'g.connect("minus_i.out", "current.in_")', 'g.connect("minus_i.out", "error.in_")'
    )
    extra = [
        'g.add("Gain_dq", "error", k=1.0)',
        *modules,
        *(f'g.connect("{a}", "{b}")' for a, b in wires),
    ]
    return rest + "".join(f"    {line}\n" for line in extra)


_LEAD_LAG = (
    [
        'g.add("Gain_dq", "lead", k=2.5)',
        'g.add("Gain_dq", "lag", k=-1.5)',
        'g.add("LPF1_dq", "slow", omega_c=2000.0)',
    ],
    [
        *(("error.out", "lead.in_"), ("lead.out", "current.in_")),
        *(("error.out", "slow.in_"), ("slow.out", "lag.in_"), ("lag.out", "current.in_")),
    ],
)
_COMB = (
    ['g.add("Gain_dq", "again", k=0.4)', 'g.add("Delay", "comb", T_d=0.0004)'],
    [
        ("again.out", "error.in_"),
        ("error.out", "current.in_"),
        ("error.out", "comb.in_"),
        ("comb.out", "again.in_"),
    ],
)
_NOTCHES = [
    f'g.add("{kind}", "{name}")'
    for kind, name in (("SliceD", "d"), ("SliceQ", "q"), ("PackDQ", "both"))
]
_NOTCHES += [f'g.add("Notch", "notch_{axis}", omega_n=2000.0, Q=2.0)' for axis in "dq"]
_THROUGH_NOTCHES = [(f"{axis}.out", f"notch_{axis}.in_") for axis in "dq"]
_THROUGH_NOTCHES += [(f"notch_{axis}.out", f"both.in_{axis}") for axis in "dq"]
# k (1 - notch) is the resonant path
_RESONANT = (
    [*_NOTCHES, 'g.add("Gain_dq", "minus_notch", k=-0.5)', 'g.add("Gain_dq", "plain", k=0.5)'],
    [
        *(
            ("error.out", "current.in_"),
            ("error.out", "d.in_"),
            ("error.out", "q.in_"),
            *_THROUGH_NOTCHES,
        ),
        *(("both.out", "minus_notch.in_"), ("minus_notch.out", "plant.u_r")),
        *(("error.out", "plain.in_"), ("plain.out", "plant.u_r")),
    ],
)


@pytest.mark.parametrize(
    ("changes", "extra"),
    [
        ({"omega_zero": 800.0, "omega_pole": 2000.0}, _LEAD_LAG),
        ({"comb_gain": 0.4, "comb_delay": 4e-4}, _COMB),
        ({"k_resonant": 0.5, "omega_resonant": 2000.0, "width_resonant": 500.0}, _RESONANT),
    ],
    ids=["lead_lag", "comb", "resonant"],
)
def test_a_foreign_block_in_the_current_loop_is_the_same_drawn_with_modules(changes, extra):
    diagram = block_diagram(LCL, OMEGA_60)
    expected = from_diagram(
        _on_the_error(diagram.text, *extra), dict(diagram.values), OP, "capacitor"
    )
    found = admittance(replace(LCL, **changes), OP, FREQUENCY)
    assert relative(found, expected) < 1e-9
    assert relative(admittance(LCL, OP, FREQUENCY), expected) > 1e-3


def test_a_notch_in_the_feedforward_is_the_same_drawn_with_modules():
    diagram = block_diagram(LCL, OMEGA_60)
    wires = [
        ("plant.e", "d.in_"),
        ("plant.e", "q.in_"),
        *_THROUGH_NOTCHES,
        ("both.out", "plant.u_r"),
    ]
    text = diagram.text.replace('    g.connect("plant.e", "plant.u_r")\n', "")
    text += "".join(
        f"    {line}\n" for line in [*_NOTCHES, *(f'g.connect("{a}", "{b}")' for a, b in wires)]
    )
    found = admittance(replace(LCL, omega_n_ff=2000.0, Q_ff=2.0), OP, FREQUENCY)
    assert relative(found, from_diagram(text, dict(diagram.values), OP, "capacitor")) < 1e-9


# closed forms at the terminals


def _impedance(R: float, X: float, C: float | None = None) -> np.ndarray:
    """(K, 2, 2) of a series R-L-C in the frame that turns at omega_0."""
    s = 2j * pi * FREQUENCY[:, None, None] / OMEGA_60 * np.eye(2) + J
    return R * np.eye(2) + X * s + (0.0 if C is None else np.linalg.inv(s) / C)


@pytest.mark.parametrize(("device", "inner"), [(LCL, "capacitor"), (L, "pcc")], ids=["lcl", "l"])
def test_a_series_impedance_is_a_two_port_before_the_terminals(device, inner):
    """With v_inner = v + Z i: Y = (I - Y_inner Z)^-1 Y_inner, Y_inner at the inner voltage and
    turned into its frame.
    """
    R, X, i = 0.02, 0.15, complex(0.9, -0.2)
    v_inner = 1.0 + complex(R, X) * i
    asked = v_inner * i.conjugate()  # delivered before the impedance
    at_inner = OperatingPoint("inner", asked.real, asked.imag, abs(v_inner))
    Y_inner = admittance(device, at_inner, FREQUENCY, power_node="pcc")
    c, s = v_inner.real / abs(v_inner), v_inner.imag / abs(v_inner)
    turn = np.array([[c, -s], [s, c]])  # the inner voltage leads the frame of the PCC
    Y_inner = turn @ Y_inner @ turn.T
    expected = np.linalg.solve(np.eye(2) - Y_inner @ _impedance(R, X), Y_inner)
    at_pcc = OperatingPoint("pcc", i.real, -i.imag)
    found = admittance(replace(device, L_series=X, R_series=R), at_pcc, FREQUENCY, power_node="pcc")
    assert relative(found, expected) < 1e-9


@pytest.mark.parametrize("base", [LCL, L], ids=["lcl", "l"])
def test_a_branch_at_the_pcc_adds_its_admittance_and_leaves_the_operating_point(base):
    shunt = replace(base, R_shunt=0.05, C_shunt=0.03)
    load = replace(base, load_R=0.2, load_L=0.4, load_C=0.08)
    alone = admittance(base, OP, FREQUENCY)
    for device, branch in (
        (shunt, _impedance(0.05, 0.0, 0.03)),
        (load, _impedance(0.2, 0.4, 0.08)),
    ):
        assert relative(admittance(device, OP, FREQUENCY), alone - np.linalg.inv(branch)) < 1e-10


def test_a_delayed_command_closes_the_loop_with_the_exact_exponential():
    """At a frequency at which omega T is a whole turn the delay is not seen at all."""
    T_d = 3e-4
    hz = np.array([1.0, 2.0, 3.0]) / T_d
    whole = admittance(replace(LCL, T_d=T_d), OP, hz)
    assert relative(whole, admittance(LCL, OP, hz)) < 1e-9
    half = admittance(replace(LCL, T_d=T_d), OP, hz / 2)
    assert relative(half, admittance(LCL, OP, hz / 2)) > 1e-3


@pytest.mark.parametrize(
    "base", [LCL, replace(LCL, comb_gain=0.3, comb_delay=2e-4)], ids=["plain", "comb"]
)
def test_a_current_that_is_measured_late_closes_its_loop_with_the_exact_exponential(base):
    late, hz = replace(base, T_current=3e-4), np.array([1.0, 2.0, 3.0]) / 3e-4
    assert relative(admittance(late, OP, hz), admittance(base, OP, hz)) < 1e-9
    assert relative(admittance(late, OP, hz / 2), admittance(base, OP, hz / 2)) > 1e-4


def test_a_command_that_is_held_is_not_heard_at_multiples_of_the_sampling_frequency():
    """The mean over whole periods of a sine is zero, whatever the controller does; far below, a
    hold is half a period late.
    """
    held, hz = replace(LCL, T_hold=3e-4), np.array([1.0, 2.0, 3.0]) / 3e-4
    other = replace(held, kP_current=2 * LCL.kP_current, k_ff=0.3)
    assert relative(admittance(held, OP, hz), admittance(other, OP, hz)) < 1e-9
    assert relative(admittance(held, OP, hz / 2), admittance(other, OP, hz / 2)) > 1e-3
    slow = frequency_grid("5:50:5")
    assert (
        relative(admittance(held, OP, slow), admittance(replace(LCL, T_d=1.5e-4), OP, slow)) < 1e-3
    )


def test_a_measuring_frame_that_leads_turns_voltage_and_current_alike():
    Y, a = admittance(LCL, OP, FREQUENCY), 0.1
    written = Measurement(frame_angle=a).of(case_sweep(Y)).points[0].admittance
    R = np.cos(a) * np.eye(2) - np.sin(a) * J
    v = np.array([0.3, -0.7])
    assert relative(written @ (R @ v), (Y @ v) @ R.T) < 1e-12


def case_sweep(Y: np.ndarray) -> Sweep:
    point = case_of(HIDDEN[0]).sweep.points[0]
    return Sweep((replace(point, admittance=Y),))


# the steady state


@each_of("node", ["capacitor", "pcc"])
@each_of(
    "changes",
    [
        {},
        {"p_loop": "dc_link", "C_dc": 0.03, "q_loop": "voltage"},
        {"p_loop": "none", "kP_p": None, "kI_p": None, "T_d": 1e-4},
        {
            "kP_pll": None,
            "kI_pll": None,
            "decoupling": "nominal",
            "R_virtual": 0.05,
            "X_virtual": 0.1,
        },
        {
            "R_C": 0.2,
            "R_branch": 0.5,
            "C_branch": 0.03,
            "R_shunt": 0.05,
            "C_shunt": 0.03,
            "comb_gain": 0.3,
            "comb_delay": 3e-3,
        },
    ],
    ids=["plain", "dc_link", "fixed", "unlocked", "branches"],
)
def test_nothing_moves_at_rest_and_the_power_is_as_asked(changes, node):
    device, op = replace(LCL, **changes), OperatingPoint("one", 0.7, -0.4, 0.98)
    eq, rest = equations(device.structure), at_rest(device, op, node, OMEGA_60)
    found = eq.at_rest(rest.x, rest.s, [op.v, 0.0], rest.r, values_of(device, OMEGA_60))
    # rounding of rates as large as omega_0 / L_F, a few thousand per second
    assert np.abs(found[0].full()).max() < 1e-9
    np.testing.assert_allclose(
        found[1 if node == "capacitor" else 2].full().ravel(), [op.p, op.q], atol=1e-10
    )


def test_an_operating_point_that_does_not_exist_is_an_error_and_not_stable():
    weak, op = replace(LCL, L_g=0.9), OperatingPoint("p=1.2,q=0", 1.2, 0.0)
    with pytest.raises(OperatingPointError, match=r"p=1\.2,q=0.*less power"):
        admittance(weak, op, FREQUENCY)
    assert not stable(weak, op)


# stability


def _poles_with_all_pass_chains(linear: Linearised, count: int) -> np.ndarray:
    """Poles with each delay as `count` first-order all-passes: right up to omega T of about
    `count`.
    """
    A, B, _, C, D, *_ = linear.matrices
    parts = []
    for T in linear.delays:
        rate = 2 * count / T  # (1 - s/rate)/(1 + s/rate) = -1 + 2 rate/(s + rate)
        n = np.arange(count)
        sign = np.where((n[:, None] - n) % 2, 1.0, -1.0)
        chain = np.where(n[:, None] == n, -rate, np.where(n[:, None] > n, 2.0 * rate * sign, 0.0))
        parts.append(
            (
                chain,
                rate * (-1.0) ** n[:, None],
                2.0 * (-1.0) ** (count - 1 - n)[None],
                (-1.0) ** count,
            )
        )
    a, b, c = (np.asarray(block_diag(*[part[k] for part in parts])) for k in range(3))
    d = np.diag([part[3] for part in parts])
    loop = np.linalg.inv(np.eye(len(D)) - d @ D)
    heard_x, heard_z = loop @ d @ C, loop @ c
    top, bottom = [A + B @ heard_x, B @ heard_z], [b @ (C + D @ heard_x), a + b @ D @ heard_z]
    return np.linalg.eigvals(np.block([top, bottom]))


def test_unstable_poles_are_counted_as_eigenvalues_with_a_long_all_pass_chain_say():
    rng, found = np.random.default_rng(1), []
    for k in range(24):
        base = draw_base("gfl_exact", rng)
        changes = {
            "T_d": 1e-4 * (1 + k % 3),
            "k_ff": (0.0, 0.6, 1.0)[k // 3 % 3],
            "kP_current": base.kP_current * (k % 4),
        }
        device = replace(base, **changes)
        poles = _poles_with_all_pass_chains(linearise(device, OP), 40)
        known = np.abs(np.imag(poles)) < 2 * pi * 30e3
        found.append(stable(device, OP))
        assert found[-1] == bool((np.real(poles[known]) < -1).all())
    assert {True, False} == set(found)


def test_without_delay_the_turns_around_zero_count_the_eigenvalues():
    rng = np.random.default_rng(2)
    counts = set()
    for _ in range(30):
        base = draw_base("gfl", rng)
        linear = linearise(replace(base, R_g=base.R_g / 5, kP_p=(base.kP_p or 0.0) * 5), OP)
        right = int((np.real(linear.poles) > -1).sum())
        assert unstable_zeros(linear.difference, linear.open_poles, -1.0, 0.0) == right
        counts.add(right)
    assert len(counts) > 1


# declarations


def test_every_effect_of_the_table_is_hidden_somewhere():
    assert {effect.id for effect in HIDDEN} == IDS


def test_keys_name_one_declaration_each():
    keys = [effect.key for effect in (*HIDDEN, *FOREIGN, *CONVENTIONS[:-1])]
    assert len(set(keys)) == len(keys)


def test_foreign_effects_and_wrong_conventions_are_in_no_catalogue():
    assert not {effect.id for effect in (*FOREIGN, *CONVENTIONS)} & (IDS - {"frame_misalignment"})


@each_of("effect", [*HIDDEN, *FOREIGN], ids=lambda effect: effect.key)
def test_severities_do_not_overlap_and_end_where_a_device_can_be_built(effect):
    for settings in (effect.device, effect.model, effect.both, effect.measurement):
        for name, strength in settings.items():
            assert name in {one.name for one in (*fields(Device), *fields(Measurement))}
            ranges = [
                getattr(strength, severity)
                for severity in SEVERITIES
                if hasattr(strength, severity)
            ]
            assert all(low <= high for low, high in ranges)
            if len(set(ranges)) > 1:
                ordered = sorted(ranges)
                assert all(one[1] <= other[0] for one, other in pairwise(ordered))
                assert ordered in (ranges, ranges[::-1])


@each_of("effect", [*HIDDEN, *FOREIGN, *CONVENTIONS[:-1]], ids=lambda effect: effect.key)
def test_every_effect_changes_what_is_measured_at_every_severity(effect):
    for severity in SEVERITIES:
        case = draw_case(kind_of(effect), 1, effects=[effect.key], severity=severity)
        for point in case.sweep.points:
            believed = admittance(
                case.model, point.op, point.frequency, power_node=case.sweep.power_node
            )
            assert np.linalg.norm(believed - point.admittance) > 1e-5 * np.linalg.norm(
                point.admittance
            )


@each_of("name", BASES)
def test_a_base_is_the_textbook_structure_of_its_name(name):
    drawn = parse_program(block_diagram(draw_base(name, np.random.default_rng(0)), OMEGA_60).text)
    assert structure_hash(drawn) == structure_hash(textbook(name))
    tables = [
        parameter_table(wire(one, VOCABULARY), "exact").names for one in (drawn, textbook(name))
    ]
    assert set(tables[0]) == set(tables[1])


def test_bases_are_all_textbook_grid_following_inverters():
    following = {name for name in textbook_names() if name.startswith("gfl")}
    assert set(BASES) == following - {"gfl_dc_link"}


def test_a_device_says_which_parameters_belong_together():
    with pytest.raises(IbridError, match="kP_pll, kI_pll"):
        replace(LCL, kI_pll=None)
    with pytest.raises(IbridError, match="C_dc"):
        replace(LCL, p_loop="dc_link")
    with pytest.raises(IbridError, match="C_F of a hidden device"):
        replace(LCL, C_F=-0.1)
    with pytest.raises(IbridError, match="no block diagram"):
        block_diagram(replace(LCL, omega_n_ff=300.0, Q_ff=1.0), OMEGA_60)


def test_where_power_is_measured_follows_from_the_filter():
    assert (power_node_of(LCL), power_node_of(L)) == ("capacitor", "pcc")


# cases


@pytest.mark.parametrize("kind", KINDS)
def test_a_case_is_stable_where_it_is_swept_and_its_model_has_a_nominal_value_for_every_parameter(
    kind,
):
    for points in (2, 4):
        case = draw_case(kind, 7, points=points)
        node = case.sweep.power_node
        assert all(
            stable(case.device, point.op, power_node=node)
            for point in (*case.sweep.points, *case.held_out.points)
        )
        diagram = parse_program(case.program)
        assert not violations(diagram)
        assert set(parameter_table(wire(diagram, VOCABULARY), "exact").names) == set(case.values)
        assert len(case.sweep.points) == points
        assert case.held_out.names == (HELD_OUT.name,)


def test_the_same_seed_gives_the_same_case_and_another_one_another():
    first, again, other = draw_case("pair", 5), draw_case("pair", 5), draw_case("pair", 6)
    assert first.truth == again.truth
    assert first.values == again.values
    assert np.array_equal(first.sweep.points[0].admittance, again.sweep.points[0].admittance)
    assert other.truth != first.truth


def test_noise_changes_the_sweep_and_not_the_device():
    clean, noisy = draw_case("effect", 5), draw_case("effect", 5, noise_db=40)
    unknown = draw_case("effect", 5, noise_db=40, sigma="none")
    assert clean.device == noisy.device
    assert clean.values == noisy.values
    assert (clean.sweep.points[0].sigma, unknown.sweep.points[0].sigma) == (None, None)
    for point, true in zip(noisy.sweep.points, clean.sweep.points, strict=True):
        assert point.sigma is not None
        away = (point.admittance - true.admittance) / point.sigma
        # 128 normal numbers: their variance is 1 within 0.125, taken four times
        assert np.mean(np.abs(away) ** 2) / 2 == pytest.approx(1.0, abs=0.5)
        assert np.array_equal(point.admittance, unknown.sweep.point(point.op.name).admittance)


def test_wrong_noise_states_a_smaller_sigma_on_the_same_law():
    (point, *_) = draw_case("wrong-noise", 2, noise_db=60).sweep.points
    case = draw_case("wrong-noise", 2)
    clean = admittance(case.device, point.op, point.frequency, power_node=case.sweep.power_node)
    true = np.linalg.norm(clean, axis=(1, 2)) / np.sqrt(8) * 1e-3
    assert point.sigma is not None
    np.testing.assert_allclose(point.sigma[:, 0, 1], UNDERSTATED * true, rtol=1e-12)
    assert case.truth["noise_db"] is not None


def test_with_nothing_hidden_model_and_device_are_one_and_the_nominal_values_are_wrong():
    case = draw_case("nothing", 4)
    assert case.device == case.model
    assert case.truth["effects"] == []
    assert "named" not in case.truth["verdicts"]
    assert all(case.values[name] != value for name, value in case.truth["values"].items())


def test_nominal_errors_are_fifteen_percent_and_for_some_forty():
    values = {f"one_{k}": 2.0 for k in range(20_000)}
    nominal, far = nominal_values(values, np.random.default_rng(0), error=0.15, gross=False)
    shift = np.log(np.array(list(nominal.values())) / 2.0)
    # a mixture: 0.85 of 0.15^2, 0.15 of 0.4^2; the variance of 20 000 of them within 5 percent
    assert np.var(shift) == pytest.approx(0.85 * 0.15**2 + 0.15 * 0.4**2, rel=0.05)
    assert far == []


@pytest.mark.parametrize("kind", ["effect", "pair", "parameters"])
def test_nominal_values_lie_where_modules_can_take_them(kind):
    for seed in range(40):
        case = draw_case(kind, seed, severity=SEVERITIES[seed % 3])
        for one in parameter_table(wire(parse_program(case.program), VOCABULARY), "exact").free:
            assert one.low <= case.values[one.name] <= one.high, one.name


def test_parameters_that_are_far_off_are_named_in_the_truth():
    for seed in range(5):
        case = draw_case("parameters", seed)
        assert 1 <= len(case.truth["far_off"]) <= 2
        for name in case.truth["far_off"]:
            assert (
                np.log(2)
                <= abs(np.log(case.values[name] / case.truth["values"][name]))
                <= np.log(3)
            )


def test_a_pair_hides_two_effects_that_both_change_the_model():
    for seed in range(5):
        case = draw_case("pair", seed)
        first, second = case.truth["effects"]
        assert first["id"] != second["id"]
        assert case.truth["verdicts"] == ["named"]
        assert case.device != case.model


def test_effects_are_asked_for_by_id_change_and_variant():
    for name in ("decoupling", "decoupling:replace", "decoupling:replace:pll"):
        (told,) = draw_case("effect", 1, effects=[name]).truth["effects"]
        assert ":".join((told["id"], told["change"], told["variant"])).startswith(name)
    both = draw_case("pair", 1, effects=["control_delay:add", "pll_prefilter:add"]).truth["effects"]
    assert [told["id"] for told in both] == ["control_delay", "pll_prefilter"]


def test_the_truth_holds_the_strength_of_a_removed_effect_as_the_model_has_it():
    case = draw_case("effect", 1, effects=["control_delay:remove"])
    (told,) = case.truth["effects"]
    assert told["parameters"] == {"T_d": case.model.T_d}
    assert case.device.T_d == 0


@pytest.mark.parametrize(
    ("name", "undo"),
    [
        ("current_sign", lambda Y: -Y),
        ("q_axis", lambda Y: np.diag([1, -1]) @ Y @ np.diag([1, -1])),
    ],
)
def test_a_wrong_convention_is_the_right_sweep_written_otherwise(name, undo):
    case = draw_case("convention", 2, effects=[name])
    for point in (*case.sweep.points, *case.held_out.points):
        true = admittance(case.device, point.op, point.frequency, power_node=case.sweep.power_node)
        assert relative(undo(point.admittance), true) < 1e-12
    assert case.truth["verdicts"] == ["data-convention"]


def test_swapped_labels_leave_each_measurement_at_the_other_power():
    case = draw_case("convention", 2, effects=["operating_point"])
    first, second = case.sweep.points
    for measured, label in ((first, second), (second, first)):
        true = admittance(
            case.device, label.op, measured.frequency, power_node=case.sweep.power_node
        )
        assert relative(measured.admittance, true) < 1e-12
    with pytest.raises(IbridError, match="points=2"):
        draw_case("convention", 2, effects=["operating_point"], points=1)


def test_a_wrong_base_is_one_factor_on_everything():
    case = draw_case("convention", 2, effects=["per_unit_base"])
    (told,) = case.truth["effects"]
    point = case.sweep.points[0]
    true = admittance(case.device, point.op, point.frequency, power_node=case.sweep.power_node)
    np.testing.assert_allclose(point.admittance, told["parameters"]["factor"] * true, rtol=1e-12)


def test_a_foreign_device_has_no_program_and_a_known_one_has(tmp_path):
    foreign, known = draw_case("foreign", 1), draw_case("effect", 1)
    assert foreign.truth["device"] is None
    assert parse_program(known.truth["device"]["program"])
    assert "named" not in foreign.truth["verdicts"]


def test_a_written_case_reads_back_and_tells_nothing_of_the_truth(tmp_path):
    case = draw_case("effect", 9, effects=["control_delay:add"], noise_db=60)
    write_case(case, tmp_path / "case", tmp_path / "truth")
    assert sorted(path.name for path in (tmp_path / "case").iterdir()) == [
        *("holdout.csv", "model.py", "nominal.json", "sweep.csv"),
    ]
    read = read_sweep(tmp_path / "case" / "sweep.csv")
    assert read.power_node == case.sweep.power_node
    assert np.array_equal(read.points[1].admittance, case.sweep.points[1].admittance)
    told = "".join(path.read_text() for path in (tmp_path / "case").iterdir())
    assert "delay" not in told
    assert "hidden" not in told
    assert json.loads((tmp_path / "truth" / "truth.json").read_text()) == case.truth
    with pytest.raises(IbridError, match="folder of its own"):
        write_case(case, tmp_path / "case", tmp_path / "case")


def test_the_command_writes_what_the_function_draws(tmp_path):
    words = ["--seed", "4", "--effect", "pll_prefilter", "--severity", "gross", "--noise-db", "60"]
    assert main([*words, "--out", str(tmp_path / "a"), "--truth", str(tmp_path / "b")]) == 0
    case = draw_case("effect", 4, effects=["pll_prefilter"], severity="gross", noise_db=60)
    assert json.loads((tmp_path / "a" / "nominal.json").read_text()) == case.values
    assert json.loads((tmp_path / "b" / "truth.json").read_text()) == case.truth


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--effect", "control_dely"], "control_delay"),
        (["--effect", "control_delay", "--effect", "dc_link"], "another kind"),
        (["--points", "3"], "1, 2 or 4"),
        (["--kind", "pair", "--effect", "decoupling:add:pll", "--effect", "pll_missing"], "beside"),
    ],
)
def test_words_that_make_no_case_are_one_sentence_and_exit_status_two(
    words, message, tmp_path, capsys
):
    places = ["--out", str(tmp_path / "a"), "--truth", str(tmp_path / "b")]
    assert main(["--seed", "1", *words, *places]) == 2
    assert message in capsys.readouterr().err


# a program of its own


def _imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in found if name.startswith(("ibrid.", "ibrid_bench."))}


def _file(name: str) -> Path | None:
    first, *rest = name.split(".")
    place = (PACKAGE if first == "ibrid" else PACKAGE.parent / "search" / first).joinpath(*rest)
    return next(
        (path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None
    )


def test_the_generator_shares_no_code_with_assembly_fit_modules_and_gap():
    """Followed through everything that it imports, but for the root package, which offers all parts
    to users.
    """
    waiting = sorted((PACKAGE.parent / "search" / "ibrid_bench" / "hidden").glob("*.py"))
    seen = set(waiting)
    for path in waiting:  # grows while it is walked
        for name in sorted(_imports(path)):
            parts = name.split(".")
            folders = [_file(".".join(parts[:k])) for k in range(2, len(parts) + 1)]
            border = (
                "foreign_text",
                "foreign_data",
                "frozen",
                "border",
                "interrupts",
                "own_files",
                "ranges",
            )
            apart = (
                "plants",
                "measurement",
                "errors",
                "writing",
                "showing",
                "hidden",
                "hanging",
                "lazy",
                *border,
            )
            is_compiler = name.startswith("ibrid.fit.just_in_time")  # of numba, no fit
            assert is_compiler or parts[1] in apart, f"{path.name} imports {name}"
            fresh = {one for one in folders if one is not None} - seen
            seen |= fresh
            waiting += sorted(fresh)
    assert len(seen) > 30


def test_hardware_hidden_in_a_device_is_what_its_modules_assemble_to():
    with collecting() as failures:
        for effect in HARDWARE:
            with failures.case(effect.key):
                case = draw_hardware(3, [effect.key], frequencies=8, points=1)
                known = case.truth["device"]
                clean = replace(case.sweep, points=case.held_out.points)
                record = record_at(parse_program(known["program"]), clean, known["values"])
                assert record.nrmse is not None
                assert record.nrmse < 1e-11  # rounding of two ways to one linearisation
