"""Several files of one inverter as one sweep: most formats hold a single operating point each."""

from collections.abc import Sequence
from dataclasses import replace

from ibrid.errors import SweepError
from ibrid.measurement.sweep import Sweep


def merge(sweeps: Sequence[Sweep]) -> Sweep:
    """One sweep with the operating points of all of them (name them with op= when reading).

    Raises SweepError when there is none, f0, power node or bases differ, or two operating points share a name.
    """
    if not sweeps:
        raise SweepError("merge must get at least one sweep; found none.")
    first = sweeps[0]
    for other in sweeps[1:]:
        for field in ("f0_hz", "power_node", "s_base_va", "v_base_v", "sampling_hz"):
            ours, theirs = getattr(first, field), getattr(other, field)
            if ours != theirs:
                raise SweepError(
                    f"sweeps of one inverter must agree on {field}; found {ours} in {first.source} and {theirs} in "
                    f"{other.source}."
                )
    return replace(
        first,
        points=tuple(point for sweep in sweeps for point in sweep.points),
        notes=tuple(dict.fromkeys(note for sweep in sweeps for note in sweep.notes)),
        source=", ".join(dict.fromkeys(sweep.source for sweep in sweeps if sweep.source)),
    )
