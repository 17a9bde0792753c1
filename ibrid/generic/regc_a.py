"""REGC_A: the converter of a renewable generator as a current source.

Law, per unit, on the terminal phasor: Ip' = (Ipcmd - Ip) / Tg, rising by at most Rrpwr and up to
LVPL(Vf); Vf' = (V - Vf) / Tfltr; the network takes Ip g(V), with g from 0 at Lvpnt0 to 1 at
Lvpnt1. Iq' = (Iqcmd - Iq) / Tg, rising by at most Iqrmax where Q at rest is positive, falling by at
most Iqrmin where it is negative; the network takes max(Iolim, Iq - Khv max(0, V - Volim)). Q = V Iq
is positive where reactive power is delivered.

Reference: WECC, Solar Plant Dynamic Modeling Guidelines; ESIG, REGC_A model specification.
"""

from ibrid.fit.just_in_time import njit
from ibrid.generic.block import Constant, Flag, LawBlock
from ibrid.generic.laws import clip, lag_rate

REGC_A = LawBlock(
    "REGC_A",
    "REGCA1",
    (Flag("Lvplsw", 1, (0, 1), "low voltage power logic: 1 on"),),
    (
        Constant("Tg", 0.02, 0.005, 0.2, "lag of the converter, s", "fitted"),
        Constant("Rrpwr", 10.0, 0.1, 20.0, "rate at which Ip recovers, per unit per s", "fitted"),
        Constant("Brkpt", 0.9, 0.5, 1.0, "voltage above which LVPL is free", "fitted"),
        Constant("Zerox", 0.5, 0.0, 0.8, "voltage below which LVPL is zero", "fitted"),
        Constant("Lvpl1", 1.22, 0.5, 1.5, "LVPL at Brkpt", "fitted"),
        Constant("Volim", 1.2, 1.05, 1.5, "voltage above which Iq is reduced"),
        Constant("Lvpnt1", 0.8, 0.2, 1.0, "voltage above which Ip is whole", "fitted"),
        Constant("Lvpnt0", 0.4, 0.0, 0.6, "voltage below which Ip is none", "fitted"),
        Constant("Iolim", -1.3, -2.0, 0.0, "lowest Iq behind the voltage limit"),
        Constant("Tfltr", 0.02, 0.005, 0.2, "lag of the voltage of LVPL, s"),
        Constant("Khv", 0.7, 0.0, 5.0, "gain of the voltage limit"),
        Constant("Iqrmax", 999.0, 0.1, 9999.0, "rate at which Iq rises, per unit per s"),
        Constant("Iqrmin", -999.0, -9999.0, -0.1, "rate at which Iq falls, per unit per s"),
        Constant("Accel", 0.7, 0.0, 1.0, "of the network solution alone"),
    ),
    "WECC REGC_A",
)
#: Places of the states.
IP, IQ, V_LVPL = 0, 1, 2


@njit(cache=True)
def regc_a_currents(p, ip: float, iq: float, v: float) -> tuple[float, float]:
    """What the network takes, Ip and Iq."""
    span = max(p.Lvpnt1 - p.Lvpnt0, 1e-6)
    gain = clip((v - p.Lvpnt0) / span, 0.0, 1.0)
    return ip * gain, max(p.Iolim, iq - p.Khv * max(0.0, v - p.Volim))


@njit(cache=True)
def lvpl(p, v: float, capped: bool) -> float:
    """The largest Ip; `capped` : whether Lvpl1 is the limit above Brkpt, too."""
    if v < p.Zerox:
        return 0.0
    if v > p.Brkpt:
        return p.Lvpl1 if capped else 1e9
    return p.Lvpl1 * (v - p.Zerox) / max(p.Brkpt - p.Zerox, 1e-6)


@njit(cache=True)
def regc_a_rates(p, dialect, x, v: float, ip_cmd: float, iq_cmd: float, q_rest: float, rates):
    """Write the rates of change of Ip, Iq and Vf."""
    unit = 1.0 / max(p.Tg, 1e-3) if dialect.rate_over_tg else 1.0
    most = lvpl(p, x[V_LVPL], dialect.lvpl_capped) if p.Lvplsw else 1e9
    rate = min(lag_rate(min(ip_cmd, most), x[IP], p.Tg), p.Rrpwr * unit)
    if x[IP] > most:  # the limit falls with the voltage
        rate = min(rate, (most - x[IP]) / 1e-3)
    rates[IP] = rate
    rate = lag_rate(iq_cmd, x[IQ], p.Tg)
    if q_rest > 0.0 and p.Iqrmax > 0.0:
        rate = min(rate, p.Iqrmax * unit)
    if q_rest < 0.0 and p.Iqrmin < 0.0:
        rate = max(rate, p.Iqrmin * unit)
    rates[IQ] = rate
    rates[V_LVPL] = lag_rate(v, x[V_LVPL], p.Tfltr)
