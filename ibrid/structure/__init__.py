"""Block diagrams: named modules and connections, their program text, grammar, canonical form and
comparison.
"""

from ibrid.structure.comparison.compare import Comparison, compare, format_comparison
from ibrid.structure.compiling.canonical import canonical_order, structure_hash
from ibrid.structure.compiling.check import Violation, require_legal, violations, warnings
from ibrid.structure.diagrams.diagram import Connection, Diagram, Instance
from ibrid.structure.diagrams.library import (
    published_names,
    published_values,
    textbook,
    textbook_names,
    textbook_text,
)
from ibrid.structure.diagrams.program import parse_program, program_text, read_program
from ibrid.structure.reading.parameters import Parameter, ParameterTable, parameter_table
from ibrid.structure.reading.steady_state import Steady, steady_order, unknown_equilibria
from ibrid.structure.reading.wiring import Wiring, wire

__all__ = [
    "Comparison",
    "Connection",
    "Diagram",
    "Instance",
    "Parameter",
    "ParameterTable",
    "Steady",
    "Violation",
    "Wiring",
    "canonical_order",
    "compare",
    "format_comparison",
    "parameter_table",
    "parse_program",
    "program_text",
    "published_names",
    "published_values",
    "read_program",
    "require_legal",
    "steady_order",
    "structure_hash",
    "textbook",
    "textbook_names",
    "textbook_text",
    "unknown_equilibria",
    "violations",
    "warnings",
    "wire",
]
