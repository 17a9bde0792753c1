"""Families of structural edits: the filter, the synchronisation, the control loops, each added or replaced whole."""

from ibrid_search.proposers.moves.control_loops import current_loop, loop_removals, voltage_loop
from ibrid_search.proposers.moves.family import Family, View, where_missing, where_present
from ibrid_search.proposers.moves.outer_loops import (
    ac_voltage_loop,
    dc_voltage_loop,
    missing_axis,
    power_loops,
    voltage_droop,
    voltage_given,
)
from ibrid_search.proposers.moves.plant import plants
from ibrid_search.proposers.moves.second_device import no_second_device, second_device
from ibrid_search.proposers.moves.synchronisation import (
    blend,
    frequency_damping,
    grid_forming,
    no_synchronisation,
    synchronisation,
)


def _lcl(view: View) -> bool:
    return view.roles.lcl


def _synchronised(view: View) -> bool:
    return view.roles.frequency is not None


def _outer(view: View) -> bool:
    return bool(view.roles.outer) or view.roles.voltage_loop is not None or grid_forming(view)


def _forming_alone(view: View) -> bool:
    return grid_forming(view) and not view.roles.outer


def _forming_beside(view: View) -> bool:
    return grid_forming(view) and bool(view.roles.outer)


def _forming_or_lcl(view: View) -> bool:
    return view.roles.lcl or grid_forming(view)


def _following_or_lcl(view: View) -> bool:
    return view.roles.lcl or not grid_forming(view)


def _voltage_to_give(view: View) -> bool:
    return view.roles.voltage_loop is not None and not voltage_given(view)


def _incomplete(view: View) -> bool:
    return view.roles.missing_layers > 0


_SLOW, _OUTER, _FREQUENCY = (1.0, 1.0, 0.5, 0.1), (1.0, 1.0, 0.3, 0.1), (1.0, 1.0, 0.5, 0.3)
_MAGNITUDE, _EVERYWHERE = (1.0, 0.7, 0.2, 0.1), (1.0, 1.0, 1.0, 1.0)

#: A grid-forming inverter controls the voltage of a capacitor, so the filter comes before that loop; its droop controls p.
SUB_LOOPS = (
    Family("filter", "structural", (0.2, 0.4, 1.0, 1.0), 9.0, where_missing(plants, _forming_or_lcl), any_time=True),
    Family("capacitor", "structural", _EVERYWHERE, 9.0, where_missing(plants, _following_or_lcl), True),
    Family("other filter", "structural", (0.2, 0.4, 1.0, 1.0), 0.5, where_present(plants, _lcl)),
    Family("synchronisation", "structural", _FREQUENCY, 9.0, where_missing(synchronisation, _synchronised), True),
    Family(
        "other synchronisation", "structural", _SLOW, 0.5, where_present(synchronisation, _synchronised), if_gross=2.0
    ),
    Family("PLL and droop together", "structural", _SLOW, 0.2, blend, if_gross=0.7),
    Family("damping of the swing", "structural", _SLOW, 3.0, frequency_damping),
    Family("no synchronisation", "structural", (0.5, 0.5, 0.2, 0.1), 0.1, no_synchronisation),
    Family("current loop", "structural", (0.5, 1.0, 1.0, 0.5), 9.0, current_loop, True),
    Family("voltage loop", "structural", _SLOW, 9.0, where_present(voltage_loop, _forming_alone), True),
    Family("voltage loop too", "structural", _SLOW, 6.0, where_present(voltage_loop, _forming_beside)),
    Family("other voltage loop", "structural", _SLOW, 0.3, where_missing(voltage_loop, grid_forming), if_gross=1.5),
    Family("power loops", "structural", (1.0, 1.0, 0.3, 0.3), 9.0, where_missing(power_loops, _outer), True),
    Family("missing axis", "structural", (1.0, 1.0, 0.3, 0.3), 6.0, missing_axis),
    Family("other power loops", "structural", _OUTER, 0.3, where_present(power_loops, _outer), if_gross=1.0),
    Family("AC voltage", "structural", _MAGNITUDE, 0.3, ac_voltage_loop, if_gross=1.5),
    Family("DC link", "structural", _OUTER, 0.3, dc_voltage_loop, if_gross=1.5),
    Family("voltage droop", "structural", _OUTER, 6.0, where_present(voltage_droop, _voltage_to_give)),
    Family(
        "other voltage droop",
        "structural",
        _MAGNITUDE,
        0.3,
        where_missing(voltage_droop, _voltage_to_give),
        if_gross=1.0,
    ),
    Family("one loop less", "structural", (0.5, 0.5, 0.3, 0.2), 0.3, loop_removals, if_gross=0.5),
    Family("second device", "structural", _EVERYWHERE, 0.005, where_missing(second_device, _incomplete), if_gross=0.1),
    Family("one device less", "structural", _EVERYWHERE, 0.2, no_second_device),
)
