"""From a diagram to its matrices: python-control, CasADi and the plain linear system of the paper
give the same numbers.
"""

import re

import casadi as ca
import numpy as np
import pytest
from collecting import each_of
from random_diagrams import random_legal_diagram

from ibrid.assembly.interconnection import interconnect_rows
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numbers import Scalar
from ibrid.assembly.numeric import closed_loop
from ibrid.assembly.symbolic import symbolic_matrices, symbolic_model
from ibrid.errors import DiagramError, OperatingPointError
from ibrid.fit.kernel import admittance
from ibrid.modules import VOCABULARY
from ibrid.modules.behaviour import Element
from ibrid.modules.delay import pade_order
from ibrid.structure import Diagram, parse_program, textbook, textbook_names, violations, wire
from ibrid.structure.compiling.compiled import compile_diagram
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import Wiring

OMEGA_0 = 2 * np.pi * 60
POINT = (0.7, 0.2, 1.02)
FREQUENCY = np.geomspace(3.0, 5e3, 7)
PADE = 3
RANDOM_DIAGRAMS = 120
RANDOM = [
    random_legal_diagram(np.random.default_rng([7, number])) for number in range(RANDOM_DIAGRAMS)
]


class Case:
    """A diagram at values and an operating point, assembled in every way."""

    def __init__(
        self,
        diagram: Diagram,
        equilibrium: str = "exact",
        values=None,
        point=POINT,
        rng=None,
        orders=None,
    ):
        self.wiring = wire(diagram, VOCABULARY)
        self.table = parameter_table(self.wiring, equilibrium)
        self.point = point
        self.values = {one.name: one.typical for one in self.table.free}
        if rng is not None:
            self.values = {one.name: _near(rng, one) for one in self.table.free}
        self.values |= values or {}
        self.orders = {name: PADE for name, kind in self.wiring.kinds.items() if kind.delay} | (
            orders or {}
        )
        self.settings = {"equilibrium": equilibrium, "power_node": "capacitor", "omega_0": OMEGA_0}

    @property
    def theta(self) -> list[float]:
        return [self.values[name] for name in self.table.names]

    def matrices(self, pade: bool = True):
        orders = self.orders if pade else None
        parameters = parameters_at(self.wiring, self.table, self.values)
        return module_matrices(
            self.wiring, parameters, self.point, pade_orders=orders, **self.settings
        )

    def by_control(self):
        return closed_loop(self.wiring, self.matrices())

    def by_casadi(self) -> list[np.ndarray]:
        function = symbolic_matrices(self.wiring, self.orders, **self.settings)
        return [np.array(part) for part in function(self.theta, list(self.point))]

    def response(self, frequency=FREQUENCY) -> np.ndarray:
        """(K, 2, 2) by the kernel of the fit, delays exact."""
        model = symbolic_model(self.wiring, **self.settings)
        return admittance(model, self.theta, self.point, 2 * np.pi * frequency)

    def delay(self, name: str) -> float:
        bound = self.table.of(name, str(self.wiring.kinds[name].delay))
        return self.values[bound] if isinstance(bound, str) else bound


def _near(rng: np.random.Generator, one) -> float:
    if one.logarithmic:
        return float(np.clip(one.typical * 10 ** rng.uniform(-0.3, 0.3), one.low, one.high))
    return float(
        np.clip(one.typical + 0.02 * (one.high - one.low) * rng.uniform(-1, 1), one.low, one.high)
    )


