"""REEC_A: the electrical control of a renewable generator, from set points to current commands.

Law, per unit: Vf' = (V - Vf) / Trv, Pf' = (P - Pf) / Tp. Reactive power: Qr = Pf tan phi (PFFLAG
1) or Qext, within QMin and QMax; QFLAG 0: Qr / Vf through the lag Tiq; QFLAG 1: a PI (Kvp, Kvi) of
Vr - Vf, with Vr of a PI (Kqp, Kqi) of Qr - Q (VFLAG 1) or Vbias + Qext (VFLAG 0), within VMIN and
VMAX. While V < Vdip or V > Vup ("dip") integrators and the lags Tiq and Tpord stand still and Iqinj
= Kqv db(Vref0 - Vf) is added, and for |Thld| behind it, as Iqfrz where Thld > 0. Active power:
Pord' = (Pref - Pord) / Tpord with rates dPmin to dPmax, within PMIN and PMAX; Ipcmd = Pord /
max(Vf, 0.01). Limits: PQFLAG 0: |Iqcmd| <= min(VDL1, Imax), Ipcmd <= min(VDL2, sqrt(Imax^2 -
Iqcmd^2)); PQFLAG 1 the other way round. Ipmax of the dip is kept for Thld2.

Reference: WECC, REEC_A model specification; signs as in `regc_a`.
"""

import numpy as np

from ibrid.fit.just_in_time import njit
from ibrid.generic.block import Constant, Flag, LawBlock
from ibrid.generic.laws import beyond_dead_band, clip, integral_rate, lag_rate, limit_of_table

_TABLE = tuple(
    Constant(f"{name}{k}", 0.0, 0.0, 2.0, meaning)
    for voltage, current, axis in (("Vq", "Iq", "reactive"), ("Vp", "Ip", "active"))
    for k in range(1, 5)
    for name, meaning in (
        (voltage, f"voltage of the {axis} current's limit; a table of zeros is off"),
        (current, f"limit of the {axis} current there"),
    )
)
REEC_A = LawBlock(
    "REEC_A",
    "REECA1",
    (
        Flag("PFFLAG", 0, (0, 1), "1: power factor, 0: Q"),
        Flag("VFLAG", 1, (0, 1), "1: Q controls the reference of V, 0: that is told", loop=True),
        Flag("QFLAG", 0, (0, 1), "1: voltage control, 0: Q / V", loop=True),
        Flag("PFLAG", 0, (0, 1), "1: P times generator speed", tried=False),
        Flag("PQFLAG", 0, (0, 1), "1: active current first, 0: reactive"),
    ),
    (
        Constant("Vdip", 0.85, 0.5, 0.97, "below which the voltage is a dip", "scanned"),
        Constant("Vup", 1.2, 1.03, 1.4, "above which the voltage is a swell", "scanned"),
        Constant("Trv", 0.02, 0.005, 0.2, "lag of the voltage, s", "fitted"),
        Constant("dbd1", -0.05, -0.2, 0.0, "dead band on overvoltage", "fitted"),
        Constant("dbd2", 0.05, 0.0, 0.2, "dead band on undervoltage", "fitted"),
        Constant("Kqv", 2.0, 0.0, 10.0, "gain of the injected reactive current", "fitted"),
        Constant("Iqh1", 1.05, 0.1, 2.0, "highest injected current", "fitted"),
        Constant("Iql1", -1.05, -2.0, -0.1, "lowest injected current", "fitted"),
        Constant("Vref0", 0.0, 0.9, 1.1, "its reference; 0: the voltage at rest"),
        Constant("Iqfrz", 0.0, -1.0, 1.0, "injected current behind a dip"),
        Constant("Thld", 0.0, -1.0, 1.0, "how long it is injected behind a dip, s", "scanned"),
        Constant("Thld2", 0.0, 0.0, 1.0, "how long Ipmax is kept behind a dip, s", "scanned"),
        Constant("Tp", 0.05, 0.01, 0.5, "lag of the power of the power factor, s", "fitted"),
        Constant("QMax", 0.44, 0.1, 1.0, "highest Q reference"),
        Constant("QMin", -0.44, -1.0, -0.1, "lowest Q reference"),
        Constant("VMAX", 1.1, 1.0, 1.3, "highest voltage reference"),
        Constant("VMIN", 0.9, 0.7, 1.0, "lowest voltage reference"),
        Constant("Kqp", 0.0, 0.0, 5.0, "proportional gain of Q", "fitted"),
        Constant("Kqi", 0.1, 0.01, 50.0, "integral gain of Q, 1/s", "fitted"),
        Constant("Kvp", 0.0, 0.0, 10.0, "proportional gain of V", "fitted"),
        Constant("Kvi", 40.0, 0.1, 200.0, "integral gain of V, 1/s", "fitted"),
        Constant("Vbias", 0.0, 0.0, 1.2, "bias of the voltage reference, set at rest"),
        Constant("Tiq", 0.02, 0.005, 0.5, "lag of the reactive current, s", "fitted"),
        Constant("dPmax", 99.0, 0.05, 999.0, "rate at which P rises, per unit per s"),
        Constant("dPmin", -99.0, -999.0, -0.05, "rate at which P falls, per unit per s"),
        Constant("PMAX", 1.0, 0.5, 1.5, "highest P"),
        Constant("PMIN", 0.0, -1.0, 0.2, "lowest P"),
        Constant("Imax", 1.1, 0.8, 2.0, "largest current", "fitted"),
        Constant("Tpord", 0.02, 0.005, 1.0, "lag of the active power, s", "fitted"),
        *_TABLE,
    ),
    "WECC REEC_A",
    places=("BUSR",),
)
#: Places of the states, behind those of the converter.
V_F, P_F, Q_PI, V_PI, IQ_LAG, P_ORD = 3, 4, 5, 6, 7, 8
#: Places of what is remembered between steps: whether it was a dip, when it ended, Ipmax then.
IN_DIP, ENDED, IP_MAX = 0, 1, 2
LEAST_V = 0.01


