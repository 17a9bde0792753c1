"""The vocabulary against the formulas of the paper's appendix, written out here a second time, and
the contract of a kind.
"""

import dataclasses
import pickle
from collections.abc import Callable
from dataclasses import replace
from math import cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
from collecting import each_of
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lsim

from ibrid.assembly.modules_at import module_matrices
from ibrid.errors import ModuleError
from ibrid.modules import PAPER_VOCABULARY, VOCABULARY, ModuleKind, Range, find_kind
from ibrid.modules.behaviour import Element
from ibrid.modules.delay import HIGHEST_PADE_ORDER, pade_order, pade_state_space
from ibrid.modules.kind import PAPER_RANGES
from ibrid.modules.large_signal import LargeSignal
from ibrid.signals import Signal
from ibrid.structure import Diagram, wire
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.testing import check_kind

OMEGA_0 = 2 * pi * 60
I2, J, ZERO = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]]), np.zeros((2, 2))
S = 1j * 2 * pi * np.geomspace(0.3, 3e4, 9)
NAMES = [kind.name for kind in VOCABULARY]
#: Values for all parameters; those of the operating point as in the paper, q components zero.
P = {
    "L_F": 0.15,
    "R_F": 0.005,
    "C_F": 0.066,
    "L_g": 0.12,
    "R_g": 0.01,
    "kP": 0.4,
    "kI": 15.0,
    "omega_c": 3000.0,
    "kP_pll": 60.0,
    "kI_pll": 1400.0,
    "k": -1.7,
    "L": 3e-4,
    "T_d": 2e-4,
    "omega_n": 900.0,
    "Q": 3.0,
    "E0d": 1.07,
    "I0d": 0.83,
    "delta_eq": 0.21,
    "R_C": 0.08,
    "R_d": 0.7,
    "C_d": 0.09,
    "R": 0.07,
    "C": 0.11,
    "C_dc": 0.015,
    "eta": 1.7,
    "kappa": 0.9,
    "alpha": 12.0,
    "share_p": 0.4,
    "share_q": 0.7,
    "D": 0.03,
    "a": 0.2,
    "phi": -0.3,
    "T_s": 2e-4,
    "n": 6.0,
    "L_t": 0.004,
    "C_t": 0.03,
    "R_t": 0.002,
    "I_s": 1.4,
    "e_q_ref": 0.1,
}


