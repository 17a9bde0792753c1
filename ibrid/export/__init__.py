"""A fitted model to take away: python-control JSON, MATLAB/Octave .mat, NumPy .npz."""

from ibrid.analysis.linear_model import LinearModel, linear_model
from ibrid.export.control_json import read_control_json
from ibrid.export.formats import FORMATS, export

__all__ = ["FORMATS", "LinearModel", "export", "linear_model", "read_control_json"]