def linear_system(case: Case, frequency: float) -> np.ndarray:
    """The admittance as the paper evaluates it: y = M(s) u of every module and u = sum of y, solved
    as one system.
    """
    s = 2j * np.pi * frequency
    wiring, matrices = case.wiring, case.matrices(pade=False)
    inputs = _channels(wiring, "inputs")
    outputs = _channels(wiring, "outputs")
    law = np.zeros((len(outputs), len(inputs)), dtype=complex)
    for name, kind in wiring.kinds.items():
        rows = [k for k, (port, _) in enumerate(outputs) if port.rpartition(".")[0] == name]
        columns = [k for k, (port, _) in enumerate(inputs) if port.rpartition(".")[0] == name]
        a, b, c, d = (np.array(part, dtype=float) for part in matrices[name])
        n = len(a)
        b, c, d = (
            b.reshape(n, len(columns)),
            c.reshape(len(rows), n),
            d.reshape(len(rows), len(columns)),
        )
        m = c @ np.linalg.solve(s * np.eye(n) - a.reshape(n, n), b) + d
        law[np.ix_(rows, columns)] = m * (np.exp(-s * case.delay(name)) if kind.delay else 1.0)
    joined, driven = np.zeros((len(inputs), len(outputs))), np.zeros((len(inputs), 2))
    out, through = np.zeros((2, len(outputs))), np.zeros((2, 2))
    for target, sources in wiring.sources.items():
        for source in sources:
            for axis in range(2):
                rows = (
                    [axis]
                    if target == TERMINAL_CURRENT
                    else [k for k, one in enumerate(inputs) if one == (target, axis)]
                )
                if not rows:
                    continue
                if source == TERMINAL_VOLTAGE:
                    (through if target == TERMINAL_CURRENT else driven)[rows[0], axis] += 1.0
                else:
                    (out if target == TERMINAL_CURRENT else joined)[
                        rows[0], outputs.index((source, axis))
                    ] += 1.0
    y = np.linalg.solve(np.eye(len(outputs)) - law @ joined, law @ driven)
    return out @ y + through


def system_or_sentence(case: Case):
    try:
        return case.by_control()
    except DiagramError as error:
        return str(error)


def _channels(wiring: Wiring, side: str) -> list[tuple[str, int]]:
    return [
        (f"{name}.{port}", axis)
        for name, kind in wiring.kinds.items()
        for port, signal in getattr(kind, side).items()
        for axis in range(signal.width)
    ]


def assert_equal_parts(system, matrices, tolerance: float = 1e-12) -> None:
    """A, B, C, D each to a tolerance relative to the largest entry, or of one where direct terms
    cancel.
    """
    for part, wanted in zip("ABCD", matrices, strict=True):
        scale = np.abs(wanted).max(initial=0.0)
        assert (
            np.abs(getattr(system, part) - wanted).max(initial=0.0)
            <= tolerance * scale + 1e-3 * tolerance
        ), part


def program(text: str) -> Diagram:
    return parse_program(
        "def build(g):\n" + "\n".join(f"    {line.strip()}" for line in text.strip().splitlines())
    )


#: An L filter whose converter voltage is what a test adds.
PLANT = """
    g.add("LFilter", "plant")
    g.add("ConstZero", "zero")
    g.connect("zero.out", "plant.delta_omega")
    g.connect("v_DQ", "plant.v_in")
"""


@pytest.mark.slow
@each_of("equilibrium", ["exact", "paper"])
@each_of("name", textbook_names())
def test_python_control_and_casadi_agree_on_a_textbook_diagram(name, equilibrium):
    case = Case(textbook(name), equilibrium)
    assert_equal_parts(case.by_control(), case.by_casadi())


@pytest.mark.slow
@each_of("equilibrium", ["exact", "paper"])
@each_of("name", textbook_names())
def test_the_response_of_a_textbook_diagram_is_that_of_the_papers_linear_system(name, equilibrium):
    case = Case(textbook(name), equilibrium)
    wanted = np.array([linear_system(case, frequency) for frequency in FREQUENCY])
    assert case.response() == pytest.approx(
        wanted, rel=1e-9
    )  # rounding, times the loop gain at 3 Hz


