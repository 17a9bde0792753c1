"""Reference inverters beyond power-controlled grid-following ones: published parameters, one inverter of each kind.

As in `published.py`, each `source` says where values come from, how they were converted, what is left out and what was
chosen; no value of a source was tuned. Their names are those of the textbook diagrams and of the shipped sweeps.
"""

from math import pi, sqrt
from typing import Any

from ibrid.plants.gfl import GFLParameters, hertz
from ibrid.plants.gfm import DroopParameters, OscillatorParameters, VSMParameters
from ibrid.plants.hybrid import HybridParameters
from ibrid.plants.parallel import ParallelParameters
from ibrid.plants.reference import ReferenceInverter

OMEGA_50 = 2 * pi * 50
_SIENNA = "NREL-Sienna/PowerSimulationsDynamics.jl, test/data_tests/dynamic_test_data.jl"
_SIENNA_BASE: dict[str, Any] = {"f0_hz": 50.0, "s_base_va": 2.75e6, "v_base_v": 690.0}
_SIENNA_FILTER = {"L_F": 0.08, "R_F": 0.003, "C_F": 0.074, "L_g": 0.2, "R_g": 0.01}
_SIENNA_CASCADE = {
    "kP_voltage": 0.59,
    "kI_voltage": 736.0,
    "kP_current": 1.27,
    "kI_current": 14.3,
    "k_damping": 0.2,
    "omega_damping": 50.0,
}
_SIENNA_PLL = {"kP_pll": 0.084 * OMEGA_50, "kI_pll": 4.69 * OMEGA_50}

_L_FILTER = GFLParameters(
    filter="L",
    L_F=0.08,
    R_F=0.0008,
    kP_pll=0.397887357729738 * OMEGA_50,
    kI_pll=7.957747154594767 * OMEGA_50,
    kP_power=0.04,
    kI_power=40.0,
    kP_current=0.254647908947033,
    kI_current=0.8,
)
GFL_L_FILTER = ReferenceInverter(
    name="gfl_l_filter",
    parameters=_L_FILTER,
    f0_hz=50.0,
    summary="100 MVA, 220 kV, 50 Hz: grid-following behind an L filter",
    source=(
        "Electa-Git/PowerImpedance.jl, test/power_flow_test.jl (TLC1) and src/Network/Components/converter/TLC.jl. Per "
        "unit in the source; PLL gains times omega_0, because its PLL counts frequency in per unit. Left out: delay of "
        "200 us, second-order filters of 80 Hz before the PLL and of 5 krad/s on voltage and current, frequency support. "
        "Nothing was chosen."
    ),
    s_base_va=100e6,
    v_base_v=220e3,
)

_DROOP = DroopParameters(
    **_SIENNA_FILTER,
    **_SIENNA_CASCADE,
    X_virtual=0.2,
    m_p=0.05 * OMEGA_50,
    omega_p=hertz(5),
    m_q=0.2,
    omega_q=1000.0,
)
GFM_DROOP = ReferenceInverter(
    name="gfm_droop",
    parameters=_DROOP,
    summary="2.75 MVA, 690 V, 50 Hz: grid-forming, droops on p and q, virtual reactance, cascade",
    source=(
        f"{_SIENNA}: filt, outer_control_droop, inner_control, converter_low_power. Per unit in the source; the droop of "
        "p times omega_0. Nothing was left out and nothing was chosen."
    ),
    **_SIENNA_BASE,
)

GFM_VSM = ReferenceInverter(
    name="gfm_vsm",
    parameters=VSMParameters(
        **_SIENNA_FILTER,
        **_SIENNA_CASCADE,
        **_SIENNA_PLL,
        X_virtual=0.2,
        T_a=2.0,
        k_d=400.0,
        k_w=20.0,
        m_q=0.2,
        omega_q=1000.0,
    ),
    summary="2.75 MVA, 690 V, 50 Hz: virtual synchronous machine damped by a PLL, droop on q, cascade",
    source=(
        f"{_SIENNA}: filt, outer_control, inner_control, pll, converter_low_power; the machine of S. D'Arco, J. A. Suul "
        "and O. B. Fosso, EPSR 122 (2015). Per unit in the source; PLL gains times omega_0. Left out: the 500 rad/s "
        "low-pass and the arctangent of the PLL, which here sees e_q. Nothing was chosen."
    ),
    **_SIENNA_BASE,
)

