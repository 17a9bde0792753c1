"""ibrid: from measured 2x2 dq admittance to a named, fitted block diagram and a state-space model.

    sweep = ibrid.read_sweep("data/paper_like.csv")
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep)
    system = record.state_space(sweep.names[0])

Names are imported when they are first used, so that `import ibrid` costs nothing.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Diagram": "ibrid.structure.diagram",
    "FitSettings": "ibrid.fit.settings",
    "IbridError": "ibrid.errors",
    "LargeSignal": "ibrid.modules.large_signal",
    "ModuleKind": "ibrid.modules.kind",
    "PAPER_VOCABULARY": "ibrid.modules.vocabulary",
    "Range": "ibrid.modules.kind",
    "Record": "ibrid.evaluation.record",
    "Signal": "ibrid.signals",
    "Sweep": "ibrid.measurement.sweep",
    "VOCABULARY": "ibrid.modules.vocabulary",
    "add_noise": "ibrid.measurement.noise",
    "benchmarks": "ibrid.plants.benchmarks",
    "compare": "ibrid.structure.compare",
    "evaluate": "ibrid.evaluation.evaluate",
    "find_gap": "ibrid.gap.workflow",
    "from_frd": "ibrid.measurement.frd",
    "from_system": "ibrid.measurement.frd",
    "inspect": "ibrid.measurement.inspect",
    "nonlinear_model": "ibrid.export.nonlinear_model",
    "parse_program": "ibrid.structure.program",
    "predict": "ibrid.analysis.prediction",
    "program_text": "ibrid.structure.program",
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
    "write_report": "ibrid.report.page",
    "write_sweep": "ibrid.measurement.csv_file",
}

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_HOME)
    if name not in _HOME:
        raise AttributeError(f"ibrid has no {name}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*sorted(_HOME), "__all__", "__version__"]
