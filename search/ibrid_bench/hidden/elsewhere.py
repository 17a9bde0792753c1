"""What is hidden but is no effect of the catalogue: foreign blocks, and sweeps written in another
convention than stated.
"""

from math import pi

from ibrid_bench.hidden.declaration import PRESENT, HiddenEffect, Strength, always
from ibrid_bench.hidden.effects import FRAME_MISALIGNMENT

_HZ = 2 * pi
_UNNAMED = ("located-unnamed", "unexplained")
_WRITTEN = ("data-convention",)
_LARGER = Strength((1.45, 1.55), (1.7, 2.0), (2.9, 3.1))
_SMALLER = Strength((0.65, 0.69), (0.5, 0.6), (0.32, 0.34))

#: Blocks that no entry of the catalogue describes.
FOREIGN: tuple[HiddenEffect, ...] = (
    HiddenEffect(
        "lead_lag",
        "current_loop",
        "add",
        {
            "omega_zero": always(_HZ * 100, _HZ * 200),
            "omega_pole": Strength((1.3, 1.5), (2.0, 3.0), (4.0, 6.0), times="omega_zero"),
        },
        verdicts=_UNNAMED,
    ),
    HiddenEffect(
        "comb",
        "current_loop",
        "add",
        {
            "comb_gain": Strength((0.05, 0.1), (0.2, 0.3), (0.4, 0.6)),
            "comb_delay": always(1 / 360, 1 / 300),
        },
        verdicts=_UNNAMED,
    ),
    HiddenEffect(
        "feedforward_notch",
        "feedforward",
        "add",
        {
            "omega_n_ff": always(_HZ * 250, _HZ * 700),
            "Q_ff": Strength((4, 6), (1.2, 2.5), (0.5, 0.8)),
        },
        base={"k_ff": PRESENT},
        verdicts=_UNNAMED,
    ),
    HiddenEffect(
        "passive_load",
        "pcc",
        "add",
        {
            "load_R": always(0.1, 0.3),
            "load_L": Strength((3.0, 5.0), (0.5, 1.0), (0.2, 0.3)),
            "load_C": Strength((0.005, 0.01), (0.03, 0.06), (0.1, 0.15)),
        },
        verdicts=_UNNAMED,
    ),
)

#: A sweep that is not what its header says.
CONVENTIONS: tuple[HiddenEffect, ...] = (
    HiddenEffect("current_sign", "in", "add", measurement={"current": "in"}, verdicts=_WRITTEN),
    HiddenEffect("q_axis", "lags", "add", measurement={"q_axis": "lags"}, verdicts=_WRITTEN),
    HiddenEffect(
        "per_unit_base", "larger", "add", measurement={"factor": _LARGER}, verdicts=_WRITTEN
    ),
    HiddenEffect(
        "per_unit_base", "smaller", "add", measurement={"factor": _SMALLER}, verdicts=_WRITTEN
    ),
    HiddenEffect(
        "operating_point", "swapped", "add", measurement={"swapped": True}, verdicts=_WRITTEN
    ),
    FRAME_MISALIGNMENT,
)