def closed_form(name: str, s: complex) -> np.ndarray:
    """M_kind(p, s) as the appendix prints it (section A), outputs by inputs."""
    w, d, e0, i0 = OMEGA_0, P["delta_eq"], P["E0d"], P["I0d"]
    lf, rf, cf, lg, rg = (P[one] for one in ("L_F", "R_F", "C_F", "L_g", "R_g"))
    pi_, low = P["kP"] + P["kI"] / s, P["omega_c"] / (s + P["omega_c"])
    pll = P["kP_pll"] + P["kI_pll"] / s
    pade = (1 - P["T_d"] * s / 2) / (1 + P["T_d"] * s / 2)
    i_eq, e_eq = np.array([[i0], [0.0]]), np.array([[e0], [0.0]])

    def lcl() -> np.ndarray:
        a = np.block(
            [
                [-w * rf / lf * I2 - w * J, -w / lf * I2, ZERO],
                [w / cf * I2, -w * J, -w / cf * I2],
                [ZERO, w / lg * I2, -w * rg / lg * I2 - w * J],
            ]
        )
        b = np.block(
            [
                [w / lf * I2, ZERO, -J @ i_eq],
                [ZERO, ZERO, -J @ e_eq],
                [ZERO, -w / lg * I2, -J @ i_eq],
            ],
        )
        x = np.linalg.solve(s * np.eye(6) - a, b)
        i_ti, e, i_g = x[:2], x[2:4], x[4:]
        return np.vstack([i_ti, e, i_g, e[1:], i_ti - i_g])

    def lcl_node(rest: np.ndarray, admittance: np.ndarray) -> np.ndarray:
        """An LCL with any branches at the node e: admittance (2, 2), and their current for
        delta_omega alone.
        """
        z_1, z_2 = (r * I2 + x * (s / w * I2 + J) for r, x in ((rf, lf), (rg, lg)))
        y_1, y_2 = np.linalg.inv(z_1), np.linalg.inv(z_2)
        turn_1, turn_2 = -lf / w * J @ i_eq, -lg / w * J @ i_eq
        by = np.hstack([y_1, y_2, y_1 @ turn_1 - y_2 @ turn_2 - rest])
        e = np.linalg.solve(y_1 + y_2 + admittance, by)
        i_ti = y_1 @ (np.hstack([I2, ZERO, turn_1]) - e)
        i_g = y_2 @ (e + np.hstack([ZERO, -I2, turn_2]))
        return np.vstack([i_ti, e, i_g, e[1:], i_ti - i_g])

    def capacitor(c: float, voltage: np.ndarray, r: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """(admittance, current for delta_omega alone) of a series r, c whose capacitor rests at a
        voltage.
        """
        y = np.linalg.inv(r * I2 + np.linalg.inv(c * (s / w * I2 + J)))
        return y, y @ np.linalg.inv(c * (s / w * I2 + J)) @ (c / w * J @ voltage)

    def lcl_r() -> np.ndarray:
        y, rest = capacitor(cf, e_eq, P["R_C"])
        return lcl_node(rest, y)

    def lcl_rc() -> np.ndarray:
        branch_voltage = np.linalg.solve(I2 + P["R_d"] * P["C_d"] * J, e_eq)
        (y, rest), (y_d, rest_d) = (
            capacitor(cf, e_eq),
            capacitor(P["C_d"], branch_voltage, P["R_d"]),
        )
        return lcl_node(rest + rest_d, y + y_d)

    def lcl_trap() -> np.ndarray:
        (c, l, r), x = (P[one] for one in ("C_t", "L_t", "R_t")), s / w * I2 + J
        i_t = np.linalg.solve(r * I2 + l * J + np.linalg.inv(c * J), e_eq)
        v_t = np.linalg.solve(c * J, i_t)
        y, rest = capacitor(cf, e_eq)
        y_t = np.linalg.inv(r * I2 + l * x + np.linalg.inv(c * x))
        turned = -y_t @ (l / w * J @ i_t) + y_t @ np.linalg.inv(c * x) @ (c / w * J @ v_t)
        return lcl_node(rest + turned, y + y_t)

    def lcl_saturated() -> np.ndarray:
        k, voltage = (
            P["I_s"] ** 2,
            -rf * i0,
        )  # u_r rests at e here, so that R_F i_ti is what drives the current
        less = np.sqrt(1 + i0**2 / k)
        gain, slope = (
            w / lf * np.diag([less**3, less]),
            w / lf * less * voltage * i0 / k * np.diag([3, 1]),
        )
        a = np.block(
            [
                [slope - rf * gain - w * J, -gain, ZERO],
                [w / cf * I2, -w * J, -w / cf * I2],
                [ZERO, w / lg * I2, -w * rg / lg * I2 - w * J],
            ]
        )
        b = np.block(
            [[gain, ZERO, -J @ i_eq], [ZERO, ZERO, -J @ e_eq], [ZERO, -w / lg * I2, -J @ i_eq]]
        )
        x = np.linalg.solve(s * np.eye(6) - a, b)
        return np.vstack([x, x[3:4], x[:2] - x[4:]])

    def on_vectors(gain: Callable[[complex], complex]) -> np.ndarray:
        """What acts as gain(s + j w) on the vector of the stationary frame, on its d and q
        components.
        """
        plus, minus = gain(s + 1j * w), np.conj(gain(np.conj(s) + 1j * w))
        return (plus + minus) / 2 * I2 + (plus - minus) / 2j * J

    def sogi(at: complex) -> complex:
        return P["k"] * w * at / (at**2 + P["k"] * w * at + w**2)

    def fixed(gain: Callable[[complex], complex]) -> np.ndarray:
        """Of a filter in the stationary frame, seen in one that runs ahead by delta: G (in + J
        in_eq delta) - J in_eq delta.
        """
        own, turn = on_vectors(gain), J @ e_eq / s
        return np.hstack([own, own @ turn - turn])

    def double_frame(at: complex) -> complex:
        """Of Rodriguez: each sequence is low-passed in its own frame, and taken from what the other
        sees.
        """
        plus, minus = (P["omega_c"] / (at - turn + P["omega_c"]) for turn in (1j * w, -1j * w))
        return (1 - minus) / (1 - plus * minus)

    def ll_filter() -> np.ndarray:
        z = (rf + rg) * I2 + (lf + lg) * (s / w * I2 + J)
        current = np.linalg.solve(z, np.hstack([I2, -I2, -(lf + lg) / w * J @ i_eq]))
        line = rg * I2 + lg * (s / w * I2 + J)
        voltage = line @ current + np.hstack([ZERO, I2, lg / w * J @ i_eq])
        return np.vstack([current, voltage, voltage[1:]])

    def l_filter() -> np.ndarray:
        a = -w * rf / lf * I2 - w * J
        current = np.linalg.solve(s * I2 - a, np.hstack([w / lf * I2, -w / lf * I2, -J @ i_eq]))
        voltage = np.hstack([ZERO, I2, np.zeros((2, 1))])
        return np.vstack([current, voltage, voltage[1:]])

    def dvoc() -> np.ndarray:
        c, h = cos(P["kappa"]), sin(P["kappa"])
        p, q = np.array([i0, 0, e0, 0]), np.array([0, i0, 0, -e0])
        amplitude = -P["eta"] / e0 * (c * p + h * q) / (s + 2 * P["alpha"] * e0**2)
        return np.vstack([P["eta"] / e0**2 * (c * q - h * p), amplitude])

    z, t = s * P["T_s"], s * P["T_d"]
    notch = (s**2 + P["omega_n"] ** 2) / (s**2 + P["omega_n"] / P["Q"] * s + P["omega_n"] ** 2)
    forms: dict[str, Callable[[], object]] = {
        "LCL": lcl,
        "LFilter": l_filter,
        "PI": lambda: [[pi_]],
        "PI_dq": lambda: pi_ * I2,
        "LPF1": lambda: [[low]],
        "LPF1_dq": lambda: low * I2,
        "Integrator": lambda: [[1 / s]],
        "SRF_PLL": lambda: [[pll], [pll / s]],
        "Rot_v": lambda: [[cos(d), sin(d), -sin(d)], [-sin(d), cos(d), -cos(d)]],
        "Rot_i": lambda: [[cos(d), -sin(d), -i0 * sin(d)], [sin(d), cos(d), i0 * cos(d)]],
        "PQ_calc": lambda: [[i0, 0, e0, 0], [0, i0, 0, -e0]],
        "Gain": lambda: [[P["k"]]],
        "Gain_dq": lambda: P["k"] * I2,
        "Negate": lambda: [[-1]],
        "Negate_dq": lambda: -I2,
        "SliceD": lambda: [[1, 0]],
        "SliceQ": lambda: [[0, 1]],
        "PackDQ": lambda: I2,
        "JMul": lambda: w * P["L"] * J,
        "ConstZero": lambda: np.zeros((1, 0)),
        "Pade1": lambda: [[pade]],
        "Pade1_dq": lambda: pade * I2,
        "Pade2_dq": lambda: (12 - 6 * t + t**2) / (12 + 6 * t + t**2) * I2,
        "Pade3_dq": lambda: (
            (120 - 60 * t + 12 * t**2 - t**3) / (120 + 60 * t + 12 * t**2 + t**3) * I2
        ),
        "Pade4_dq": lambda: (
            (1680 - 840 * t + 180 * t**2 - 20 * t**3 + t**4)
            / (1680 + 840 * t + 180 * t**2 + 20 * t**3 + t**4)
            * I2
        ),
        "Notch": lambda: [[notch]],
        # beyond the appendix: equation (6b) linearised about [I0d, 0], and a delay, whose matrices
        # are those without it
        "JMul_omega": lambda: np.hstack([P["L"] * J, P["L"] / w * (J @ i_eq)]),
        "Delay": lambda: I2,
        "Magnitude": lambda: [[1, 0]],
        "LCL_R": lcl_r,
        "LCL_RC": lcl_rc,
        "LLFilter": ll_filter,
        "Shunt_RC": lambda: -np.linalg.inv(P["R"] * I2 + np.linalg.inv(P["C"] * (s / w * I2 + J))),
        "DC_link": lambda: [[-i0 / (P["C_dc"] * s), 0, -e0 / (P["C_dc"] * s), 0]],
        # v_q less e0 times the angle between the frames, which integrates the difference of their
        # frequencies
        "PLL_frequency": lambda: [[0, pll / (1 + pll * e0 / s), pll * e0 / s / (1 + pll * e0 / s)]],
        "dVOC": dvoc,
        "Share": lambda: I2,
        "DeadTime": lambda: (
            -P["D"] * np.diag([P["a"] ** 2 / hypot(i0, P["a"]) ** 3, 1 / hypot(i0, P["a"])])
        ),
        "Turn": lambda: cos(P["phi"]) * I2 + sin(P["phi"]) * J,
        "ZOH_dq": lambda: (
            2
            * np.polyval([1, 0, 420, 0, 15120], z)
            / np.polyval([1, 30, 420, 3360, 15120, 30240], z)
            * I2
        ),
        "SOGI_dq": lambda: on_vectors(sogi),
        "DSOGI_dq": lambda: on_vectors(lambda at: sogi(at) * (1 + 1j * w / at) / 2),
        "DDSRF_dq": lambda: on_vectors(double_frame),
        "Resonant_dq": lambda: (
            2 * P["k"] * P["omega_c"] * s / (s**2 + 2 * P["omega_c"] * s + (P["n"] * w) ** 2) * I2
        ),
        "PI_negative_dq": lambda: on_vectors(lambda at: P["kP"] + P["kI"] / (at + 1j * w)),
        "Ref_pq": lambda: [[-i0 / e0, 0, 0, 0], [0, 0, 0, 0]],
        "LCL_trap": lcl_trap,
        "LCL_saturated": lcl_saturated,
        "SOGI_fixed": lambda: fixed(sogi),
        "DSOGI_fixed": lambda: fixed(lambda at: sogi(at) * (1 + 1j * w / at) / 2),
        # where they rest is no matter of small deviations
        "SRF_PLL_P": lambda: [[P["kP_pll"]], [P["kP_pll"] / s]],
        "SRF_PLL_ref": lambda: [[pll], [pll / s]],
    }
    return np.array(forms[name](), dtype=complex)


#: Boxes as the appendix prints them, then those of the extended kinds: L per unit like other
#: inductances, T_d to 500 us.
PLANT_BOXES = {
    "L_F": (1e-4, 1),
    "R_F": (1e-5, 1),
    "C_F": (1e-5, 1),
    "L_g": (1e-4, 1),
    "R_g": (1e-5, 1),
}
PI_BOXES = {"kP": (1e-6, 1e5), "kI": (1e-6, 1e7)}
CUTOFF = {"omega_c": (2 * pi * 0.1, 2 * pi * 5e4)}
BOXES = {
    "LCL": PLANT_BOXES,
    "LFilter": {"L_F": (1e-4, 1), "R_F": (1e-5, 1)},
    "PI": PI_BOXES,
    "PI_dq": PI_BOXES,
    "PI_negative_dq": PI_BOXES,
    "LPF1": CUTOFF,
    "LPF1_dq": CUTOFF,
    "SRF_PLL": {"kP_pll": (1e-6, 1e5), "kI_pll": (1e-6, 1e7)},
    "Gain": {"k": (-100, 100)},
    "Gain_dq": {"k": (-100, 100)},
    "JMul": {"L": (1e-5, 5)},
    "Pade1": {"T_d": (1e-6, 5e-3)},
    "Pade1_dq": {"T_d": (1e-6, 5e-3)},
    "Notch": {"omega_n": (2 * pi * 5, 2 * pi * 1e4), "Q": (0.5, 100)},
    "JMul_omega": {"L": (1e-4, 1)},
    "Delay": {"T_d": (1e-6, 5e-4)},
    **{f"Pade{order}_dq": {"T_d": (1e-6, 5e-4)} for order in (2, 3, 4)},
    "LCL_R": {**PLANT_BOXES, "R_C": (1e-5, 10)},
    "LCL_RC": {**PLANT_BOXES, "R_d": (1e-5, 10), "C_d": (1e-5, 1)},
    "LLFilter": {name: PLANT_BOXES[name] for name in ("L_F", "R_F", "L_g", "R_g")},
    "Shunt_RC": {"R": (1e-4, 100), "C": (1e-5, 10)},
    "DC_link": {"C_dc": (1e-4, 1)},
    "PLL_frequency": {"kP_pll": (1e-6, 1e5), "kI_pll": (1e-6, 1e7)},
    "dVOC": {"eta": (1e-3, 1e3), "kappa": (0, pi), "alpha": (1e-3, 1e4)},
    "Share": {"share_p": (-2, 3), "share_q": (-2, 3)},
    "DeadTime": {"D": (1e-5, 0.5), "a": (1e-3, 2)},
    "Turn": {"phi": (-1, 1)},
    "ZOH_dq": {"T_s": (1e-6, 2e-3)},
    "SOGI_dq": {"k": (1e-3, 20)},
    "SOGI_fixed": {"k": (1e-3, 20)},
    "DSOGI_fixed": {"k": (1e-3, 20)},
    "DSOGI_dq": {"k": (1e-3, 20)},
    "DDSRF_dq": CUTOFF,
    "Resonant_dq": {"k": (1e-4, 1e3), "omega_c": (2 * pi * 1e-3, 2 * pi * 100), "n": (0.5, 60)},
    "LCL_saturated": {**PLANT_BOXES, "I_s": (0.3, 100)},
    "LCL_trap": {**PLANT_BOXES, "L_t": (1e-6, 1), "C_t": (1e-5, 1), "R_t": (1e-5, 10)},
    "SRF_PLL_P": {"kP_pll": (1e-6, 1e5), "e_q_ref": (-0.8, 0.8)},
    "SRF_PLL_ref": {"kP_pll": (1e-6, 1e5), "kI_pll": (1e-6, 1e7), "e_q_ref": (-0.8, 0.8)},
}
ORDERS = {
    "LCL": 6,
    "LFilter": 2,
    "PI": 1,
    "PI_dq": 2,
    "PI_negative_dq": 2,
    "LPF1": 1,
    "LPF1_dq": 2,
    "Integrator": 1,
    "SRF_PLL": 2,
    "Pade1": 1,
    "Pade1_dq": 2,
    "Notch": 2,
    "Delay": 2,
    "Pade2_dq": 2,
    "Pade3_dq": 2,
    "Pade4_dq": 2,
    "LCL_R": 6,
    "LCL_RC": 8,
    "LLFilter": 2,
    "Shunt_RC": 2,
    "DC_link": 1,
    "PLL_frequency": 2,
    "dVOC": 1,
    "ZOH_dq": 2,
    "SOGI_dq": 4,
    "DSOGI_dq": 4,
    "DDSRF_dq": 4,
    "Resonant_dq": 4,
    "LCL_trap": 10,
    "SOGI_fixed": 4,
    "DSOGI_fixed": 4,
    "LCL_saturated": 6,
    "SRF_PLL_P": 1,
    "SRF_PLL_ref": 2,
}
#: Equilibrium numbers that a kind has under `equilibrium="paper"`.
PAPER_NUMBERS = {
    "LCL": {"E0d", "I0d"},
    "LFilter": {"I0d"},
    "Rot_v": {"delta_eq"},
    "Rot_i": {"delta_eq", "I0d"},
    "PQ_calc": {"E0d", "I0d"},
    "JMul_omega": {"I0d"},
    "Magnitude": {"E0d"},
    "LCL_R": {"E0d", "I0d"},
    "LCL_RC": {"E0d", "I0d"},
    "LLFilter": {"I0d"},
    "DC_link": {"E0d", "I0d"},
    "PLL_frequency": {"E0d"},
    "dVOC": {"E0d", "I0d"},
    "DeadTime": {"I0d"},
    "Ref_pq": {"E0d", "I0d"},
    "LCL_trap": {"E0d", "I0d"},
    "LCL_saturated": {"E0d", "I0d"},
    "SOGI_fixed": {"E0d"},
    "DSOGI_fixed": {"E0d"},
}


def kind_named(name: str) -> ModuleKind:
    return find_kind(name, VOCABULARY)


def matrices_at(kind: ModuleKind, **given) -> list[np.ndarray]:
    """A, B, C, D at the values P."""
    values = {name: P[name] for name in kind.parameters}
    defaults = kind.context(OMEGA_0, (1.0, 0.0), {})
    return as_arrays(kind, kind.state_space(**(defaults | values | given)))


def as_arrays(kind: ModuleKind, matrices) -> list[np.ndarray]:
    n, inputs = len(matrices[0]), sum(signal.width for signal in kind.inputs.values())
    a, b, c, d = (np.array(rows, dtype=float) for rows in matrices)
    return [a.reshape(n, n), b.reshape(n, inputs), c.reshape(len(c), n), d.reshape(len(d), inputs)]


def response(matrices: list[np.ndarray], s: complex) -> np.ndarray:
    a, b, c, d = matrices
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


def paper_matrices(name: str) -> list[np.ndarray]:
    """Those that assembly makes under `equilibrium="paper"`, in a diagram of that kind and a
    plant.
    """
    diagram = Diagram()
    if kind_named(name).family != "physical plant":
        diagram.add("LCL", "plant")
    diagram.add(name, "it")
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "paper")
    values = {one.name: P[one.name.rpartition(".")[2]] for one in table.free}
    found = module_matrices(
        wiring,
        parameters_at(wiring, table, values),
        (0.0, 0.0, 1.0),
        equilibrium="paper",
        power_node="capacitor",
        omega_0=OMEGA_0,
    )
    return as_arrays(kind_named(name), found["it"])


