"""evaluate(diagram, sweep) -> Record: errors by band, entry and operating point, parameters,
confidence, reward.
"""

from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record, read_record

__all__ = ["Outcome", "Record", "evaluate", "read_record"]