@pytest.mark.slow
def test_the_random_diagrams_have_delays_direct_loops_rotations_and_both_plants():
    wirings = [wire(diagram, VOCABULARY) for diagram in RANDOM]
    assert sum(any(kind.delay for kind in one.kinds.values()) for one in wirings) >= 15
    assert sum(bool(compile_diagram(one).algebraic_loops) for one in RANDOM) >= 15
    assert sum(bool(one.having(Element.ROTATION_IN)) for one in wirings) >= 20
    assert (
        20
        <= sum("LCL" in {kind.name for kind in one.kinds.values()} for one in wirings)
        <= len(RANDOM) - 20
    )
    assert sum(not violations(one, equilibrium="paper") for one in RANDOM) >= 100


@pytest.mark.nightly
@each_of("equilibrium", ["exact", "paper"])
@each_of("number", range(RANDOM_DIAGRAMS))
def test_python_control_and_casadi_agree_on_a_random_diagram(number, equilibrium):
    if violations(RANDOM[number], equilibrium=equilibrium):
        pytest.skip("not legal in this mode")
    case = Case(RANDOM[number], equilibrium, rng=np.random.default_rng(number))
    system = system_or_sentence(case)
    if isinstance(system, str):  # a loop round a delay whose Pade form has the direct term -1
        assert re.search("has a gain of exactly 1 when .* is a Pade form", system)
        return
    assert_equal_parts(system, case.by_casadi())
    assert len(system.state_labels) == system.nstates == len(set(system.state_labels))


