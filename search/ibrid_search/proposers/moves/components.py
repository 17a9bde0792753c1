"""Families of edits of one component: a filter, delay or path added, a block exchanged for another or taken away."""

from ibrid_search.proposers.moves.blocks import coupling_frequency, exchange, removals
from ibrid_search.proposers.moves.damping import (
    active_damping,
    damped,
    feedback,
    virtual_impedance,
    with_virtual_impedance,
)
from ibrid_search.proposers.moves.family import Family, View, where_missing, where_present
from ibrid_search.proposers.moves.paths import (
    decoupled,
    decoupling,
    fed_forward,
    feedforward,
    frequency_droop,
    voltage_decoupled,
    voltage_decoupling,
)
from ibrid_search.proposers.moves.shapers import (
    any_wire,
    command_delay,
    current_filter,
    delayed,
    filtered_powers,
    filtered_synchronisation,
    power_filters,
    synchronisation_filter,
    voltage_filter,
)
from ibrid_search.proposers.moves.synchronisation import grid_forming


def _virtual_or_following(view: View) -> bool:
    return with_virtual_impedance(view) or not grid_forming(view)


_FEEDFORWARD, _PHASE_LOCKED = (0.3, 1.0, 1.0, 0.5), (0.3, 1.0, 0.5, 0.1)
_COUPLING, _IMPEDANCE, _RESONANCE = (0.5, 1.0, 0.7, 0.2), (1.0, 1.0, 0.5, 0.1), (0.1, 0.5, 1.0, 1.0)

COMPONENTS = (
    Family("voltage feedforward", "module", _FEEDFORWARD, 10.0, where_missing(feedforward, fed_forward)),
    Family("other feedforward", "module", _FEEDFORWARD, 0.5, where_present(feedforward, fed_forward)),
    Family("decoupling", "module", _COUPLING, 10.0, where_missing(decoupling, decoupled)),
    Family("other decoupling", "module", _COUPLING, 0.3, where_present(decoupling, decoupled)),
    Family("frequency of a coupling", "module", _COUPLING, 4.0, coupling_frequency),
    Family("voltage decoupling", "module", _COUPLING, 8.0, where_missing(voltage_decoupling, voltage_decoupled)),
    Family("other voltage decoupling", "module", _COUPLING, 0.3, where_present(voltage_decoupling, voltage_decoupled)),
    Family("virtual impedance", "module", _IMPEDANCE, 4.0, where_missing(virtual_impedance, _virtual_or_following)),
    Family(
        "other virtual impedance", "module", _IMPEDANCE, 0.2, where_present(virtual_impedance, _virtual_or_following)
    ),
    Family("active damping", "module", _RESONANCE, 0.3, where_missing(active_damping, damped), if_gross=1.5),
    Family("command delay", "module", (0.0, 0.3, 1.0, 1.0), 5.0, where_missing(command_delay, delayed)),
    Family("other delay", "module", (0.0, 0.3, 1.0, 1.0), 0.3, where_present(command_delay, delayed)),
    Family("PLL filter", "module", _PHASE_LOCKED, 5.0, where_missing(synchronisation_filter, filtered_synchronisation)),
    Family(
        "other PLL filter",
        "module",
        _PHASE_LOCKED,
        0.3,
        where_present(synchronisation_filter, filtered_synchronisation),
    ),
    Family("power filters", "module", (0.5, 1.0, 0.3, 0.1), 4.0, where_missing(power_filters, filtered_powers)),
    Family("other power filters", "module", (0.5, 1.0, 0.3, 0.1), 0.5, where_present(power_filters, filtered_powers)),
    Family("current filter", "module", (0.1, 0.5, 1.0, 0.7), 1.0, current_filter),
    Family("voltage filter", "module", (0.1, 0.5, 1.0, 0.7), 1.0, voltage_filter),
    Family("other feedback", "module", (0.3, 0.7, 1.0, 0.7), 0.7, feedback),
    Family("frequency droop", "module", (1.0, 0.5, 0.1, 0.0), 0.4, frequency_droop),
    Family("exchange", "module", (0.5, 0.5, 0.5, 0.5), 3.0, exchange),
    Family("one block less", "module", (0.3, 0.3, 0.3, 0.3), 0.3, removals),
    Family("any wire", "module", (0.3, 0.3, 0.3, 0.3), 0.2, any_wire),
)
