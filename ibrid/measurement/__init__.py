"""What was seen: sweeps of the dq admittance, how they are read and written, their noise and conventions."""

from ibrid.measurement.amplitudes import merge
from ibrid.measurement.conventions import Conventions, check_conventions
from ibrid.measurement.csv_file import read_csv, write_sweep
from ibrid.measurement.frd import from_frd, from_responses, from_system
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.inspect import Inspection, PointInspection
from ibrid.measurement.inspection_table import format_inspection
from ibrid.measurement.noise import PointNoise, add_noise
from ibrid.measurement.noise import estimate as estimate_noise
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.measurement.touchstone import write_touchstone
from ibrid.measurement.wrong_rows import without_wrong_rows

__all__ = [
    "Conventions", "Inspection", "OperatingPoint", "PointInspection", "PointNoise", "PointSweep", "Sweep", "add_noise",
    "check_conventions", "estimate_noise", "format_inspection", "from_frd", "from_responses", "from_system",
    "hardware_sweeps", "merge", "read_csv", "read_sweep", "without_wrong_rows", "write_sweep", "write_touchstone",
]  # fmt: skip
