"""REGC_A and REEC_A played: the terminal voltage in, the current out, by Heun's rule between given
times; the voltage is a line there, so that a jump is two times close together.

Law: i = (Ip - j Iq) v / |v|, per unit, out of the inverter. What happens at a threshold of the
voltage is seen at the next step.
"""

from collections.abc import Mapping

import numpy as np

from ibrid.fit.just_in_time import njit
from ibrid.generic.dialect import Dialect
from ibrid.generic.reec_a import (
    ENDED,
    IP_MAX,
    IQ_LAG,
    P_F,
    P_ORD,
    Q_PI,
    REEC_A,
    V_F,
    V_PI,
    reec_a_commands,
    remember,
)
from ibrid.generic.regc_a import IP, IQ, REGC_A, V_LVPL, regc_a_currents, regc_a_rates

#: Longest step, s; states.
STEP, STATES = 1.3e-3, 9
#: Set points that move the model: what they are called in recordings.
TOLD = ("p_ref", "q_ref", "v_ref")
#: Where the tables of limits begin.
_TABLES = REEC_A.names.index("Vq1")


def play_current_source(
    values: Mapping[str, float],
    dialect: Dialect,
    time: np.ndarray,
    v: np.ndarray,
    told: np.ndarray,
    rest: tuple[float, float, float],
) -> np.ndarray:
    """The complex current (M,) of REGC_A behind REEC_A.

    values : by the names of both blocks. time (M,) s, v (M,) complex, told (M, 3) by how much the
    set points `TOLD` are away from rest, per unit. rest : p, q, v before the first sample.
    """
    regc, reec = REGC_A.record(values), REEC_A.record(values)
    tables = np.array(REEC_A.values(values)[_TABLES:]).reshape(2, 8)
    size = np.abs(v)
    currents = _run(regc, reec, dialect, tables, time, size, told, rest)
    turned = v / np.maximum(size, 1e-9)
    return (currents[:, 0] - 1j * currents[:, 1]) * turned


@njit(cache=True)
def _start(regc, reec, rest) -> tuple[np.ndarray, np.ndarray]:
    """States and memory at rest."""
    p, q, v = rest
    x = np.zeros(STATES)
    x[IP], x[IQ], x[V_LVPL] = p / v, q / v, v
    x[V_F], x[P_F], x[P_ORD], x[Q_PI] = v, p, p, v
    x[V_PI] = x[IQ_LAG] = q / v
    memory = np.zeros(3)
    memory[ENDED], memory[IP_MAX] = -1e9, 1e9
    return x, memory


@njit(cache=True, error_model="numpy")
def _rates(regc, reec, dialect, tables, x, memory, time, v, rest, told, rates) -> None:
    ip, iq = regc_a_currents(regc, x[IP], x[IQ], v)
    ip_cmd, iq_cmd = reec_a_commands(
        reec, dialect, tables, x, memory, time, v, rest, told, (v * ip, v * iq), rates
    )
    regc_a_rates(regc, dialect, x, v, ip_cmd, iq_cmd, rest[1], rates)


@njit(cache=True, error_model="numpy")
def _run(regc, reec, dialect, tables, time, size, told, rest) -> np.ndarray:
    x, memory = _start(regc, reec, rest)
    first, second, later = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    moved, moved_next = np.zeros(3), np.zeros(3)
    currents = np.zeros((len(time), 2))
    currents[0] = regc_a_currents(regc, x[IP], x[IQ], size[0])
    for k in range(len(time) - 1):
        whole = time[k + 1] - time[k]
        parts = max(int(np.ceil(whole / STEP)), 1)
        h = whole / parts
        for part in range(parts):
            now = time[k] + part * h
            v = size[k] + (size[k + 1] - size[k]) * part / parts
            v_next = size[k] + (size[k + 1] - size[k]) * (part + 1) / parts
            for place in range(3):
                change = told[k + 1, place] - told[k, place]
                moved[place] = told[k, place] + change * part / parts
                moved_next[place] = told[k, place] + change * (part + 1) / parts
            remember(reec, memory, now, v)
            _rates(regc, reec, dialect, tables, x, memory, now, v, rest, moved, first)
            for place in range(STATES):
                later[place] = x[place] + h * first[place]
            _rates(
                regc,
                reec,
                dialect,
                tables,
                later,
                memory,
                now + h,
                v_next,
                rest,
                moved_next,
                second,
            )
            for place in range(STATES):
                x[place] += 0.5 * h * (first[place] + second[place])
        currents[k + 1] = regc_a_currents(regc, x[IP], x[IQ], size[k + 1])
    return currents