def test_the_paper_has_23_kinds_and_the_default_vocabulary_the_extended_ones_behind_them():
    assert len(PAPER_VOCABULARY) == 23
    extended = [
        "JMul_omega",
        "Delay",
        "Magnitude",
        "LCL_R",
        "LCL_RC",
        "LLFilter",
        "Shunt_RC",
        "DC_link",
    ]
    extended += [
        "PLL_frequency",
        "dVOC",
        "Share",
        "DeadTime",
        "Turn",
        "ZOH_dq",
        "SOGI_dq",
        "DSOGI_dq",
        "DDSRF_dq",
    ]
    extended += ["Resonant_dq", "Ref_pq", "LCL_trap", "SOGI_fixed", "DSOGI_fixed", "LCL_saturated"]
    extended += ["SRF_PLL_P", "SRF_PLL_ref", "Pade2_dq", "Pade3_dq", "Pade4_dq", "PI_negative_dq"]
    assert [kind.name for kind in VOCABULARY if kind.extended] == extended
    assert VOCABULARY[:23] == PAPER_VOCABULARY
    assert len(set(NAMES)) == 52


@each_of("name", NAMES)
def test_a_kind_is_the_papers_in_paper_mode(name):
    matrices = paper_matrices(name)
    for s in S:
        wanted = closed_form(name, s)
        # 1e-12: two ways to one rational function, conditioned like the LCL's resonance
        assert response(matrices, s) == pytest.approx(
            wanted, rel=1e-12, abs=1e-12 * np.abs(wanted).max(initial=0.0)
        )


