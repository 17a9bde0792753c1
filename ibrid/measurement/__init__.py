"""What was seen: sweeps of the dq admittance, how they are read and written, their noise and
conventions.
"""

from ibrid.measurement.conventions.contradictions import Conventions, check_conventions
from ibrid.measurement.formats.csv_file import read_csv, write_sweep
from ibrid.measurement.formats.frd import from_frd, from_responses, from_system
from ibrid.measurement.formats.touchstone import write_touchstone
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.quality.inspect import Inspection, PointInspection
from ibrid.measurement.quality.inspection_table import format_inspection
from ibrid.measurement.quality.wrong_rows import without_wrong_rows
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.amplitudes import merge
from ibrid.measurement.sweeps.noise import PointNoise, add_noise
from ibrid.measurement.sweeps.noise import estimate as estimate_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

__all__ = [
    "Conventions",
    "Inspection",
    "OperatingPoint",
    "PointInspection",
    "PointNoise",
    "PointSweep",
    "Sweep",
    "add_noise",
    "check_conventions",
    "estimate_noise",
    "format_inspection",
    "from_frd",
    "from_responses",
    "from_system",
    "hardware_sweeps",
    "merge",
    "read_csv",
    "read_sweep",
    "without_wrong_rows",
    "write_sweep",
    "write_touchstone",
]
