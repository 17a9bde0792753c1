"""Each kind's law in absolute quantities linearises to its state space; whole records become
nonlinear models at rest.
"""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from collecting import each_of
from extended_inverters import VALUES, Inverter, program
from fitted import benchmark, evaluated
from modelica_readers import without_connectors
from random_diagrams import random_legal_diagram
from scipy.linalg import expm
from sharing import shared

import ibrid
from ibrid.analysis.models.linear_model import linear_model
from ibrid.assembly.averaged import assembled
from ibrid.assembly.rest import rest
from ibrid.assembly.symbolic import symbolic_matrices
from ibrid.errors import DiagramError, IbridError, ModuleError
from ibrid.evaluation.evaluate import record_at
from ibrid.export import NonlinearModel, export, nonlinear_model
from ibrid.export.formula import Formula, formula
from ibrid.modules.kind import ModuleKind
from ibrid.modules.large_signal import LargeSignal, is_linear
from ibrid.modules.vocabulary import VOCABULARY, find_kind
from ibrid.plants.published import PLANTS
from ibrid.plants.sweeping import operating_point
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.testing import check_kind

OP, ELSEWHERE = "p=1,q=0.3", "p=-0.4,q=0.2,v=1.03"
DEVICE = PLANTS["paper_like"]


@shared
def true_record() -> ibrid.Record:
    """The benchmark's inverter at its true parameters."""
    return record_at(ibrid.parse_program(DEVICE.program), benchmark(), DEVICE.diagram_values)


@shared
def extended_record(plant: str, outer: str, shunt: bool) -> ibrid.Record:
    """An inverter of extended kinds at given values."""
    text = program(Inverter(plant, outer, shunt=shunt))
    return record_at(ibrid.parse_program(text), benchmark(), VALUES)


RECORDS = {
    "gfl_pll_filter_exact": lambda: evaluated("gfl_pll_filter_exact", restarts=0),
    "gfl_delay": lambda: evaluated("gfl_delay", restarts=0),
    "gfl_l_filter_delay": lambda: evaluated("gfl_l_filter_delay", restarts=0),
    "dc_link": lambda: extended_record("LCL_R", "voltage", True),
    "direct_loop": lambda: extended_record("LLFilter", "power", False),
    "damped": lambda: extended_record("LCL_RC", "voltage", False),
    "saturated": lambda: extended_record("LCL_saturated", "power", False),
}


def relative_difference(found, expected) -> float:
    """Of matrices, the largest entry of each as the scale."""
    pairs = [
        (np.asarray(one), np.asarray(other)) for one, other in zip(found, expected, strict=True)
    ]
    return max(
        float(np.abs(one - other).max() / max(np.abs(other).max(), 1e-6))
        for one, other in pairs
        if other.size
    )


# --- one kind


@pytest.mark.slow
@each_of(
    "kind", [one for one in VOCABULARY if one.large_signal is not None], ids=lambda one: one.name
)
def test_a_large_signal_law_linearises_to_the_state_space(kind: ModuleKind):
    check_kind(kind)


def test_a_law_that_contradicts_its_state_space_is_refused():
    kind = find_kind("PQ_calc", VOCABULARY)

    def other_sign(x, e, i):
        return (), (e[0] * i[0] + e[1] * i[1], e[0] * i[1] - e[1] * i[0])

    with pytest.raises(
        AssertionError, match=r"PQ_calc: the large-signal law must linearise .* D\[1, "
    ):
        check_kind(replace(kind, large_signal=LargeSignal(other_sign)))

    def asks_too_much(x, e, i, k):
        return (), (k, k)

    with pytest.raises((ModuleError, AssertionError), match="asks for k"):
        check_kind(replace(kind, large_signal=LargeSignal(asks_too_much)))


def test_every_kind_has_a_law_of_any_size():
    assert all(is_linear(kind) or kind.large_signal is not None for kind in VOCABULARY)


def test_the_dc_link_keeps_its_energy_balance():
    kind = find_kind("DC_link", VOCABULARY)
    # C/2 (v_dc^2 - 1) is what came in less what went out, at any depth of the sag
    (rate,), _ = kind.large_signal.law(
        (0.7,), (1.0, 0.1), (0.9, -0.2), C_dc=0.02, u_eq=(1.0, 0.2), i_eq=(0.8, 0.1)
    )
    assert rate * 0.02 * 0.7 == pytest.approx((0.8 + 0.02) - (0.9 - 0.02), rel=1e-12)


# --- whole diagrams


