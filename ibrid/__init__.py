"""ibrid: from measured 2x2 dq admittance to a named, fitted block diagram and a state-space model.

    sweep = ibrid.read_sweep("data/paper_like.csv")
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep)
    system = record.state_space(sweep.names[0])

Names are imported when they are first used, so that `import ibrid` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # what `_HOME` does, for those who read types; a test compares them
    from ibrid_search.running import search

    from ibrid.analysis.power_jacobian import power_jacobian
    from ibrid.analysis.prediction import predict
    from ibrid.analysis.stability import stability
    from ibrid.errors import IbridError
    from ibrid.evaluation.evaluate import evaluate
    from ibrid.evaluation.record import Record, read_record
    from ibrid.export.formats import export
    from ibrid.export.nonlinear_model import nonlinear_model
    from ibrid.fit.settings import FitSettings
    from ibrid.gap.joint_fit import evaluate_events
    from ibrid.gap.workflow import find_gap
    from ibrid.measurement.csv_file import write_sweep
    from ibrid.measurement.event_csv import write_events
    from ibrid.measurement.events import Events
    from ibrid.measurement.frd import from_frd, from_system
    from ibrid.measurement.inspect import inspect
    from ibrid.measurement.noise import add_noise
    from ibrid.measurement.read import read_sweep
    from ibrid.measurement.read_events import read_events
    from ibrid.measurement.sweep import Sweep
    from ibrid.modules.kind import ModuleKind, Range
    from ibrid.modules.large_signal import LargeSignal
    from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
    from ibrid.plants.benchmarks import benchmarks
    from ibrid.plants.sweeping import sweep
    from ibrid.report.page import write_report
    from ibrid.signals import Signal
    from ibrid.structure.canonical import structure_hash
    from ibrid.structure.check import violations
    from ibrid.structure.compare import compare
    from ibrid.structure.diagram import Diagram
    from ibrid.structure.library import textbook, textbook_names
    from ibrid.structure.program import parse_program, program_text, read_program
    from ibrid.study import Study

__all__ = [
    "PAPER_VOCABULARY", "VOCABULARY", "Diagram", "Events", "FitSettings", "IbridError", "LargeSignal", "ModuleKind",
    "Range", "Record", "Signal", "Study", "Sweep", "add_noise", "benchmarks", "compare", "evaluate", "evaluate_events",
    "export", "find_gap", "from_frd", "from_system", "inspect", "nonlinear_model", "parse_program", "power_jacobian",
    "predict", "program_text", "read_events", "read_program", "read_record", "read_sweep", "search", "stability",
    "structure_hash", "sweep", "textbook", "textbook_names", "violations", "write_events", "write_report",
    "write_sweep",
]  # fmt: skip

_HOME = {
    "Diagram": "ibrid.structure.diagram",
    "Events": "ibrid.measurement.events",
    "FitSettings": "ibrid.fit.settings",
    "IbridError": "ibrid.errors",
    "LargeSignal": "ibrid.modules.large_signal",
    "ModuleKind": "ibrid.modules.kind",
    "PAPER_VOCABULARY": "ibrid.modules.vocabulary",
    "Range": "ibrid.modules.kind",
    "Record": "ibrid.evaluation.record",
    "Signal": "ibrid.signals",
    "Study": "ibrid.study",
    "Sweep": "ibrid.measurement.sweep",
    "VOCABULARY": "ibrid.modules.vocabulary",
    "add_noise": "ibrid.measurement.noise",
    "benchmarks": "ibrid.plants.benchmarks",
    "compare": "ibrid.structure.compare",
    "evaluate": "ibrid.evaluation.evaluate",
    "export": "ibrid.export.formats",
    "evaluate_events": "ibrid.gap.joint_fit",
    "find_gap": "ibrid.gap.workflow",
    "from_frd": "ibrid.measurement.frd",
    "from_system": "ibrid.measurement.frd",
    "inspect": "ibrid.measurement.inspect",
    "nonlinear_model": "ibrid.export.nonlinear_model",
    "parse_program": "ibrid.structure.program",
    "power_jacobian": "ibrid.analysis.power_jacobian",
    "predict": "ibrid.analysis.prediction",
    "program_text": "ibrid.structure.program",
    "read_events": "ibrid.measurement.read_events",
    "read_program": "ibrid.structure.program",
    "read_record": "ibrid.evaluation.record",
    "read_sweep": "ibrid.measurement.read",
    "search": "ibrid_search.running",
    "stability": "ibrid.analysis.stability",
    "structure_hash": "ibrid.structure.canonical",
    "sweep": "ibrid.plants.sweeping",
    "textbook": "ibrid.structure.library",
    "textbook_names": "ibrid.structure.library",
    "violations": "ibrid.structure.check",
    "write_events": "ibrid.measurement.event_csv",
    "write_report": "ibrid.report.page",
    "write_sweep": "ibrid.measurement.csv_file",
}

__version__ = "0.1.0"


if not TYPE_CHECKING:  # with it every misspelt name would have the type Any

    def __getattr__(name: str) -> object:
        if name not in _HOME:
            raise AttributeError(f"ibrid has no {name}")
        return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__all__", "__version__"]
