"""Reference inverters: the fixed benchmark and published grid-following parameter sets from 19 kVA to 600 MVA.

Each `source` names repository and file, says how values were converted and which ones the source does not give. No
value of a source was tuned. Of every source only what equations (2) to (7) contain is kept: delays, measurement
filters, active damping and DC links are left out, so these are inverters *with published values*, not copies.
Not listed, because without the parts left out they are unstable with both power controllers chosen below (kP = 0.02,
kI = 20 and kP = 0.005, kI = 10): the 2 MW and 1 kW inverters of Zhiqing-YANG/Model_Library_PLECS and the 10 kVA one of
Aalto-Electric-Drives/motulator.
"""

from collections.abc import Mapping
from math import pi, sqrt
from types import MappingProxyType

from ibrid.plants.gfl import GFLParameters, hertz
from ibrid.plants.published_forming import BEYOND
from ibrid.plants.reference import ReferenceInverter

OMEGA_60 = 2 * pi * 60
OMEGA_50 = 2 * pi * 50

PAPER_LIKE = ReferenceInverter(
    name="paper_like",
    parameters=GFLParameters(
        L_F=0.15,
        R_F=0.005,
        C_F=0.066,
        L_g=0.15,
        R_g=0.01,
        kP_pll=60.0,
        kI_pll=1400.0,
        omega_c_pll=hertz(500),
        kP_power=0.02,
        kI_power=20.0,
        kP_current=0.5,
        kI_current=0.04 * OMEGA_60,
    ),
    f0_hz=60.0,
    summary="the benchmark: LCL, PLL behind a 500 Hz low-pass, PQ control, current control",
    source="Chosen for this project; the structure of the paper with a PLL filter, the paper prints no parameters.",
)

# the source takes gains of the PLL in per unit of frequency: d theta/dt = omega_0 (kp v_q + ki integral v_q)
_SIENNA = "NREL-Sienna/PowerSimulationsDynamics.jl, test/data_tests/dynamic_test_data.jl"

SIENNA_GFL = ReferenceInverter(
    name="sienna_gfl",
    parameters=GFLParameters(
        L_F=0.009,
        R_F=0.016,
        C_F=2.5,
        L_g=0.002,
        R_g=0.003,
        kP_pll=2.0 * OMEGA_50,
        kI_pll=20.0 * OMEGA_50,
        omega_c_pll=1.32 * hertz(50),
        kP_power=2.0,
        kI_power=30.0,
        omega_c_power=0.132 * hertz(50),
        kP_current=0.37,
        kI_current=0.7,
    ),
    f0_hz=50.0,
    summary="2.75 MVA, 690 V, 50 Hz: LCL with a very large capacitor, filtered PLL, filtered p and q",
    source=(
        f"{_SIENNA}: filt_gfoll, reduced_pll, outer_control_gfoll, current_mode_inner, converter_low_power. "
        "Per unit in the source; PLL gains times omega_0. Nothing was chosen. C_F = 2.5 is the source's own "
        "value."
    ),
    s_base_va=2.75e6,
    v_base_v=690.0,
)

SIENNA_LCL = ReferenceInverter(
    name="sienna_lcl",
    parameters=GFLParameters(
        L_F=0.08,
        R_F=0.003,
        C_F=0.074,
        L_g=0.2,
        R_g=0.01,
        kP_pll=0.084 * OMEGA_50,
        kI_pll=4.69 * OMEGA_50,
        omega_c_pll=500.0,
        kP_power=0.005,
        kI_power=10.0,
        kP_current=1.27,
        kI_current=14.3,
    ),
    f0_hz=50.0,
    summary="2.75 MVA, 690 V, 50 Hz: LCL, filtered PLL, fast current control, lightly damped",
    source=(
        f"{_SIENNA}: filt, pll, current gains of inner_control, converter_low_power. Per unit in the source; "
        "PLL gains times omega_0. The source's device is grid-forming: its virtual machine and voltage loop are "
        "replaced by power control with kP = 0.005, kI = 10 1/s, which was chosen (kP = 0.02, kI = 20 is unstable "
        "here); feedforward 1 where the source has 0."
    ),
    s_base_va=2.75e6,
    v_base_v=690.0,
)

STING_100MVA = ReferenceInverter(
    name="sting_100mva",
    parameters=GFLParameters(
        L_F=0.07,
        R_F=0.002,
        C_F=0.01,
        L_g=0.08,
        R_g=0.003,
        kP_pll=100.0,
        kI_pll=2500.0,
        omega_c_pll=100.0,
        kP_power=0.1,
        kI_power=100.0,
        kP_current=0.05,
        kI_current=0.6,
        feedforward=0.75,
        L_decoupling=0.15,
    ),
    f0_hz=60.0,
    summary="100 MVA, 0.48 kV, 60 Hz: LCL with transformer, filtered PLL, feedforward 0.75",
    source=(
        "REAM-lab/STING, tests/emt_tests/test_gfli_16a.py and sting/generator/gfli_16a.py. Per unit in the "
        "source; both halves of the transformer make L_g, R_g; decoupling with x_f1 + x_f2 and feedforward "
        "0.75 as in the source. Left out: the 1 per-unit resistor in series with the capacitor. The source "
        "controls voltage, current and power at the bus, here they are those of equations (2) to (6). Nothing "
        "was chosen. With feedforward 1 it is unstable."
    ),
    s_base_va=100e6,
    v_base_v=480.0,
)