@each_of("name", NAMES)
def test_the_direct_term_is_the_limit_at_high_frequency(name):
    matrices = paper_matrices(name)
    far = response(matrices, 1e13j)  # the fastest pole is near 1e5 rad/s, its residue near 1e7
    assert far == pytest.approx(matrices[3], abs=1e-5)


@pytest.mark.slow
@each_of("name", NAMES)
def test_a_kind_keeps_the_contract(name):
    check_kind(kind_named(name), np.random.default_rng(3))


@each_of("name", NAMES)
def test_a_kind_has_the_papers_boxes(name):
    found = {key: (box.low, box.high) for key, box in kind_named(name).parameters.items()}
    assert found == BOXES.get(name, {})


def test_the_equilibrium_numbers_have_the_papers_boxes():
    assert {name: (box.low, box.high) for name, box in PAPER_RANGES.items()} == {
        "E0d": (0.5, 1.5),
        "I0d": (0.5, 1.5),
        "delta_eq": (-0.5, 0.5),
    }


@each_of("name", NAMES)
def test_a_kind_has_the_papers_order_and_equilibrium_numbers(name):
    kind = kind_named(name)
    assert kind.order == ORDERS.get(name, 0)
    assert set(kind.paper_parameters) == PAPER_NUMBERS.get(name, set())
    assert kind.order == len(kind.states) or kind.element in (
        Element.DELAY,
        Element.HOLD,
        Element.PADE,
    )


