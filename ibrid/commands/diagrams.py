"""`ibrid check PROGRAM` and `ibrid compare FIRST SECOND`: diagrams without data, and responses."""

from argparse import Namespace
from typing import TYPE_CHECKING

from ibrid.arguments.places import is_record
from ibrid.commands import inputs
from ibrid.commands.outputs import give_json, require_json_place
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.quantities import counted
from ibrid.modules.vocabulary import Vocabulary, choose_vocabulary
from ibrid.streams import complain_of_program
from ibrid.structure.comparison.compare import compare, format_comparison
from ibrid.structure.compiling.check import violations, warnings
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

if TYPE_CHECKING:
    from ibrid.measurement.sweeps.sweep import Sweep


def run_check(arguments: Namespace) -> int:
    """Say what is wrong, or how large a legal diagram is and what looks like a mistake in it."""
    diagram, vocabulary = (
        inputs.program(arguments.program),
        inputs.vocabulary(arguments.vocabulary, arguments.kinds),
    )
    if _complain_of_violations(diagram, arguments.program, vocabulary, arguments.equilibrium):
        return 2
    wiring = wire(diagram, choose_vocabulary(vocabulary))
    order = sum(kind.order for kind in wiring.kinds.values())
    sums = sum(len(sources) > 1 for sources in wiring.sources.values())
    free = len(parameter_table(wiring, arguments.equilibrium).free)
    print(
        f"legal: {counted(len(diagram.instances), 'module')}, order {order}, "
        f"{counted(len(diagram.connections), 'connection')}, {counted(sums, 'sum')}, "
        f"{counted(free, 'free parameter')}"
    )
    for warning in warnings(diagram, vocabulary, equilibrium=arguments.equilibrium):
        print(f"warning: {warning}")
    return 0


def run_compare(arguments: Namespace) -> int:
    """Print how far two diagrams, or two responses, agree; exit status 0 whatever the answer."""
    require_json_place(arguments.json)
    answers = [inputs.has_response(text) for text in (arguments.first, arguments.second)]
    if any(answers):
        return _compare_responses(arguments, all(answers))
    first, second = inputs.program(arguments.first), inputs.program(arguments.second)
    vocabulary = inputs.vocabulary(arguments.vocabulary, arguments.kinds)
    for diagram, source in ((first, arguments.first), (second, arguments.second)):
        if _complain_of_violations(
            diagram, source, vocabulary, "paper"
        ):  # the equilibrium plays no part
            return 2
    comparison = compare(first, second, vocabulary)
    if not give_json(comparison.to_json(), arguments.json):
        print(format_comparison(comparison))
    return 0


def _compare_responses(arguments: Namespace, both: bool) -> int:
    """The same for sweeps, state spaces and records, at the points and frequencies of the second;
    a record takes those of the other.
    """
    from ibrid.evaluation.compared_sweeps import compare_sweeps, format_compared_sweeps

    if not both:
        raise IbridError(
            "a diagram has no response before its parameters have values; compare the data with a "
            "record of it (ibrid evaluate PROGRAM DATA --json RECORD), or two diagrams"
        )
    compared = compare_sweeps(*_responses(arguments))
    if not give_json(compared.to_json(), arguments.json):
        print(format_compared_sweeps(compared))
    return 0


def _responses(arguments: Namespace) -> "tuple[Sweep, Sweep]":
    """Both sweeps; a state space is sampled where the other one has its frequencies."""
    first, second = arguments.first, arguments.second
    if is_record(first) and is_record(second):
        raise IbridError(
            "two records say themselves how far they are from data; compare a record with a sweep, "
            "or the sweeps that ibrid predict writes"
        )
    if is_record(second):
        sweep = inputs.data(first)
        return sweep, inputs.predicted(second, sweep, arguments.kinds)
    sweep = inputs.data(second)
    if is_record(first):
        return inputs.predicted(first, sweep, arguments.kinds), sweep
    inputs.data(first)
    return inputs.simulation(first, sweep), sweep


def _complain_of_violations(
    diagram: Diagram, source: str, vocabulary: str | Vocabulary, equilibrium: str
) -> bool:
    found = violations(diagram, vocabulary, equilibrium=equilibrium)
    complain_of_program(source, map(str, found))
    return bool(found)
