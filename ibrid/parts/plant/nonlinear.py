"""Effects that no linear block describes: they are found from sweeps at several injection
amplitudes.
"""

from ibrid.parts.editing.practice import Effect, no_moves

PLL_DEADBAND = Effect(
    id="pll_deadband",
    law="SRF_PLL takes 0 for |e_q| up to a width, e_q less the width beyond",
    places="before the PLL",
    signature="below the PLL's bandwidth; the gain before the PLL is real, the same at every "
    "frequency and operating point, and "
    "rises from 0 to 1 with the amplitude of e_q: 1 - 2/pi (asin k + k sqrt(1 - k^2)), k = "
    "width/amplitude",
    confused_with=("pll_missing",),
    told_apart_by="sweeps at three amplitudes, the smallest near the width: a PLL that is missing "
    "stays so at all of them",
    moves=no_moves,
)

CURRENT_LIMIT = Effect(
    id="current_limit",
    law="i_ref shortened to the limit where it is longer, its direction kept; or one axis clipped",
    places="behind the outer loops: the magnitude of the current reference, its d axis, its q axis",
    signature="nothing until amplitude and operating current together reach the limit; then the "
    "gain along the operating current "
    "falls with the amplitude, first at low frequencies, and the loops of p and q raise the mean "
    "of the reference",
    confused_with=("power_loop_missing", "reactive_loop_missing"),
    told_apart_by="an operating point at half the current, where the same amplitude does not reach "
    "the limit",
    moves=no_moves,
)

NONLINEAR: tuple[Effect, ...] = (PLL_DEADBAND, CURRENT_LIMIT)
