"""Grid-following inverter: LCL filter, control sampled at 10 kHz that acts one period later."""

import numpy as np
from scipy.linalg import expm

OMEGA_0 = 2 * np.pi * 50.0
L_F, R_F, C, L_G, R_G = 0.10, 0.005, 0.04, 0.06, 0.003
T = 1e-4
ALPHA = 2 / 3 * np.exp(1j * np.array([0.0, 2.0, 4.0]) * np.pi / 3)


def _laws():
    """Exact steps of [i_f, e, i_g] for a constant u and a ramp of v."""
    a = OMEGA_0 * np.array(
        [[-R_F / L_F, -1 / L_F, 0], [1 / C, 0, -1 / C], [0, 1 / L_G, -R_G / L_G]]
    )
    b = OMEGA_0 * np.array([[1 / L_F, 0], [0, 0], [0, -1 / L_G]])
    block = np.zeros((6, 6))
    block[:3, :3] = a
    block[:3, 3] = b[:, 0]
    block[:3, 4] = b[:, 1]
    block[4, 5] = 1 / T
    step = expm(block * T)
    return step[:3, :3], step[:3, 3], step[:3, 4], step[:3, 5]


class Inverter:
    p_ref = 0.0
    q_ref = 0.0

    def __init__(self):
        self.a, self.b_u, self.b_v, self.b_ramp = _laws()
        self.x = None
        self.u = self.u_next = 0j

    def step(self, t, v_abc):
        v = complex(ALPHA @ v_abc)
        if self.x is None:
            self.x = np.array([0j, v, 0j])
            self.v = self.u = self.u_next = v
            self.theta = np.angle(v)
            self.pll = 0.0
            self.of_p = self.of_q = 0.0
            self.of_i = 0j
        else:
            self.x = self.a @ self.x + self.b_u * self.u + self.b_v * self.v
            self.x = self.x + self.b_ramp * (v - self.v)
            self.v = v
        i_f, e, i_g = self.x
        turn = np.exp(-1j * self.theta)
        e_dq = e * turn
        i_dq = i_f * turn
        g_dq = i_g * turn
        # phase-locked loop
        error = e_dq.imag
        self.pll += T * 900.0 * error
        omega = OMEGA_0 + 60.0 * error + self.pll
        # powers at the capacitor
        s = e_dq * g_dq.conjugate()
        e_p, e_q = self.p_ref - s.real, self.q_ref - s.imag
        self.of_p += T * 20.0 * e_p
        self.of_q += T * 20.0 * e_q
        i_ref = (0.2 * e_p + self.of_p) - 1j * (0.2 * e_q + self.of_q)
        # converter current
        e_i = i_ref - i_dq
        self.of_i += T * 60.0 * e_i
        u_dq = 0.5 * e_i + self.of_i + 1j * omega / OMEGA_0 * L_F * i_dq + e_dq
        self.u, self.u_next = self.u_next, u_dq * np.exp(1j * self.theta)
        self.theta += T * omega
        return np.real(i_g * np.exp(-1j * np.array([0.0, 2.0, 4.0]) * np.pi / 3))