FENG_50KVA = ReferenceInverter(
    name="feng_50kva",
    parameters=GFLParameters(
        L_F=0.05,
        R_F=0.01,
        C_F=0.06,
        L_g=0.05,
        R_g=0.005,
        kP_pll=27.5,
        kI_pll=377.7,
        kP_power=0.1,
        kI_power=5.0,
        kP_current=0.3,
        kI_current=10.0,
        feedforward=0.5,
        L_decoupling=0.025,
    ),
    f0_hz=60.0,
    summary="50 kVA, 690 V, 60 Hz: LCL, PLL without filter, slow power control, feedforward and decoupling 0.5",
    source=(
        "VictorCFeng/Unified-Decentralized-Small-Signal-Stability-Criterion-for-Grid-Connected-Converters, "
        "SmallSignalModel/02GFL/GFL_compare.m and fun01_GFL_Small_Signal.m. Per unit in the source (the units "
        "Ohm, F, H in its comments are not used); feedforward and decoupling carry its factor kdq = 0.5, the "
        "resistive part of which is left out. The source has an LC filter: L_g = 0.05 and R_g = 0.005 were "
        "chosen. With feedforward 1 it is unstable."
    ),
    s_base_va=50e3,
    v_base_v=690.0,
)

KULEUVEN_600MVA = ReferenceInverter(
    name="kuleuven_600mva",
    parameters=GFLParameters(
        filter="L",
        L_F=0.08,
        R_F=0.0008,
        kP_pll=0.3978 * OMEGA_50,
        kI_pll=7.9577 * OMEGA_50,
        omega_c_pll=hertz(80),
        kP_power=0.01,
        kI_power=10.0,
        kP_current=0.254647908947033,
        kI_current=0.8,
    ),
    f0_hz=50.0,
    summary="600 MVA, 380 kV, 50 Hz wind farm converter: L filter, PLL behind an 80 Hz low-pass",
    source=(
        "Electa-Git/PowerImpedance.jl, examples/IEEE14bus_sweeps.jl (WF2) and "
        "src/Network/Components/converter/TLC.jl. Per unit in the source; PLL gains times omega_0, because "
        "its PLL counts frequency in per unit. Left out: first-order measurement filters of 10 krad/s on "
        "voltage and current. Nothing was chosen."
    ),
    s_base_va=600e6,
    v_base_v=380e3,
)

# base of the set below: the nominal current of the source, 40 A peak at 380 V
_TOUTI_V_PEAK = 380.0 * sqrt(2 / 3)
_TOUTI_S = 1.5 * _TOUTI_V_PEAK * 40.0
_TOUTI_Z = 380.0**2 / _TOUTI_S

TOUTI_19KVA = ReferenceInverter(
    name="touti_19kva",
    parameters=GFLParameters(
        filter="L",
        L_F=1e-3 * OMEGA_50 / _TOUTI_Z,
        R_F=0.3e-3 / _TOUTI_Z,
        kP_pll=1.2 * _TOUTI_V_PEAK,
        kI_pll=257.0 * _TOUTI_V_PEAK,
        kP_power=0.02,
        kI_power=20.0,
        kP_current=10.5 / _TOUTI_Z,
        kI_current=5900.0 / _TOUTI_Z,
    ),
    f0_hz=50.0,
    summary="19 kVA, 380 V, 50 Hz: L filter of 1 mH, fast PLL and current control",
    source=(
        "touti24/VSC-Admittance-Identification-Data-Driven-and-Physics-Informed-Modeling, "
        "matlab/model/params_VSC_I.m. SI in the source: Z_base = V_b^2/S_b with V_b = 380 V, S_b = 1.5 V_peak "
        "40 A = 18.6 kVA; PLL gains times V_peak. The source has no power control: kP = 0.02, kI = 20 1/s "
        "were chosen; feedforward 1 and decoupling are equation (6b)."
    ),
    s_base_va=_TOUTI_S,
    v_base_v=380.0,
)

PUBLISHED = (SIENNA_GFL, SIENNA_LCL, STING_100MVA, FENG_50KVA, KULEUVEN_600MVA, TOUTI_19KVA)

PLANTS: Mapping[str, ReferenceInverter] = MappingProxyType(
    {plant.name: plant for plant in (PAPER_LIKE, *PUBLISHED, *BEYOND)}
)
