"""REGC_A and REEC_A beside their equations, written once more and solved by SciPy."""

import numpy as np
from scipy.integrate import solve_ivp

from ibrid.generic.dialect import DIALECTS
from ibrid.generic.model import MODELS

MODEL = MODELS["wecc_regc_a+reec_a"]
TIME = np.arange(1601) * 1.25e-3
REST = 0.8, 0.1, 1.0
WECC = DIALECTS["wecc"]


def powers(values: dict[str, float], v: np.ndarray, told: np.ndarray) -> np.ndarray:
    return v * np.conj(MODEL.play(values, WECC, TIME, v, told, REST))


def test_it_rests_where_nothing_happens():
    for q_flag in (0.0, 1.0):
        still = powers({"QFLAG": q_flag}, np.full(len(TIME), 1.0 + 0j), np.zeros((len(TIME), 3)))
        np.testing.assert_allclose(still, 0.8 + 0.1j, atol=1e-12)


def test_a_step_of_p_passes_two_lags():
    told = np.zeros((len(TIME), 3))
    told[TIME >= 0.2, 0] = -0.3
    answer = powers({"Tpord": 0.1, "Tg": 0.03}, np.full(len(TIME), 1.0 + 0j), told)
    since = np.maximum(TIME - 0.2 + 0.5 * 1.25e-3, 0.0)
    part = 1.0 - (0.1 * np.exp(-since / 0.1) - 0.03 * np.exp(-since / 0.03)) / 0.07
    np.testing.assert_allclose(answer.real, 0.8 - 0.3 * part, atol=5e-4)


def test_a_dip_is_that_of_the_equations_solved_by_scipy():
    """QFLAG 0, Q first: in the dip Tiq and Tpord stand still and Kqv db(V0 - Vf) is added."""
    values = {"Kqv": 2.0, "Trv": 0.03, "Tg": 0.02, "Imax": 1.1, "Rrpwr": 2.0, "Lvplsw": 0.0}
    v = np.where((TIME >= 0.5) & (TIME < 0.75), 0.6, 1.0)

    def size(t: float) -> float:
        return 0.6 if 0.5 - 0.625e-3 <= t < 0.75 - 0.625e-3 else 1.0

    def rates(t: float, x: np.ndarray) -> list[float]:
        v_f, ip, iq, iq_base, p_ord = x
        low = size(t) < 0.85
        extra = min(max(2.0 * max(1.0 - v_f - 0.05, 0.0), -1.05), 1.05) if low else 0.0
        q_cmd = min(max(iq_base + extra, -1.1), 1.1)
        p_cmd = min(p_ord / v_f, np.sqrt(1.1**2 - q_cmd**2))
        lag_q = 0.0 if low else (0.1 / v_f - iq_base) / 0.02
        lag_p = 0.0 if low else (0.8 - p_ord) / 0.02
        rise = min((p_cmd - ip) / 0.02, 2.0)
        return [(size(t) - v_f) / 0.03, rise, (q_cmd - iq) / 0.02, lag_q, lag_p]

    solved = solve_ivp(
        rates, (0.0, TIME[-1]), [1.0, 0.8, 0.1, 0.1, 0.8], t_eval=TIME, max_step=2e-4, rtol=1e-8
    )
    answer = MODEL.play(values, WECC, TIME, v + 0j, np.zeros((len(TIME), 3)), REST)
    np.testing.assert_allclose(answer.real, solved.y[1] * np.clip((v - 0.4) / 0.4, 0, 1), atol=1e-2)
    np.testing.assert_allclose(-answer.imag, solved.y[2], atol=1e-2)


def test_the_phasor_of_the_current_turns_with_that_of_the_voltage():
    v = np.where(TIME >= 0.5, 0.7, 1.0) + 0j
    still = np.zeros((len(TIME), 3))
    turn = np.exp(0.4j)
    answers = [MODEL.play({}, WECC, TIME, one, still, REST) for one in (v, v * turn)]
    np.testing.assert_allclose(answers[1], answers[0] * turn, atol=1e-12)


def test_dialects_differ_where_they_are_said_to():
    v = np.where((TIME >= 0.5) & (TIME < 0.75), 0.6, 1.0) + 0j
    still = np.zeros((len(TIME), 3))
    values = {"Rrpwr": 2.0, "Tg": 0.05}
    slow = {"Rrpwr": 2.0 / 0.05 * 0.05, "Tg": 0.05}
    per_s = MODEL.play(values, DIALECTS["wecc"], TIME, v, still, REST)
    of_lag = MODEL.play(slow | {"Rrpwr": 0.1}, DIALECTS["andes"], TIME, v, still, REST)
    np.testing.assert_allclose(per_s, of_lag, atol=1e-12)
    capped = MODEL.play({"Lvpl1": 0.6}, DIALECTS["openipsl"], TIME, v, still, REST)
    assert capped[-1].real < 0.61
    assert MODEL.play({"Lvpl1": 0.6}, WECC, TIME, v, still, REST)[-1].real > 0.79