@njit(cache=True)
def is_dip(p, v: float) -> bool:
    """Whether the voltage is outside of the normal range."""
    return v < p.Vdip or v > p.Vup


@njit(cache=True)
def injected(p, dialect, memory, time: float, dip: bool, v_f: float, v_rest: float) -> float:
    """Reactive current added during a dip and for |Thld| behind it."""
    reference = p.Vref0 if p.Vref0 > 0.0 else v_rest
    support = clip(p.Kqv * beyond_dead_band(reference - v_f, p.dbd1, p.dbd2), p.Iql1, p.Iqh1)
    if dip:
        return support
    if time < memory[ENDED] + abs(p.Thld):
        held = p.Thld > 0.0
        return p.Iqfrz if held != dialect.thld_reversed else support
    return 0.0


@njit(cache=True)
def reec_a_commands(
    p, dialect, tables, x, memory, time: float, v: float, rest, told, power, rates
) -> tuple[float, float]:
    """Ipcmd and Iqcmd; write the rates of change of the states.

    tables (2, 8) : of the current limits. rest : p, q, v. told : departures of the references p, q,
    v from rest. power : P and Q delivered.
    """
    dip, v_f = is_dip(p, v), x[V_F]
    v_safe = max(v_f, LEAST_V)
    limit_q = min(limit_of_table(v_f, tables[0], p.Imax), p.Imax)
    limit_p = min(limit_of_table(v_f, tables[1], p.Imax), p.Imax)
    extra = injected(p, dialect, memory, time, dip, v_f, rest[2])
    ip_wanted = x[P_ORD] / v_safe
    if p.PQFLAG > 0.5:
        limit_p = _kept(p, memory, time, dip, limit_p)
        ip_cmd = clip(ip_wanted, 0.0, limit_p)
        limit_q = min(limit_q, np.sqrt(max(p.Imax**2 - ip_cmd**2, 0.0)))

    q_ref = rest[1] + told[1]
    if p.PFFLAG > 0.5:
        q_ref = x[P_F] * rest[1] / rest[0] if abs(rest[0]) > 1e-6 else 0.0
    q_ref = clip(q_ref, min(p.QMin, rest[1]), max(p.QMax, rest[1]))
    low, high = min(p.VMIN, rest[2]), max(p.VMAX, rest[2])
    q_error = q_ref - power[1]
    v_ref = clip(p.Kqp * q_error + x[Q_PI], low, high)
    if p.VFLAG < 0.5:
        v_ref = clip(rest[2] + told[2] + told[1], low, high)
    else:
        v_ref = clip(v_ref + told[2], low, high)
    v_error = v_ref - v_f
    if p.QFLAG > 0.5:
        basic = clip(p.Kvp * v_error + x[V_PI], -limit_q, limit_q)
    else:
        basic = x[IQ_LAG]
    iq_cmd = clip(basic + extra, -limit_q, limit_q)
    if p.PQFLAG <= 0.5:
        limit_p = min(limit_p, np.sqrt(max(p.Imax**2 - iq_cmd**2, 0.0)))
        limit_p = _kept(p, memory, time, dip, limit_p)
        ip_cmd = clip(ip_wanted, 0.0, limit_p)
    if dip:
        memory[IP_MAX] = limit_p

    rates[V_F] = lag_rate(v, v_f, p.Trv)
    rates[P_F] = lag_rate(power[0], x[P_F], p.Tp)
    rates[Q_PI] = rates[V_PI] = rates[IQ_LAG] = rates[P_ORD] = 0.0
    if not dip:
        rates[Q_PI] = integral_rate(q_error, p.Kqi, p.Kqp, x[Q_PI], low, high)
        rates[V_PI] = integral_rate(v_error, p.Kvi, p.Kvp, x[V_PI], -limit_q, limit_q)
        rates[IQ_LAG] = lag_rate(q_ref / v_safe, x[IQ_LAG], p.Tiq)
        p_ref = clip(rest[0] + told[0], min(p.PMIN, rest[0]), max(p.PMAX, rest[0]))
        unit = 1.0 / max(p.Tpord, 1e-3) if dialect.rate_over_tg else 1.0
        rates[P_ORD] = clip(lag_rate(p_ref, x[P_ORD], p.Tpord), p.dPmin * unit, p.dPmax * unit)
    return ip_cmd, iq_cmd


@njit(cache=True)
def _kept(p, memory, time: float, dip: bool, limit: float) -> float:
    """Ipmax: that of the dip for Thld2 behind it."""
    if not dip and time < memory[ENDED] + p.Thld2:
        return memory[IP_MAX]
    return limit


@njit(cache=True)
def remember(p, memory, time: float, v: float) -> None:
    """Note when a dip ended."""
    dip = is_dip(p, v)
    if memory[IN_DIP] > 0.5 and not dip:
        memory[ENDED] = time
    memory[IN_DIP] = 1.0 if dip else 0.0