@each_of("name", [kind.name for kind in VOCABULARY if kind.states])
def test_the_order_is_the_rank_of_the_hankel_matrix(name):
    kind = kind_named(name)
    n, matrices = len(kind.states), paper_matrices(name)
    scale = max(1.0, np.abs(np.linalg.eigvals(matrices[0])).max())
    a, b, c = matrices[0] / scale, matrices[1], matrices[2]
    moments = [c @ np.linalg.matrix_power(a, k) @ b for k in range(2 * n)]
    hankel = np.block([[moments[i + j] for j in range(n)] for i in range(n)])
    rows = np.abs(hankel).max(axis=1, keepdims=True)
    scaled = hankel / np.where(rows > 0, rows, 1.0)
    assert np.linalg.matrix_rank(scaled, tol=1e-9) == n


def turned(delta: complex) -> np.ndarray:
    return np.array([[np.cos(delta), np.sin(delta)], [-np.sin(delta), np.cos(delta)]])


def derivative(law: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Jacobian by complex steps, exact to rounding."""
    step = 1e-30
    columns = [law(at + 1j * step * np.eye(len(at))[k]).imag / step for k in range(len(at))]
    return np.array(columns).T


def test_the_operating_point_kinds_are_derivatives_of_the_nonlinear_laws():
    delta, e, i, v = 0.3, np.array([1.03, -0.2]), np.array([0.7, 0.4]), np.array([0.98, 0.11])
    frame = (cos(delta), sin(delta))
    product = np.concatenate([e, i])
    cases = {
        "Rot_v": (
            lambda x: turned(x[2]) @ x[:2],
            [*v, delta],
            {"frame": frame, "v_DQ_eq": tuple(v)},
        ),
        "Rot_i": (
            lambda x: turned(-x[2]) @ x[:2],
            [*i, delta],
            {"frame": frame, "i_dq_eq": tuple(i)},
        ),
        "PQ_calc": (
            lambda x: np.array([x[:2] @ x[2:], x[:2] @ J @ x[2:]]),
            product,
            {"e_eq": tuple(e), "i_eq": tuple(i)},
        ),
        "JMul_omega": (
            lambda x: (1 + x[2] / OMEGA_0) * P["L"] * (J @ x[:2]),
            [*i, 0.0],
            {"in__eq": tuple(i)},
        ),
    }
    for name, (law, point, given) in cases.items():
        found = matrices_at(kind_named(name), **given)[3]
        # sines, and sums of two products of numbers of order one, each operation rounded by 1.1e-16
        assert found == pytest.approx(
            derivative(law, np.array(point, dtype=complex)), rel=1e-13, abs=1e-14
        ), name


@pytest.mark.parametrize("name", ["LCL", "LFilter"])
def test_a_plant_is_the_derivative_of_equation_2(name):
    i_ti, e, i_g = np.array([0.9, 0.2]), np.array([1.02, 0.05]), np.array([0.95, -0.1])
    w, lf, rf, cf, lg, rg = OMEGA_0, *(P[one] for one in ("L_F", "R_F", "C_F", "L_g", "R_g"))

    def lcl(x: np.ndarray) -> np.ndarray:  # x = i_ti, e, i_g, u_r, v_in, frequency deviation
        omega = w + x[10]
        return np.concatenate(
            [
                w / lf * (x[6:8] - x[2:4] - rf * x[:2]) - omega * (J @ x[:2]),
                w / cf * (x[:2] - x[4:6]) - omega * (J @ x[2:4]),
                w / lg * (x[2:4] - x[8:10] - rg * x[4:6]) - omega * (J @ x[4:6]),
            ]
        )

    def l_filter(x: np.ndarray) -> np.ndarray:
        return w / lf * (x[2:4] - x[4:6] - rf * x[:2]) - (w + x[6]) * (J @ x[:2])

    if name == "LCL":
        states, law = np.concatenate([i_ti, e, i_g]), lcl
        equilibria = {"i_ti_eq": tuple(i_ti), "e_eq": tuple(e), "i_g_eq": tuple(i_g)}
    else:
        states, law, equilibria = i_g, l_filter, {"i_g_eq": tuple(i_g)}
    a, b, _, _ = matrices_at(kind_named(name), **equilibria)
    jacobian = derivative(law, np.concatenate([states, np.ones(4), [0.0]]).astype(complex))
    # entries up to omega_0 / L_F, 1e4: a few operations, each rounded by 1.1e-16 of that
    assert np.hstack([a, b]) == pytest.approx(jacobian, rel=1e-12, abs=1e-11)


@each_of("order", range(1, HIGHEST_PADE_ORDER + 1))
def test_the_pade_form_of_a_delay_is_the_printed_quotient(order):
    from scipy.interpolate import pade

    delay = 1.3e-4
    taylor = [(-1.0) ** k / np.prod(np.arange(1.0, k + 1)) for k in range(2 * order + 1)]
    matrices = [np.array(rows, dtype=float) for rows in pade_state_space(delay, order)]
    for s in 2j * pi * np.array([10.0, 1e3, 4e3]):
        if order <= 6:  # the linear system for the coefficients is ill-conditioned beyond
            top, bottom = pade(taylor, order, order)
            wanted = top(s * delay) / bottom(s * delay)
            assert response(matrices, s) == pytest.approx(wanted * I2, rel=1e-6)
        assert abs(response(matrices, s)[0, 0]) == pytest.approx(1.0, rel=1e-9)  # all-pass
    assert matrices[3] == pytest.approx((-1) ** order * I2, abs=1e-12)
    assert np.linalg.eigvals(matrices[0]).real.max() < 0


@pytest.mark.parametrize(
    ("delay", "highest", "order"), [(100e-6, 4e3, 3), (150e-6, 5e3, 5), (1e-6, 10.0, 1)]
)
def test_the_pade_order_is_the_smallest_within_one_degree(delay, highest, order):
    assert pade_order(delay, highest) == order

    def worst(order: int) -> float:
        matrices = [np.array(rows, dtype=float) for rows in pade_state_space(delay, order)]
        s = 2j * pi * np.linspace(0.0, highest, 200)[1:]
        found = np.array([response(matrices, one)[0, 0] for one in s])
        return float(np.degrees(np.abs(np.angle(found * np.exp(s * delay)))).max())

    assert worst(order) <= 1.0
    assert order == 1 or worst(order - 1) > 1.0


def test_the_pade_order_ends_at_twelve():
    assert pade_order(5e-4, 5e4) == HIGHEST_PADE_ORDER == 12


@pytest.mark.slow
def test_the_kinds_survive_pickling():
    for kind in VOCABULARY:
        again = pickle.loads(pickle.dumps(kind))
        assert again == kind
        check_kind(again)


def lag(tau):
    return [[-1 / tau]], [[1 / tau]], [[1]], [[0]]


MINE = ModuleKind(
    name="Lag",
    family="dynamic control",
    law="out = in_ / (1 + tau s)",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("lagged",),
    parameters={"tau": Range(1e-6, 1.0, 1e-3, "s", "time constant", divides=True)},
    state_space=lag,
    dc_gain=1.0,
    reference="a notebook",
)


def test_a_kind_of_ones_own_keeps_the_contract():
    check_kind(MINE)


BOX = Range(0.1, 10.0, 1.0, "1", "gain")


@each_of(
    ("change", "sentence"),
    [
        (
            {"states": ()},
            r"0 states, 1 input and 1 output channels need A of 0 x 0, got rows of length \[1\]",
        ),
        ({"states": ("a", "b")}, r"2 states, .* need A of 2 x 2, got rows of length \[1\]"),
        (
            {"inputs": {"in_": Signal.DQ_VEC}},
            r"2 input and 1 output channels need B of 1 x 2, got rows of length \[1\]",
        ),
        (
            {"outputs": {"out": Signal.DQ_VEC}},
            r"1 input and 2 output channels need C of 2 x 1, got rows of length \[1\]",
        ),
        ({"outputs": {}}, "without outputs"),
        ({"inputs": {}}, "its 1 states have no input"),
        (
            {"outputs": {"in_": Signal.SCALAR}},
            "each port needs a name of its own, in_ is there twice",
        ),
        ({"inputs": {"in_": "voltage"}}, "the port in_ carries a Signal, .* got 'voltage'"),
        ({"name": "My lag"}, "the name 'My lag' must be a word"),
        (
            {"parameters": {}},
            "state_space asks for tau, which is no parameter, none of omega_0, frame",
        ),
        ({"parameters": {**MINE.parameters, "k": BOX}}, "state_space lacks the argument k"),
        (
            {"state_space": lambda tau: ([[0]], [[1]], [[1]])},
            r"returns four nested lists \(A, B, C, D\), got 3",
        ),
        ({"state_space": lambda tau: 1.0}, r"returns four nested lists \(A, B, C, D\), got float"),
        ({"state_space": lambda tau: ([0], [1], [1], [0])}, "need A of 1 x 1, got no nested list"),
        (
            {"state_space": lambda tau: ([[-tau]], [[1]], [[1]], [[float("inf")]])},
            "D has an entry that is not finite",
        ),
        ({"dc_gain": 2.0}, r"dc_gain = 2, but D - C A\^-1 B at typical values is \[\[1.0\]\]"),
        (
            {"state_space": lambda tau: ([[0]], [[tau]], [[1]], [[0]])},
            "A is singular, so it integrates",
        ),
        ({"delay": "T"}, "the delay T is not among its parameters"),
        ({"delay": "tau"}, "a delay has one dq_vec input, .* got 1 inputs, 1 outputs, 1 states"),
        ({"equilibrium": {"inp": "I0d"}}, "equilibrium names 'inp'"),
        ({"equilibrium": {"in_": "I0"}}, "the equilibrium of in_ is called 'I0'; did you mean I0d"),
    ],
)
def test_a_declaration_that_contradicts_itself_is_refused_with_the_numbers(change, sentence):
    with pytest.raises(ModuleError, match=sentence):
        replace(MINE, **change)


def test_a_parameter_may_not_have_the_name_of_what_assembly_gives():
    with pytest.raises(ModuleError, match="a parameter may not be called omega_0"):
        replace(MINE, parameters={"omega_0": BOX}, state_space=lambda omega_0: lag(omega_0))


def test_a_gain_at_rest_needs_one_input():
    two = {"a": Signal.SCALAR, "b": Signal.SCALAR}
    with pytest.raises(
        ModuleError, match="dc_gain is for one input and outputs of the same signal, got 2 inputs"
    ):
        replace(MINE, inputs=two, state_space=lambda tau: ([[-1 / tau]], [[1, 1]], [[1]], [[0, 0]]))


@pytest.mark.parametrize(
    ("low", "high", "typical", "sentence"),
    [
        (1.0, 1.0, 1.0, "low < high, got low=1.0, high=1.0"),
        (2.0, 1.0, 1.5, "low < high, got low=2.0, high=1.0"),
        (0.0, float("inf"), 1.0, "finite numbers low < high, got low=0.0, high=inf"),
        (float("nan"), 1.0, 0.5, "low < high, got low=nan"),
        (1.0, 2.0, 3.0, r"typical=3.0 must lie within \[1.0, 2.0\]"),
        (1.0, 2.0, float("nan"), "typical=nan must lie within"),
    ],
)
def test_a_range_that_contradicts_itself_is_refused_with_the_numbers(low, high, typical, sentence):
    with pytest.raises(ModuleError, match=sentence):
        Range(low, high, typical, "1", "gain")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"state_space": lambda tau: ([[-1 / max(tau, 1e-3)]], [[1e3]], [[1]], [[0]])}, "symbols"),
        (
            {"state_space": lambda tau: ([[-1 / float(tau)]], [[1 / float(tau)]], [[1]], [[0]])},
            "an entry is nan with symbols",
        ),
        (
            {"state_space": lambda tau: ([[-5.0]], [[5.0]], [[1]], [[0]])},
            "tau must change the response",
        ),
        (
            {
                "states": ("a", "b"),
                "state_space": lambda tau: (
                    [[-1 / tau, 0], [0, -2]],
                    [[1 / tau], [2]],
                    [[1, 0]],
                    [[0]],
                ),
            },
            "each of its 2 states must be seen by an output; that with the pole -2",
        ),
        (
            {
                "states": ("a", "b"),
                "state_space": lambda tau: (
                    [[-1 / tau, 0], [0, -2]],
                    [[1 / tau], [0]],
                    [[1, 1]],
                    [[0]],
                ),
            },
            "each of its 2 states must be moved by an input; that with the pole -2",
        ),
    ],
)
def test_a_kind_that_breaks_the_contract_is_told_how(change, sentence):
    with pytest.raises((ModuleError, AssertionError), match=sentence):
        check_kind(replace(MINE, dc_gain=None, **change))


def test_states_at_rest_that_take_no_symbols_are_refused():
    oscillator = kind_named("dVOC")
    assert oscillator.large_signal is not None
    law = LargeSignal(
        oscillator.large_signal.law, lambda v_eq: (sqrt(v_eq[0] ** 2 + v_eq[1] ** 2),)
    )
    with pytest.raises(AssertionError, match="an entry is nan with symbols"):
        check_kind(replace(oscillator, name="Mine", large_signal=law))


def test_a_kind_is_a_frozen_value():
    with pytest.raises(dataclasses.FrozenInstanceError):
        MINE.name = "other"  # type: ignore[misc]


def test_a_negative_sequence_pi_is_a_pi_in_the_frame_that_turns_backwards():
    """A step of arbitrary phase beside a ripple, regulated axis by axis after a turn by 2 theta."""
    t = np.linspace(0.0, 0.05, 5001)
    e = (0.3 - 0.8j) * (t > 0.01) + 0.2 * np.exp(-2j * OMEGA_0 * t) + 0.1 * np.exp(400j * t)
    backwards = e * np.exp(2j * OMEGA_0 * t)
    expected = P["kP"] * e + P["kI"] * np.exp(-2j * OMEGA_0 * t) * cumulative_trapezoid(
        backwards, t, initial=0.0
    )
    a, b, c, d = matrices_at(kind_named("PI_negative_dq"))
    _, out, _ = lsim((a, b, c, d), np.column_stack([e.real, e.imag]), t)
    # 1e-4: two interpolations between 10 us samples
    assert out[:, 0] + 1j * out[:, 1] == pytest.approx(expected, abs=1e-4)
