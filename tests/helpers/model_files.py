"""Text of model files that a user might have, for tests that run them in another process."""

GOOD = """
import numpy as np


class Inverter:
    def __init__(self, conductance=0.8, offset=0.0):
        self.conductance = conductance
        self.offset = offset
        self.p_ref = 0.0
        self.q_ref = 0.0

    def step(self, t, v_abc):
        source = (self.p_ref - 1j * self.q_ref) * np.exp(2j * np.pi * 50 * t)
        return np.real(source * np.exp(-2j * np.pi * np.arange(3) / 3)) - self.conductance * v_abc + self.offset
"""
#: What a model does in its step from 0.05 s on.
BAD = """
import ctypes, os, sys, time
import numpy as np


class Inverter:
    p_ref = q_ref = 0.0

    def step(self, t, v_abc):
        if t > 0.05:
            {deed}
        return -0.5 * v_abc
"""
DEVICE = """
kind = "python"
file = "model.py:Inverter"
step_s = 5e-4
f0_hz = 50.0
{more}
[signals]
v = {{ unit = "pu" }}
i = {{ unit = "pu", sign = {sign} }}
p_ref = {{ name = "p_ref", unit = "pu" }}
q_ref = {{ name = "q_ref", unit = "pu" }}
"""
