"""ibrid: from measured 2x2 dq admittance to a named, fitted block diagram and a state-space model.

    sweep = ibrid.read_sweep("data/paper_like.csv")
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep)
    system = record.state_space(sweep.names[0])

Names are imported when they are first used, so that `import ibrid` costs nothing.
"""

from typing import TYPE_CHECKING

from ibrid.lazy import imported_by_need

if TYPE_CHECKING:  # the same names for type checkers, which a test compares
    from ibrid_search.running import search

    from ibrid.analysis.grids.power_jacobian import power_jacobian
    from ibrid.analysis.grids.stability import stability
    from ibrid.analysis.models.prediction import predict
    from ibrid.analysis.models.residuals import residuals
    from ibrid.arguments.coercion import as_diagram, as_events, as_record, as_sweep, load
    from ibrid.arguments.plot import plot
    from ibrid.devices.measuring import measure
    from ibrid.errors import IbridError
    from ibrid.evaluation.evaluate import evaluate
    from ibrid.evaluation.record import Record, read_record
    from ibrid.export.formats import export
    from ibrid.export.nonlinear_model import nonlinear_model
    from ibrid.fit.settings import FitSettings
    from ibrid.gap.recordings.event_evaluation import evaluate_events
    from ibrid.gap.workflow import find_gap
    from ibrid.generic.fitting import generic_model
    from ibrid.measurement.formats.csv_file import write_sweep
    from ibrid.measurement.formats.event_csv import write_events
    from ibrid.measurement.formats.frd import from_frd, from_system
    from ibrid.measurement.quality.inspect import inspect
    from ibrid.measurement.read import read_sweep
    from ibrid.measurement.read_events import read_events
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.noise import add_noise
    from ibrid.measurement.sweeps.sweep import Sweep
    from ibrid.modules.kind import ModuleKind, Range
    from ibrid.modules.large_signal import LargeSignal
    from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
    from ibrid.plants.benchmarks import benchmarks, examples
    from ibrid.plants.sweeping import sweep
    from ibrid.report.pages.page import write_report
    from ibrid.signals import Signal
    from ibrid.structure.comparison.compare import compare
    from ibrid.structure.compiling.canonical import structure_hash
    from ibrid.structure.compiling.check import violations
    from ibrid.structure.diagrams.diagram import Diagram
    from ibrid.structure.diagrams.library import textbook, textbook_names
    from ibrid.structure.diagrams.program import parse_program, program_text, read_program
    from ibrid.study import Study

__all__ = [
    "PAPER_VOCABULARY",
    "VOCABULARY",
    "Diagram",
    "Events",
    "FitSettings",
    "IbridError",
    "LargeSignal",
    "ModuleKind",
    "Range",
    "Record",
    "Signal",
    "Study",
    "Sweep",
    "add_noise",
    "as_diagram",
    "as_events",
    "as_record",
    "as_sweep",
    "benchmarks",
    "compare",
    "evaluate",
    "evaluate_events",
    "examples",
    "export",
    "find_gap",
    "from_frd",
    "from_system",
    "generic_model",
    "inspect",
    "load",
    "measure",
    "nonlinear_model",
    "parse_program",
    "plot",
    "power_jacobian",
    "predict",
    "program_text",
    "read_events",
    "read_program",
    "read_record",
    "read_sweep",
    "residuals",
    "search",
    "stability",
    "structure_hash",
    "sweep",
    "textbook",
    "textbook_names",
    "violations",
    "write_events",
    "write_report",
    "write_sweep",
]

__version__ = "0.1.0"


#: Public name -> the module that it is imported from when it is first used.
HOMES = {
    "add_noise": "ibrid.measurement.sweeps.noise",
    "as_diagram": "ibrid.arguments.coercion",
    "as_events": "ibrid.arguments.coercion",
    "as_record": "ibrid.arguments.coercion",
    "as_sweep": "ibrid.arguments.coercion",
    "benchmarks": "ibrid.plants.benchmarks",
    "compare": "ibrid.structure.comparison.compare",
    "Diagram": "ibrid.structure.diagrams.diagram",
    "evaluate": "ibrid.evaluation.evaluate",
    "evaluate_events": "ibrid.gap.recordings.event_evaluation",
    "Events": "ibrid.measurement.recordings.events",
    "examples": "ibrid.plants.benchmarks",
    "export": "ibrid.export.formats",
    "find_gap": "ibrid.gap.workflow",
    "FitSettings": "ibrid.fit.settings",
    "from_frd": "ibrid.measurement.formats.frd",
    "from_system": "ibrid.measurement.formats.frd",
    "generic_model": "ibrid.generic.fitting",
    "IbridError": "ibrid.errors",
    "inspect": "ibrid.measurement.quality.inspect",
    "LargeSignal": "ibrid.modules.large_signal",
    "load": "ibrid.arguments.coercion",
    "measure": "ibrid.devices.measuring",
    "ModuleKind": "ibrid.modules.kind",
    "nonlinear_model": "ibrid.export.nonlinear_model",
    "PAPER_VOCABULARY": "ibrid.modules.vocabulary",
    "parse_program": "ibrid.structure.diagrams.program",
    "plot": "ibrid.arguments.plot",
    "power_jacobian": "ibrid.analysis.grids.power_jacobian",
    "predict": "ibrid.analysis.models.prediction",
    "program_text": "ibrid.structure.diagrams.program",
    "Range": "ibrid.modules.kind",
    "read_events": "ibrid.measurement.read_events",
    "read_program": "ibrid.structure.diagrams.program",
    "read_record": "ibrid.evaluation.record",
    "read_sweep": "ibrid.measurement.read",
    "Record": "ibrid.evaluation.record",
    "residuals": "ibrid.analysis.models.residuals",
    "search": "ibrid_search.running",
    "Signal": "ibrid.signals",
    "stability": "ibrid.analysis.grids.stability",
    "structure_hash": "ibrid.structure.compiling.canonical",
    "Study": "ibrid.study",
    "Sweep": "ibrid.measurement.sweeps.sweep",
    "sweep": "ibrid.plants.sweeping",
    "textbook": "ibrid.structure.diagrams.library",
    "textbook_names": "ibrid.structure.diagrams.library",
    "violations": "ibrid.structure.compiling.check",
    "VOCABULARY": "ibrid.modules.vocabulary",
    "write_events": "ibrid.measurement.formats.event_csv",
    "write_report": "ibrid.report.pages.page",
    "write_sweep": "ibrid.measurement.formats.csv_file",
}

if not TYPE_CHECKING:  # with it every misspelt name would have the type Any
    __getattr__ = imported_by_need(__name__, HOMES)


def __dir__() -> list[str]:
    return [*__all__, "__all__", "__version__"]