GFM_DVOC = ReferenceInverter(
    name="gfm_dvoc",
    parameters=OscillatorParameters(
        L_F=0.0196,
        R_F=0.0139,
        C_F=0.1086,
        L_g=0.0196,
        R_g=0.0139,
        **_SIENNA_CASCADE,
        eta=0.0033 * OMEGA_50,
        kappa=pi / 4,
        alpha=0.0796 * OMEGA_50,
    ),
    summary="2.75 MVA, 690 V, 50 Hz: dispatchable virtual oscillator, cascade",
    source=(
        f"{_SIENNA}: filt_voc, outer_voc, inner_control, converter_low_power. Per unit in the source; k1 and k2 times "
        "omega_0. Left out: the virtual reactance of 0.2. The set-points are those of the operating point; nothing else "
        "was chosen."
    ),
    **_SIENNA_BASE,
)

# base of the set below: 2 MVA at 550 V
_YANG_S, _YANG_V = 2e6, 550.0
_YANG_Z = _YANG_V**2 / _YANG_S
_YANG_PEAK = sqrt(2 / 3) * _YANG_V
_YANG_I = _YANG_S / (1.5 * _YANG_PEAK)
_YANG_V_DC = 1200.0

GFL_DC_LINK = ReferenceInverter(
    name="gfl_dc_link",
    parameters=GFLParameters(
        L_F=120e-6 * OMEGA_50 / _YANG_Z,
        R_F=1e-3 / _YANG_Z,
        C_F=1e-3 * OMEGA_50 * _YANG_Z,
        L_g=40e-6 * OMEGA_50 / _YANG_Z,
        R_g=1e-3 / _YANG_Z,
        kP_pll=0.36 * _YANG_PEAK,
        kI_pll=40.0 * _YANG_PEAK,
        kP_current=0.23 / _YANG_Z,
        kI_current=28.0 / _YANG_Z,
        k_damping=0.05 / _YANG_Z,
        p_loop="dc_link",
        q_loop="voltage",
        C_dc=15e-3 * _YANG_V_DC**2 / _YANG_S,
        kP_dc=3.6 * _YANG_V_DC / _YANG_I,
        kI_dc=239.0 * _YANG_V_DC / _YANG_I,
        kP_ac=0.1,
        kI_ac=50.0,
    ),
    f0_hz=50.0,
    summary="2 MVA, 550 V, 50 Hz: grid-following, controls its DC link and the AC voltage, active damping",
    source=(
        "Zhiqing-YANG/Model_Library_PLECS, 02_INV_2L/02_Impedance_Model/01_IM_INV_2MW/01_IM_SM_INV_2L_ACC_PLL_DVC/System/"
        "Def_Inverter.m and Def_Control.m. SI in the source: Z_base = V_b^2/S_b with 550 V and 2 MVA (chosen), V_dc = "
        "1200 V; PLL gains times V_peak, gains of the DC link times V_dc/I_peak. Left out: delay of 250 us and low-pass "
        "of 3 kHz in the feedforward. The source has no AC-voltage control: kP = 0.1, kI = 50 1/s were chosen."
    ),
    s_base_va=_YANG_S,
    v_base_v=_YANG_V,
)

HYBRID_GFL_GFM = ReferenceInverter(
    name="hybrid_gfl_gfm",
    parameters=HybridParameters(
        **_SIENNA_FILTER,
        **_SIENNA_PLL,
        weight=0.5,
        m_p=0.05 * OMEGA_50,
        omega_c_power=0.132 * hertz(50),
        kP_power=2.0,
        kI_power=30.0,
        kP_current=1.27,
        kI_current=14.3,
    ),
    summary="2.75 MVA, 690 V, 50 Hz: PLL and droop blended half and half, power and current control",
    source=(
        f"{_SIENNA}: filt, pll, inner_control (its current control), outer_control_droop (Rp), outer_control_gfoll, "
        "converter_low_power. Per unit in the source; PLL gains and droop times omega_0. The source has no such device: the "
        "structure and its weight of 0.5 were chosen; left out is the 500 rad/s low-pass of the PLL."
    ),
    **_SIENNA_BASE,
)

PARALLEL_GFL_GFM = ReferenceInverter(
    name="parallel_gfl_gfm",
    parameters=ParallelParameters(
        following=_L_FILTER,
        forming=_DROOP,
        share_p=0.6,
        share_q=0.3,
    ),
    f0_hz=50.0,
    summary="gfl_l_filter and gfm_droop behind one PCC, the first with 60 % of p and 30 % of q",
    source=(
        "gfl_l_filter and gfm_droop, both in per unit on one base, as if each alone were rated at it; p and q are those at "
        "the PCC, of both. The shares of 0.6 and 0.3 were chosen."
    ),
)

BEYOND = (GFL_L_FILTER, GFL_DC_LINK, GFM_DROOP, GFM_VSM, GFM_DVOC, HYBRID_GFL_GFM, PARALLEL_GFL_GFM)