@pytest.mark.slow
def test_random_diagrams_of_all_kinds_are_at_rest_and_linearise_exactly():
    rng, seen, with_loops = np.random.default_rng(11), set[str](), 0
    for number in range(120):
        diagram = random_legal_diagram(rng, VOCABULARY)
        wiring = wire(diagram, VOCABULARY)
        table = parameter_table(wiring, "exact")
        # off the typical values, where gains of one and turns by no angle make some loops of direct
        # terms singular
        values = {
            one.name: float(one.typical * rng.uniform(0.6, 0.9)) or one.high / 2
            for one in table.free
        }
        orders = {name: 2 for name, kind in wiring.kinds.items() if kind.delay is not None}
        point, physics = (
            (0.6, -0.2, 1.03),
            {"power_node": ("capacitor", "pcc")[number % 2], "omega_0": 377.0},
        )
        try:
            matrices = symbolic_matrices(wiring, orders, equilibrium="exact", **physics)
        except DiagramError:  # a Pade form in a loop of gain one
            continue
        expected = [np.array(one) for one in matrices(list(values.values()), point)]
        if not all(
            np.isfinite(one).all() for one in expected
        ):  # a turn by no angle in a loop of its own
            continue
        try:
            resting = rest(wiring, table, values, point, pade_orders=orders, **physics)
        except IbridError:
            if not {"dVOC", "PLL_frequency", "Ref_pq"} & {one.kind for one in diagram.instances}:
                raise
            continue  # their law divides by the size of a vector, which a draw may leave at zero
        model = assembled(wiring, resting)
        assert relative_difference(model.linearised(), expected) < 1e-8
        at = (model.x0, model.z0, model.v0, model.r0)
        size = max(1.0, np.abs(expected[0]).max())
        assert np.abs(np.array(model.f(*at))).max() < 1e-12 * size
        assert np.abs(np.array(model.g(*at))).max(initial=0) < 1e-10
        seen |= {one.kind for one in diagram.instances}
        with_loops += bool(model.algebraic)
    assert seen == {kind.name for kind in VOCABULARY if not kind.shares}
    assert with_loops > 10


@pytest.mark.nightly
@each_of("name", RECORDS)
@each_of("op", [OP, ELSEWHERE])
def test_the_linearisation_is_the_record(name: str, op: str):
    record = RECORDS[name]()
    model, linear = nonlinear_model(record, op), linear_model(record, op)
    assert relative_difference(model.linearised(), (linear.A, linear.B, linear.C, linear.D)) < 1e-8
    assert model.states == linear.states
    np.testing.assert_array_equal(model.v0, [linear.v, 0.0])
    rates = np.array(model.f(model.x0, model.z0, model.v0, model.r0)).ravel()
    rounding = (
        np.finfo(float).eps * np.abs(linear.A) @ np.abs(model.x0)
    )  # of what cancels: 2e7 in a delay
    assert np.all(np.abs(rates) < 1e-10 + rounding)
    assert len({*model.algebraic}) == len(model.algebraic)
    assert bool(model.algebraic) == (name == "direct_loop")


def test_the_terminal_power_at_rest_is_that_of_the_operating_point():
    model, m = nonlinear_model(true_record(), OP), DEVICE.parameters
    i_g = np.abs(model.i0[0] + 1j * model.i0[1])
    # p = 1 at the capacitor, less what R_g takes, leaves at the terminals
    assert model.v0 @ model.i0 == pytest.approx(1.0 - m.R_g * i_g**2, rel=1e-12)


def test_references_are_the_setpoints():
    model = nonlinear_model(true_record(), OP)
    held = dict(zip(model.references, model.r0, strict=True))
    assert held["p_loop.in_"] == pytest.approx(1.0)
    assert held["q_loop.in_"] == pytest.approx(-0.3)


# --- in time


def currents(
    model: NonlinearModel, v: np.ndarray, grid: np.ndarray, r: np.ndarray | None = None
) -> np.ndarray:
    """i (2, K) after the voltage jumps to v at time zero."""
    r = model.r0 if r is None else r
    options = {"abstol": 1e-12, "reltol": 1e-10}
    move = ca.integrator("move", "cvodes", model.dae(ca.SX(v), r=ca.SX(r)), 0.0, grid, options)
    x = move(x0=model.x0)["xf"]
    return np.array(model.h(x, ca.DM(0, 1), v, r))