@pytest.mark.slow
@each_of("number", range(RANDOM_DIAGRAMS))
def test_the_response_of_a_random_diagram_is_that_of_the_papers_linear_system(number):
    case = Case(RANDOM[number], rng=np.random.default_rng(number))
    wanted = np.array([linear_system(case, frequency) for frequency in FREQUENCY])
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    # a random controller may sit near a resonance or a nearly singular loop: 1e-6 where the system
    # is ill-conditioned
    assert (np.abs(case.response() - wanted) <= 1e-6 * scale + 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gfl_delay", "gfl_l_filter_delay"])
def test_an_exact_delay_is_the_limit_of_its_pade_forms(name):
    low = np.geomspace(1.0, 2e3, 9)
    exact = Case(textbook(name)).response(low)
    scale = np.abs(exact).max(axis=(1, 2), keepdims=True)
    errors = []
    for order in (1, 2, 3, 5, 8):
        delays = {one.name: order for one in textbook(name).instances if one.kind == "Delay"}
        system = Case(textbook(name), orders=delays).by_control()
        assert (
            system.nstates
            == sum(k.order for k in wire(textbook(name), VOCABULARY).kinds.values()) - 2 + 2 * order
        )
        response = np.moveaxis(system(2j * np.pi * low), -1, 0)
        errors.append(float((np.abs(response - exact) / scale).max()))
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 1e-3
    assert errors[-1] < 1e-9  # order 8 at 2 kHz and 150 us: (omega T/4)^17 is below 1e-9


@pytest.mark.parametrize("name", ["gfl_delay", "gfl_l_filter_delay"])
def test_the_chosen_pade_order_keeps_the_response_within_its_degree(name):
    highest, low = 4e3, np.geomspace(1.0, 4e3, 30)
    case = Case(textbook(name))
    case.orders = {one: pade_order(case.delay(one), highest) for one in case.orders}
    system = case.by_control()
    exact = case.response(low)
    response = np.moveaxis(system(2j * np.pi * low), -1, 0)
    scale = np.abs(exact).max(axis=(1, 2), keepdims=True)
    assert (
        np.abs(response - exact) / scale
    ).max() < 0.05  # 1 degree is 1.7 %, at the edge of the loop a little more


def test_a_delay_that_is_fixed_in_the_program_is_exact_too():
    text = (
        PLANT
        + """
        g.add("Gain_dq", "gain", k=0.8)
        g.add("Delay", "delay", T_d=0.0002)
        g.connect("plant.i_g", "gain.in_")
        g.connect("gain.out", "delay.in_")
        g.connect("delay.out", "plant.u_r")
        g.connect("plant.i_g", "i_DQ")
    """
    )
    case = Case(program(text))
    wanted = np.array([linear_system(case, frequency) for frequency in FREQUENCY])
    assert case.response() == pytest.approx(wanted, rel=1e-12)


def test_states_inputs_and_outputs_have_names():
    system = Case(textbook("gfl_delay")).by_control()
    assert system.input_labels == ["v_D", "v_Q"]
    assert system.output_labels == ["i_D", "i_Q"]
    assert system.name == "inverter"
    assert {"pll.angle", "pll.integral", "plant.i_ti_d", "plant.e_q", "p_loop.integral"} <= set(
        system.state_labels
    )
    assert [label for label in system.state_labels if "pade" in label] == [
        f"{delay}.pade{index}_{axis}"
        for delay in Case(textbook("gfl_delay")).orders
        for axis in "dq"
        for index in (1, 2, 3)
    ]


def test_states_come_in_the_order_of_the_modules():
    case = Case(textbook("gfl"))
    model = symbolic_model(case.wiring, **case.settings)
    wanted = [
        f"{name}.{state}" for name, kind in case.wiring.kinds.items() for state in kind.states
    ]
    assert case.by_control().state_labels == wanted == list(model.states)


def test_the_entries_have_the_derivatives_of_finite_differences():
    case = Case(textbook("gfl_delay"))
    model = symbolic_model(case.wiring, **case.settings)
    theta, point = np.array(case.theta), list(case.point)
    values, slopes = (np.array(part).ravel() for part in model.entries(theta, point))
    # two compiled functions of one law: sums of a few products, in whatever order and with whatever
    # fused steps
    assert values == pytest.approx(np.array(model.values_only(theta, point)).ravel(), rel=1e-13)
    dense = np.zeros((len(values), len(theta)))
    dense[model.pattern.derivative_entry, model.pattern.derivative_parameter] = slopes
    for index, value in enumerate(theta):
        step = 1e-6 * value
        up, down = theta.copy(), theta.copy()
        up[index], down[index] = value + step, value - step
        found = (
            np.array(model.values_only(up, point)) - np.array(model.values_only(down, point))
        ).ravel() / (2 * step)
        # 1e-6 relative: truncation and rounding of a central difference
        assert dense[:, index] == pytest.approx(
            found, rel=1e-6, abs=1e-8 * np.abs(values).max() / value
        )


def test_terminal_voltage_may_go_straight_to_the_terminal_current():
    text = PLANT + 'g.connect("v_DQ", "plant.u_r")\ng.connect("plant.i_g", "i_DQ")\n'
    straight = Case(program(text + 'g.connect("v_DQ", "i_DQ")')).by_control()
    assert pytest.approx(np.eye(2) + Case(program(text)).by_control().D) == straight.D
    alone = Case(program(PLANT + 'g.connect("v_DQ", "plant.u_r")\ng.connect("v_DQ", "i_DQ")'))
    assert (alone.by_control()(1j) == np.eye(2)).all()
    assert alone.response() == pytest.approx(np.array([np.eye(2)] * len(FREQUENCY)))


def test_sources_of_the_terminal_current_add_up():
    text = (
        PLANT
        + """
        g.add("Gain_dq", "shunt", k=0.25)
        g.connect("v_DQ", "plant.u_r")
        g.connect("v_DQ", "shunt.in_")
        g.connect("shunt.out", "i_DQ")
        g.connect("plant.i_g", "i_DQ")
        g.connect("plant.e", "i_DQ")
    """
    )
    case = Case(program(text))
    assert_equal_parts(case.by_control(), case.by_casadi())
    assert pytest.approx(1.25 * np.eye(2)) == case.by_control().D


def test_a_module_without_a_path_keeps_its_states_and_changes_nothing():
    text = PLANT + 'g.connect("v_DQ", "plant.u_r")\ng.connect("plant.i_g", "i_DQ")\n'
    idle = Case(
        program(text + 'g.add("PI_dq", "idle")\ng.connect("plant.i_g", "idle.in_")')
    ).by_control()
    assert idle.state_labels == ["plant.i_g_d", "plant.i_g_q", "idle.integral_d", "idle.integral_q"]
    assert idle(10j) == pytest.approx(Case(program(text)).by_control()(10j))


def test_a_diagram_that_the_terminal_voltage_does_not_reach_has_no_admittance():
    text = """
        g.add("LFilter", "plant")
        g.add("ConstZero", "zero")
        g.add("PackDQ", "nothing")
        g.connect("zero.out", "plant.delta_omega")
        g.connect("zero.out", "nothing.in_d")
        g.connect("zero.out", "nothing.in_q")
        g.connect("nothing.out", "plant.v_in")
        g.connect("nothing.out", "plant.u_r")
        g.connect("plant.i_g", "i_DQ")
    """
    case = Case(program(text))
    assert violations(program(text)) == ()
    assert (case.by_control()(10j) == 0).all()
    assert (case.response() == 0).all()


def test_a_signal_may_pass_through_the_same_modules_on_both_axes():
    """Eighteen gains on d, then the same eighteen on q: a long way for what is passed on step by
    step.
    """
    lines = ['g.add("PackDQ", "pair")', 'g.add("SliceQ", "first")', 'g.add("SliceD", "again")']
    lines += ['g.connect("v_DQ", "first.in_")', 'g.connect("first.out", "pair.in_d")']
    ends = ["pair.out", *(f"gain{k}.out" for k in range(18))]
    for k in range(18):
        lines += [f'g.add("Gain_dq", "gain{k}", k=1.1)', f'g.connect("{ends[k]}", "gain{k}.in_")']
    lines += [f'g.connect("{ends[-1]}", "again.in_")', 'g.connect("again.out", "pair.in_q")']
    lines += [f'g.connect("{ends[-1]}", "plant.u_r")', 'g.connect("plant.i_g", "i_DQ")']
    case = Case(program(PLANT + "\n".join(lines)))
    assert violations(program(PLANT + "\n".join(lines))) == ()
    assert_equal_parts(case.by_control(), case.by_casadi())
    assert case.response()[0] == pytest.approx(linear_system(case, FREQUENCY[0]), rel=1e-9)


def test_a_chain_of_the_largest_size_is_assembled():
    lines = ['g.add("Gain_dq", "gain0", k=0.99)', 'g.connect("plant.i_g", "gain0.in_")']
    for k in range(1, 190):
        lines += [
            f'g.add("Gain_dq", "gain{k}", k=0.99)',
            f'g.connect("gain{k - 1}.out", "gain{k}.in_")',
        ]
    lines += ['g.add("JMul_omega", "coupling")', 'g.connect("gain189.out", "coupling.in_")']
    lines += [
        'g.connect("zero.out", "coupling.delta_omega")',
        'g.connect("coupling.out", "plant.u_r")',
    ]
    diagram = program(PLANT + "\n".join(reversed(lines)) + '\ng.connect("plant.i_g", "i_DQ")')
    assert violations(diagram) == ()
    case = Case(diagram)
    model = symbolic_model(case.wiring, **case.settings)
    assert model.pattern.size == 2
    assert np.isfinite(case.response()).all()


def test_modules_may_be_called_like_anything_inside():
    text = (
        PLANT.replace("plant", "loop_1").replace("zero", "in_d")
        + """
        g.add("Gain_dq", "loop_1__e", k=0.5)
        g.add("Gain_dq", "direct_loop_1", k=0.3)
        g.connect("loop_1.e", "loop_1__e.in_")
        g.connect("direct_loop_1.out", "loop_1__e.in_")
        g.connect("loop_1__e.out", "direct_loop_1.in_")
        g.connect("direct_loop_1.out", "loop_1.u_r")
        g.connect("loop_1.i_g", "i_DQ")
    """
    )
    case = Case(program(text))
    assert_equal_parts(case.by_control(), case.by_casadi())


LOOP = (
    PLANT
    + """
    g.add("Gain_dq", "first")
    g.add("Negate_dq", "second")
    g.add("Gain_dq", "third", k=-1)
    g.connect("v_DQ", "first.in_")
    g.connect("third.out", "first.in_")
    g.connect("first.out", "second.in_")
    g.connect("second.out", "third.in_")
    g.connect("third.out", "plant.u_r")
    g.connect("plant.i_g", "i_DQ")
"""
)
ITSELF = (
    PLANT
    + """
    g.add("Gain_dq", "gain")
    g.connect("v_DQ", "gain.in_")
    g.connect("gain.out", "gain.in_")
    g.connect("gain.out", "plant.u_r")
    g.connect("plant.i_g", "i_DQ")
"""
)


@pytest.mark.parametrize(
    ("text", "name", "path"),
    [(LOOP, "first.k", "first -> second -> third -> first"), (ITSELF, "gain.k", "gain -> gain")],
)
def test_a_loop_with_a_gain_of_one_is_named_and_has_no_response(text, name, path):
    diagram = program(text)
    assert violations(diagram) == ()  # legal: singular at one value alone
    case = Case(diagram, values={name: 1.0})
    with pytest.raises(DiagramError, match=f"the loop of direct terms {path} is singular"):
        case.by_control()
    with pytest.raises(DiagramError, match=f"the loop of direct terms {path} is singular"):
        interconnect_rows(case.wiring, case.matrices(), exact_delays=True)
    assert np.isnan(case.response()).all()
    assert not all(np.isfinite(part).all() for part in case.by_casadi())
    nearly = Case(diagram, values={name: 1.0 + 1e-15})
    with pytest.raises(DiagramError, match="is singular"):
        nearly.by_control()


@pytest.mark.slow
@each_of(("text", "name"), [(LOOP, "first.k"), (ITSELF, "gain.k")])
@each_of("value", [-3.0, 0.5, 0.999, 1.001, 100.0])
def test_a_loop_with_another_gain_is_solved(text, name, value):
    case = Case(program(text), values={name: value})
    assert_equal_parts(case.by_control(), case.by_casadi())
    # u_r = k/(1 - k) v, so 1 - k is amplified rounding
    wanted = np.array([linear_system(case, frequency) for frequency in FREQUENCY])
    assert case.response() == pytest.approx(wanted, rel=1e-11)


def test_a_loop_whose_gains_are_of_very_different_size_is_solved():
    text = (
        PLANT
        + """
        g.add("Gain_dq", "large", k=1e5)
        g.add("Gain_dq", "larger", k=1e6)
        g.add("Gain_dq", "small", k=4e-12)
        g.connect("v_DQ", "large.in_")
        g.connect("small.out", "large.in_")
        g.connect("large.out", "larger.in_")
        g.connect("larger.out", "small.in_")
        g.connect("small.out", "plant.u_r")
        g.connect("plant.i_g", "i_DQ")
    """
    )
    case = Case(program(text))  # the loop gain is 0.4: u_r = 0.4/0.6 v
    wanted = np.array([linear_system(case, frequency) for frequency in FREQUENCY])
    assert case.response() == pytest.approx(wanted, rel=1e-12)
    assert_equal_parts(case.by_control(), case.by_casadi())
    rows = interconnect_rows(case.wiring, case.matrices(), exact_delays=True).rows
    assert rows[0][2] == pytest.approx((0.4 / 0.6 - 1) * OMEGA_0 / 0.1, rel=1e-12)


def test_a_delay_whose_pade_form_closes_a_loop_of_gain_one_is_named():
    text = (
        PLANT
        + """
        g.add("Negate_dq", "minus")
        g.add("Delay", "delay")
        g.connect("v_DQ", "minus.in_")
        g.connect("delay.out", "minus.in_")
        g.connect("minus.out", "delay.in_")
        g.connect("delay.out", "plant.u_r")
        g.connect("plant.i_g", "i_DQ")
    """
    )
    diagram = program(text)
    assert violations(diagram) == ()
    sentence = (
        "the loop of direct terms minus -> delay -> minus has a gain of exactly 1 when delay is a "
        "Pade form"
    )
    with pytest.raises(DiagramError, match=sentence):
        Case(diagram, orders={"delay": 3}).by_control()
    with pytest.raises(DiagramError, match=sentence):
        Case(diagram, orders={"delay": 3}).by_casadi()
    even = Case(diagram, orders={"delay": 4})
    assert_equal_parts(even.by_control(), even.by_casadi())
    wanted = np.array([linear_system(even, frequency) for frequency in FREQUENCY])
    assert even.response() == pytest.approx(wanted, rel=1e-11)


WEAK = {"plant.L_g": 0.9, "plant.R_g": 0.01}


def test_without_a_real_operating_point_there_is_one_sentence_and_no_response():
    case = Case(
        textbook("gfl"), values=WEAK, point=(1.0, 0.0, 1.0)
    )  # at most v^2/(2 x) = 0.56 comes through x = 0.9
    with pytest.raises(
        OperatingPointError,
        match=r"the matrices of park_v, plant, .* must be finite; .* no real operating point",
    ):
        case.by_control()
    assert np.isnan(case.response()).all()


def test_without_a_real_operating_point_no_controller_has_a_response():
    text = (
        PLANT.replace("LFilter", "LCL")
        + 'g.connect("v_DQ", "plant.u_r")\ng.connect("plant.i_g", "i_DQ")\n'
    )
    assert np.isnan(Case(program(text), values=WEAK, point=(1.0, 0.0, 1.0)).response()).all()
    paper = Case(
        program(text), "paper", values=WEAK, point=(1.0, 0.0, 1.0)
    )  # where p, q, v are not asked for
    assert np.isfinite(paper.response()).all()
    assert np.isfinite(Case(program(text), values=WEAK, point=(0.3, 0.0, 1.0)).response()).all()


#: A proportional voltage control whose references a linear model has lost, with the power measured
#: at its own command.
REFERENCE_FEEDFORWARD = """
def build_test(g):
    g.add("Rot_v", "park_v")
    g.add("LFilter", "plant", L_F=0.245, R_F=0.0078)
    g.add("Rot_i", "park_i")
    g.add("Integrator", "angle")
    g.add("PQ_calc", "power")
    g.add("Gain", "sync_gain", k=-39.0)
    g.add("Gain_dq", "active_resistance", k=-0.125)
    g.add("SliceQ", "i_q")
    g.add("LPF1", "slow_q", omega_c=31.0)
    g.add("Gain", "feedforward", k=0.125)
    g.add("ConstZero", "no_d")
    g.add("PackDQ", "i_ref")
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("park_i.i_DQ", "i_DQ")
    g.connect("angle.out", "park_v.delta")
    g.connect("angle.out", "park_i.delta")
    g.connect("sync_gain.out", "plant.delta_omega")
    g.connect("sync_gain.out", "angle.in_")
    g.connect("active_resistance.out", "power.e")
    g.connect("i_ref.out", "power.e")
    g.connect("plant.i_g", "power.i")
    g.connect("power.p", "sync_gain.in_")
    g.connect("plant.i_g", "active_resistance.in_")
    g.connect("plant.i_g", "i_q.in_")
    g.connect("i_q.out", "slow_q.in_")
    g.connect("slow_q.out", "feedforward.in_")
    g.connect("no_d.out", "i_ref.in_d")
    g.connect("feedforward.out", "i_ref.in_q")
    g.connect("active_resistance.out", "plant.u_r")
    g.connect("i_ref.out", "plant.u_r")
"""


#: The measured power without what the filter's resistance loses: another signal beside the command.
LOSS = """
    g.add("Gain_dq", "loss", k=-0.0078)
    g.connect("plant.i_g", "loss.in_")
    g.connect("loss.out", "power.e")
"""


@pytest.mark.parametrize(
    "lost", [0.0, 0.0078], ids=["the command", "the command and another signal"]
)
def test_a_command_without_an_integrator_has_the_converters_voltage_where_its_power_is_measured(
    lost: float,
):
    """Beside its nonlinear equations, written down with their references, linearised by central
    differences.
    """
    inductance, resistance, damping, sync, corner = 0.245, 0.0078, 0.125, 39.0, 31.0
    p, q, v = 0.7, -0.1, 1.0
    i_0 = np.array([p, -q])

    def series(speed: float) -> np.ndarray:
        return np.array([[resistance, -speed * inductance], [speed * inductance, resistance]])

    u_0 = np.array([v, 0.0]) + series(1.0) @ i_0
    angle = np.arctan2(u_0[1], u_0[0])  # the command at rest is on d: what the q axis adds is zero
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    at_rest = np.concatenate([turn @ i_0, [angle, (turn @ i_0)[1]]])

    def motion(x: np.ndarray, terminal: np.ndarray) -> np.ndarray:
        i, delta, slow = x[:2], x[2], x[3]
        u = (
            turn @ u_0
            - damping * (i - at_rest[:2])
            + np.array([0.0, damping * (slow - at_rest[3])])
        )
        slip = sync * (u_0 @ i_0 - lost * i_0 @ i_0 - (u - lost * i) @ i)
        seen = (
            np.array([[np.cos(delta), np.sin(delta)], [-np.sin(delta), np.cos(delta)]]) @ terminal
        )
        drop = series(1 + slip / OMEGA_0) @ i
        return np.concatenate(
            [OMEGA_0 / inductance * (u - seen - drop), [slip, corner * (i[1] - slow)]]
        )

    def current(x: np.ndarray) -> np.ndarray:
        return np.array([[np.cos(x[2]), -np.sin(x[2])], [np.sin(x[2]), np.cos(x[2])]]) @ x[:2]

    step, terminal = 1e-5, np.array([v, 0.0])
    assert np.abs(motion(at_rest, terminal)).max() < 1e-12
    a, b, c = (
        np.array(
            [
                (law(start + step * one) - law(start - step * one)) / (2 * step)
                for one in np.eye(len(start))
            ]
        ).T
        for law, start in (
            (lambda x: motion(x, terminal), at_rest),
            (lambda voltage: motion(at_rest, voltage), terminal),
            (current, at_rest),
        )
    )
    frequency = np.array([1.0, 10.0, 60.0, 400.0])
    wanted = [c @ np.linalg.solve(2j * np.pi * hz * np.eye(4) - a, b) for hz in frequency]
    case = Case(parse_program(REFERENCE_FEEDFORWARD + LOSS * (lost > 0)), point=(p, q, v))
    assert case.response(frequency) == pytest.approx(
        np.array(wanted), rel=1e-6, abs=1e-6 * np.abs(wanted).max()
    )


def test_a_symbol_of_a_law_computes_as_numbers_do():
    x, y = Scalar(ca.SX.sym("x")), Scalar(ca.SX.sym("y"))

    def law(one, other):
        several = (
            one + other,
            one - other,
            one * other,
            one / other,
            2.0 + one,
            2 - one,
            3 * one,
            1 / one,
            one - 2,
            one / 4,
        )
        return [
            *several,
            -one,
            one**2,
            np.float64(3.0) * one,
            (one + 1.0) * other - one / (2.0 * other),
        ]

    found = ca.Function("law", [x, y], [ca.vertcat(*law(x, y))])(1.3, -0.7)
    # at most five operations, each rounded by 1.1e-16
    np.testing.assert_allclose(np.array(found).ravel(), law(1.3, -0.7), rtol=1e-14)
    assert isinstance((2.0 * x + y) / 3, Scalar)  # on through a law
    assert (ca.SX.eye(2) * x).shape == (x * ca.SX.eye(2)).shape == (2, 2)
