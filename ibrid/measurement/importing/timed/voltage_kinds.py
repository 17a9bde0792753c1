"""Which voltage a size in V is, line to line or of a phase, rms or peak: as its unit or name says,
else as its size at the beginning shows beside the base.
"""

from collections.abc import Set

import numpy as np

from ibrid.errors import SweepError

#: What a voltage of 1 per unit is, as a part of v_base_v.
KINDS = {
    "line to line, rms": 1.0,
    "line to line, peak": np.sqrt(2),
    "of a phase, rms": 1 / np.sqrt(3),
    "of a phase, peak": np.sqrt(2 / 3),
}
#: Words of a unit or name -> what the kind of its voltage must hold, and must not.
_SAID = {
    "line": ("line", "of a phase"),
    "phase": ("of a phase", "line"),
    "peak": ("peak", "rms"),
    "rms": ("rms", "peak"),
}
#: How near the voltage must be to one of them, as a part.
_NEAR = 0.12


def kind_of_voltage(
    values: np.ndarray, counted: Set[str], v_base_v: float, called: str, column: str
) -> tuple[str, float]:
    """Tell of which kind a voltage (n,) in V is, and what 1 per unit of it is in V.

    counted : what its unit or name says of it, of "rms", "peak", "line" and "phase". called : what
    it is, for sentences. column : how its unit is said, such as `--channels v=2`, before the
    brackets.

    Raises SweepError where it fits no kind beside the base, or two.
    """
    size = float(np.median(np.abs(values[: max(len(values) // 20, 8)]))) / v_base_v
    possible = [
        kind
        for kind in KINDS
        if all(_SAID[word][0] in kind and _SAID[word][1] not in kind for word in counted)
        and (kind != "line to line, peak" or {"line", "peak"} <= counted)
    ]
    fits = sorted(
        (kind for kind in possible if abs(size / KINDS[kind] - 1) < _NEAR),
        key=lambda kind: abs(np.log(size / KINDS[kind])),
    )
    named = possible if len(possible) == 1 else []
    if len(fits) > 1:
        near = " or ".join(f"{kind} at {size / KINDS[kind]:.3g} per unit" for kind in fits)
        raise SweepError(
            f"{called} begins at {size * v_base_v:.4g} V, which may be {near}; say its "
            f"unit: {column}[V_LL], [V_LN] or [V_peak]."
        )
    chosen = (named or fits)[:1]
    if not chosen:
        raise SweepError(
            f"{called} begins at {size * v_base_v:.4g} V, which is neither {v_base_v:g} V "
            "between the phases nor "
            f"{v_base_v / np.sqrt(3):.4g} V of one nor a peak of these; check --base, or say its "
            f"unit: {column}[kV_LL], [kV_LN] or [kV_peak]."
        )
    return chosen[0], KINDS[chosen[0]] * v_base_v