def reference_currents(
    v: np.ndarray, setpoint: tuple[float, float], grid: np.ndarray
) -> np.ndarray:
    """The same of the reference inverter, whose equations were written independently."""
    dynamics, x0 = DEVICE.dynamics, DEVICE.equilibrium(operating_point(OP))
    x = ca.SX.sym("x", len(x0))
    problem = {"x": x, "ode": dynamics.f(x, v, setpoint)}
    move = ca.integrator("other", "cvodes", problem, 0.0, grid, {"abstol": 1e-12, "reltol": 1e-10})
    return np.array(dynamics.g(move(x0=x0)["xf"], v))


@pytest.mark.slow
@pytest.mark.parametrize("jump", [(-0.3, 0.05), (0.05, -0.2)])
def test_a_voltage_jump_moves_it_as_the_reference_inverter(jump: tuple[float, float]):
    model, grid = nonlinear_model(true_record(), OP), np.linspace(0.002, 0.1, 50)
    v = model.v0 + jump
    found = currents(model, v, grid)
    # two integrations at 1e-10
    np.testing.assert_allclose(found, reference_currents(v, (1.0, 0.3), grid), rtol=0, atol=1e-7)
    a, b, c, d = model.linearised()
    settled = model.i0 + (d - c @ np.linalg.solve(a, b)) @ jump
    assert (
        np.abs(found[:, -1] - settled).max() > 1e-2
    )  # the linear model is another one at this size


def test_a_setpoint_jump_moves_it_as_the_reference_inverter():
    model, grid = nonlinear_model(true_record(), OP), np.linspace(0.002, 0.1, 50)
    r = model.r0.copy()
    r[model.references.index("p_loop.in_")] += 0.2 - 1.0
    found = currents(model, model.v0, grid, r)
    np.testing.assert_allclose(
        found, reference_currents(model.v0, (0.2, 0.3), grid), rtol=0, atol=1e-7
    )


@pytest.mark.slow
def test_a_small_jump_of_a_model_with_a_direct_loop_moves_it_as_its_linearisation():
    model, jump, end = nonlinear_model(RECORDS["direct_loop"](), OP), np.array([1e-4, -5e-5]), 0.01
    move = ca.integrator(
        "move",
        "idas",
        model.dae(ca.SX(model.v0 + jump)),
        0.0,
        end,
        {"abstol": 1e-13, "reltol": 1e-10},
    )
    answer = move(x0=model.x0, z0=model.z0)
    found = (
        np.array(model.h(answer["xf"], answer["zf"], model.v0 + jump, model.r0)).ravel() - model.i0
    )
    a, b, c, d = model.linearised()
    n = len(a)
    both = expm(end * np.block([[a, b], [np.zeros((2, n + 2))]]))
    # what is left grows with the square of the jump
    np.testing.assert_allclose(
        found, c @ both[:n, n:] @ jump + d @ jump, atol=1e-3 * np.abs(jump).max()
    )


# --- Modelica


def test_formulas_bracket_as_they_must():
    a, b, c = (Formula(one) for one in "abc")
    assert (a + b * c).text == "a + b*c"
    assert ((a + b) * (b - (c - a))).text == "(a + b)*(b - (c - a))"
    assert (a / (b * c) * 2).text == "a/(b*c)*2"
    assert (-(a + b) * c).text == "(-(a + b))*c"
    assert (a - (-2.5) * b).text == "a - (-2.5)*b"
    assert (0 * a + 1 * b + 0.0).text == "b"
    assert formula(0.1).text == "0.1"


