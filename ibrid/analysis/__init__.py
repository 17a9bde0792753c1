"""What an identified model says: its matrices anywhere, predictions, stability in a grid."""

from ibrid.analysis.linear_model import LinearModel, linear_model

__all__ = ["LinearModel", "linear_model"]
