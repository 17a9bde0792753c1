"""Families of edits of one component: a filter, delay or path added, a block exchanged for another or taken away."""

from search.proposers.moves.blocks import exchange, removals
from search.proposers.moves.family import Family, where_missing, where_present
from search.proposers.moves.paths import damping, decoupled, decoupling, fed_forward, feedforward, frequency_droop
from search.proposers.moves.shapers import (
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

_FEEDFORWARD, _PHASE_LOCKED = (0.3, 1.0, 1.0, 0.5), (0.3, 1.0, 0.5, 0.1)

COMPONENTS = (
    Family("voltage feedforward", "module", _FEEDFORWARD, 10.0, where_missing(feedforward, fed_forward)),
    Family("other feedforward", "module", _FEEDFORWARD, 0.5, where_present(feedforward, fed_forward)),
    Family("decoupling", "module", (0.5, 1.0, 0.7, 0.2), 10.0, where_missing(decoupling, decoupled)),
    Family("other decoupling", "module", (0.5, 1.0, 0.7, 0.2), 0.3, where_present(decoupling, decoupled)),
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
    Family("feedback and damping", "module", (0.3, 0.7, 1.0, 0.7), 0.7, damping),
    Family("frequency droop", "module", (1.0, 0.5, 0.1, 0.0), 0.4, frequency_droop),
    Family("exchange", "module", (0.5, 0.5, 0.5, 0.5), 3.0, exchange),
    Family("one block less", "module", (0.3, 0.3, 0.3, 0.3), 0.3, removals),
    Family("any wire", "module", (0.3, 0.3, 0.3, 0.3), 0.2, any_wire),
)