@pytest.mark.nightly
@pytest.mark.parametrize("name", RECORDS)
def test_pymoca_reads_a_nonlinear_model_that_rests_and_linearises_to_the_record(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    api = pytest.importorskip(
        "pymoca.backends.casadi.api", reason="pymoca is not installed (pip install pymoca)"
    )
    from pymoca.backends.casadi import generator

    monkeypatch.setitem(
        generator.OP_MAP, "/", "__truediv__"
    )  # it asks for the division of Python 2
    record = RECORDS[name]()
    export(record, tmp_path / "out.mo", "modelica", ELSEWHERE, nonlinear=True)
    (tmp_path / "out.mo").write_text(without_connectors((tmp_path / "out.mo").read_text()))
    options = {
        "cache": False,
        "replace_parameter_values": True,
        "replace_parameter_expressions": True,
    }
    read = api.transfer_model(str(tmp_path), "NonlinearInverter.Inverter", options)
    model, linear = nonlinear_model(record, ELSEWHERE), linear_model(record, ELSEWHERE)
    assert [one.symbol.name().replace(".x_", ".") for one in read.states] == list(model.states)
    start = np.array([float(one.start) for one in read.states])
    np.testing.assert_array_equal(start, model.x0)

    dx, y, x, v = (
        ca.vertcat(*[ca.vec(one.symbol) for one in some])
        for some in (read.der_states, read.alg_states, read.states, read.inputs)
    )
    equations = ca.vertcat(*[ca.vec(one) for one in read.equations])
    parts = [equations, *(ca.jacobian(equations, one) for one in (dx, y, x, v))]
    numbers = ca.Function("numbers", [dx, y, x, v], [ca.densify(one) for one in parts])
    n = len(start)
    unknown = np.full(n + y.numel(), 0.5)
    for _ in range(20):  # Newton; the equations are in order, so that few steps do
        residual, by_dx, by_y, by_x, by_v = map(
            np.array, numbers(unknown[:n], unknown[n:], start, model.v0)
        )
        unknown = unknown - np.linalg.solve(np.hstack([by_dx, by_y]), residual.ravel())
    assert np.abs(unknown[:n]).max() < 1e-9 + 1e-14 * np.abs(linear.A).max()  # at rest
    answer = -np.linalg.solve(np.hstack([by_dx, by_y]), np.hstack([by_x, by_v]))
    names = [
        f"{one.symbol.name()}[{k}]" for one in read.alg_states for k in range(one.symbol.numel())
    ]
    outputs = [len(start) + names.index(f"{one}[0]") for one in ("i_D", "i_Q")]
    found = (answer[:n, :n], answer[:n, n:], answer[outputs, :n], answer[outputs, n:])
    assert relative_difference(found, (linear.A, linear.B, linear.C, linear.D)) < 1e-8


def test_names_that_modelica_would_confuse_are_kept_apart(tmp_path: Path):
    text = DEVICE.program.replace('"plant"', '"LCL"').replace('"plant.', '"LCL.')
    text = (
        text.replace('"power"', '"model"')
        .replace('"power.e', '"model.e')
        .replace('"power.i"', '"model.i"')
    )
    text = text.replace('"power.p"', '"model.p"').replace('"power.q"', '"model.q"')
    values = {
        name.replace("plant.", "LCL."): value for name, value in DEVICE.diagram_values.items()
    }
    record = record_at(ibrid.parse_program(text), benchmark(), values)
    export(record, tmp_path / "n.mo", "modelica", OP, nonlinear=True)
    written = (tmp_path / "n.mo").read_text()
    assert "    LCL LCL_(" in written
    assert "    PQ_calc model_;" in written
    assert "LCL_.v_in[1] = park_v.v_dq[1];" in written


def test_a_kind_whose_words_modelica_cannot_have_is_refused(tmp_path: Path):
    kinds = tuple(
        replace(
            kind,
            parameters={"der": kind.parameters["omega_c"]},
            state_space=lambda der: ([[-der]], [[der]], [[1]], [[0]]),
        )
        if kind.name == "LPF1"
        else kind
        for kind in VOCABULARY
    )
    text = DEVICE.program
    values = {
        name.replace("omega_c", "der"): value for name, value in DEVICE.diagram_values.items()
    }
    record = record_at(ibrid.parse_program(text), benchmark(), values, vocabulary=kinds)
    with pytest.raises(IbridError, match="LPF1 cannot be written in Modelica: der"):
        export(record, tmp_path / "n.mo", "modelica", OP, nonlinear=True)
    assert list(tmp_path.iterdir()) == []


# --- what cannot be


def test_a_kind_without_a_law_is_named():
    bare = tuple(
        replace(kind, large_signal=None) if kind.name == "PQ_calc" else kind for kind in VOCABULARY
    )
    record = replace(true_record(), vocabulary=bare)
    with pytest.raises(
        ModuleError, match="PQ_calc has matrices that depend on the operating point"
    ):
        nonlinear_model(record, OP)


@pytest.mark.slow
def test_a_record_of_the_papers_equilibrium_is_refused():
    record = evaluated(
        "gfl", restarts=0, parameters="per-op", equilibrium="paper", vocabulary="paper"
    )
    with pytest.raises(IbridError, match="exact equilibrium"):
        nonlinear_model(record, OP)


def test_only_modelica_holds_a_nonlinear_model(tmp_path: Path):
    with pytest.raises(IbridError, match="written as modelica"):
        export(true_record(), tmp_path / "m.mat", "mat", OP, nonlinear=True)
    assert list(tmp_path.iterdir()) == []


def test_an_operating_point_that_does_not_exist_is_refused():
    with pytest.raises(IbridError, match="no real operating point"):
        nonlinear_model(true_record(), "p=9,q=0")
