"""Families of structural edits: the filter, the synchronisation, the control loops, each added or replaced whole."""

from search.proposers.moves.control_loops import (
    current_loop,
    loop_removals,
    missing_axis,
    power_loops,
    voltage_loop,
    voltage_magnitude,
)
from search.proposers.moves.family import Family, View, where_missing, where_present
from search.proposers.moves.plant import plants
from search.proposers.moves.synchronisation import no_synchronisation, synchronisation


def _lcl(view: View) -> bool:
    return view.roles.lcl


def _synchronised(view: View) -> bool:
    return view.roles.frequency is not None


def _outer(view: View) -> bool:
    return bool(view.roles.outer)


SUB_LOOPS = (
    Family("filter", "structural", (0.2, 0.4, 1.0, 1.0), 9.0, where_missing(plants, _lcl)),
    Family("other filter", "structural", (0.2, 0.4, 1.0, 1.0), 0.5, where_present(plants, _lcl)),
    Family(
        "synchronisation", "structural", (1.0, 1.0, 0.5, 0.3), 9.0, where_missing(synchronisation, _synchronised), True
    ),
    Family(
        "other synchronisation", "structural", (1.0, 1.0, 0.5, 0.1), 0.5, where_present(synchronisation, _synchronised)
    ),
    Family("no synchronisation", "structural", (0.5, 0.5, 0.2, 0.1), 0.1, no_synchronisation),
    Family("current loop", "structural", (0.5, 1.0, 1.0, 0.5), 9.0, current_loop, True),
    Family("voltage loop", "structural", (1.0, 1.0, 0.5, 0.1), 0.5, voltage_loop),
    Family("power loops", "structural", (1.0, 1.0, 0.3, 0.3), 9.0, where_missing(power_loops, _outer), True),
    Family("missing axis", "structural", (1.0, 1.0, 0.3, 0.3), 6.0, missing_axis),
    Family("other power loops", "structural", (1.0, 1.0, 0.3, 0.1), 0.3, where_present(power_loops, _outer)),
    Family("voltage magnitude", "structural", (1.0, 0.7, 0.2, 0.1), 0.5, voltage_magnitude),
    Family("one loop less", "structural", (0.5, 0.5, 0.3, 0.2), 0.3, loop_removals),
)
