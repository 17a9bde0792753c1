"""Records of inverters at given values, without a fit: quick to make, and of many kinds."""

from extended_inverters import VALUES, Inverter, program
from fitted import benchmark
from sharing import shared

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.plants.published import PLANTS

DEVICE = PLANTS["paper_like"]
EXTENDED = {
    "dc_link": Inverter("LCL_R", "voltage", shunt=True),
    "direct_loop": Inverter("LLFilter", "power"),
    "damped": Inverter("LCL_RC", "voltage"),
    "saturated": Inverter("LCL_saturated", "voltage"),
}
NAMES = ("paper_like", *EXTENDED)


@shared
def given_record(name: str) -> ibrid.Record:
    """One of NAMES."""
    if name in EXTENDED:
        return record_at(ibrid.parse_program(program(EXTENDED[name])), benchmark(), VALUES)
    return record_at(ibrid.parse_program(DEVICE.program), benchmark(), DEVICE.diagram_values)
