"""The power stage around a controller: filter and averaged bridge in each phase, exact from sample
to sample.

Law, per unit, in each phase, with the bridge's voltage u held from sample to sample and the
terminal voltage v a straight line between them: L_f/omega_0 di_f/dt = u - R_f i_f - e; C/omega_0
dv_C/dt = i_f - i; e = v_C + R_C (i_f - i); L_g/omega_0 di/dt = e - R_g i - v. Without L_g the
capacitor with its R_C lies at the terminals, without C both inductances are one. The zero sequence
has no path.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.ranges import LIMITS, finite_number, require_in_range

#: Keys of [power_stage] -> value where they are not there, None where they must be. L, R, C:
#: filter. v_dc: of the DC source; half of it times a modulation index is the bridge's voltage.
#: limit: of |u| of a phase. delay_steps: of the computation. sensor_hz: corner of all sensors, 0
#: for none.
KEYS: Mapping[str, float | None] = {
    "L_f": None,
    "R_f": 0.0,
    "C": 0.0,
    "R_C": 0.0,
    "L_g": 0.0,
    "R_g": 0.0,
    "v_dc": None,
    "limit": 1e12,
    "delay_steps": 0.0,
    "sensor_hz": 0.0,
}
#: What sensors see, three phases each: terminal voltage, capacitor voltage, current at the
#: terminals, and of the bridge.
SENSED = ("v", "e", "i", "i_f")


@dataclass(frozen=True)
class PowerStage:
    """Per unit, inductances and capacitances as reactances and susceptances at the nominal
    frequency.
    """

    L_f: float
    R_f: float
    C: float
    R_C: float
    L_g: float
    R_g: float
    v_dc: float
    limit: float
    delay_steps: int
    sensor_hz: float

    def laws(self, omega_0: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A (n, n), B (n, 2) by u and v, of the states of a phase; C (4, n), D (4, 2) of what is
        sensed.
        """
        if self.C == 0:
            inductance, resistance = (self.L_f + self.L_g) / omega_0, self.R_f + self.R_g
            share = self.L_g / (self.L_f + self.L_g)
            a = np.array([[-resistance / inductance]])
            b = np.array([[1.0, -1.0]]) / inductance
            e = [self.R_g - share * resistance], [share, 1 - share]
            return (
                a,
                b,
                np.array([[0.0], e[0], [1.0], [1.0]]),
                np.array([[0.0, 1.0], e[1], [0.0, 0.0], [0.0, 0.0]]),
            )
        if self.L_g == 0:
            damped = 1 / self.R_C
            a = np.array([[-self.R_f / self.L_f, 0.0], [0.0, -damped / self.C]]) * omega_0
            b = np.array([[1 / self.L_f, -1 / self.L_f], [0.0, damped / self.C]]) * omega_0
            c = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, damped], [1.0, 0.0]])
            return a, b, c, np.array([[0.0, 1.0], [0.0, 1.0], [0.0, -damped], [0.0, 0.0]])
        e = np.array([self.R_C, 1.0, -self.R_C])
        rates = [
            (np.array([-self.R_f, 0.0, 0.0]) - e) / self.L_f,
            np.array([1.0, 0.0, -1.0]) / self.C,
            (np.array([0.0, 0.0, -self.R_g]) + e) / self.L_g,
        ]
        b = np.array([[1 / self.L_f, 0.0], [0.0, 0.0], [0.0, -1 / self.L_g]])
        sensed = np.array([np.zeros(3), e, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        return (
            np.array(rates) * omega_0,
            b * omega_0,
            sensed,
            np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        )

    def stepped(self, omega_0: float, step_s: float) -> tuple[np.ndarray, np.ndarray]:
        """(n, n) and (n, 3): the states after a step from those before, and from u, v before and v
        after it.
        """
        from scipy.linalg import expm  # which no process of a whole inverter needs

        a, b, _, _ = self.laws(omega_0)
        n = len(a)
        # u and v as states: u stands, v rises by its difference in the step
        whole = np.zeros((n + 3, n + 3))
        whole[:n, :n] = a
        whole[:n, n : n + 2] = b
        whole[n + 1, n + 2] = 1 / step_s
        moved = expm(whole * step_s)[:n]
        before = moved[:, n + 1] - moved[:, n + 2]
        return moved[:, :n], np.column_stack([moved[:, n], before, moved[:, n + 2]])


def stage_of(
    content: Mapping[str, Any], bases: tuple[float, float] | None, f0_hz: float, where: str
) -> PowerStage:
    """The power stage of a table. bases : impedance (ohm) and peak phase voltage (V) that are 1 per
    unit, for unit = "si".

    Raises IbridError for anything that is not as it must be.
    """
    known = ("unit", *KEYS)
    if unknown := [key for key in content if key not in known]:
        raise IbridError(f"{where} has {unknown[0]!r:.40}; {near(unknown[0], known)}")
    unit = content.get("unit", "pu")
    if unit not in ("pu", "si"):
        raise IbridError(f'unit of {where} must be "pu" or "si"; found {unit!r:.40}')
    if unit == "si" and bases is None:
        raise IbridError(
            f"{where} is in SI units, which need s_base_va and v_base_v; write both at the top"
        )
    impedance, voltage = (1.0, 1.0) if bases is None or unit == "pu" else bases
    reactive = 2 * pi * f0_hz if unit == "si" else 1.0
    factors = {"L_f": reactive / impedance, "L_g": reactive / impedance, "C": reactive * impedance}
    factors |= dict.fromkeys(("R_f", "R_C", "R_g"), 1 / impedance) | dict.fromkeys(
        ("v_dc", "limit"), 1 / voltage
    )
    values = {
        name: _number(content, name, where, usual) * factors.get(name, 1.0)
        for name, usual in KEYS.items()
    }
    steps = values.pop("delay_steps")
    if steps != int(steps) or steps > 1000:
        raise IbridError(
            f"delay_steps of {where} must be a whole number of steps, at most 1000; found {steps:g}"
        )
    stage = PowerStage(**values, delay_steps=int(steps))
    if stage.L_f <= 0 or stage.v_dc <= 0:
        raise IbridError(f"L_f and v_dc of {where} must be above 0")
    if stage.C > 0 and stage.L_g == 0 and stage.R_C == 0:
        raise IbridError(
            f"{where} has its capacitor at the terminals without resistance, which no voltage "
            "source can charge; give R_C or L_g"
        )
    if stage.C > 0 and stage.L_g == 0 and stage.R_g > 0:
        raise IbridError(
            f"R_g of {where} needs L_g, with which it lies in series behind the capacitor; give "
            "L_g too, or no R_g"
        )
    return stage


def _number(content: Mapping[str, Any], name: str, where: str, usual: float | None) -> float:
    number = finite_number(content.get(name, usual))
    if number is None or number < 0:
        found = "nothing" if name not in content else f"{content[name]!r:.40}"
        raise IbridError(f"{name} of {where} must be a number, 0 or more; found {found}")
    require_in_range(name if name in LIMITS else "value", number, f"{name} of {where}", IbridError)
    return number
