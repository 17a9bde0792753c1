"""What an identified model says: its matrices anywhere, predictions, stability in a grid."""

from ibrid.analysis.linear_model import LinearModel, linear_model
from ibrid.analysis.modes import Mode, Participation, modes, participation
from ibrid.analysis.power_jacobian import PowerJacobian, power_jacobian
from ibrid.analysis.prediction import Prediction, predict
from ibrid.analysis.stability import Stability, stability

__all__ = [
    "LinearModel", "Mode", "Participation", "PowerJacobian", "Prediction", "Stability", "linear_model", "modes",
    "participation", "power_jacobian", "predict", "stability",
]  # fmt: skip
