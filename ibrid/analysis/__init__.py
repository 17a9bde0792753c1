"""What an identified model says: its matrices anywhere, predictions, stability in a grid."""

from ibrid.analysis.grids.power_jacobian import PowerJacobian, power_jacobian
from ibrid.analysis.grids.stability import Stability, stability
from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.analysis.models.modes import Mode, Participation, modes, participation
from ibrid.analysis.models.prediction import Prediction, predict

__all__ = [
    "LinearModel",
    "Mode",
    "Participation",
    "PowerJacobian",
    "Prediction",
    "Stability",
    "linear_model",
    "modes",
    "participation",
    "power_jacobian",
    "predict",
    "stability",
]
