"""`ibrid gap ... --suggest PROPOSER`: proposers of the search that suggest what has no name."""

from argparse import Namespace

from ibrid.gap.results.suggested_edits import Suggest
from ibrid_search.proposers.choose import Proposers
from ibrid_search.recursion.suggesting import FEW, MANY, suggestions_of


def suggesters(arguments: Namespace) -> tuple[Suggest, ...]:
    """Those that are asked for."""
    chosen = Proposers(arguments.suggest, models=arguments.models).weighted()
    number = FEW if arguments.models else MANY
    return tuple(suggestions_of(one, number, arguments.seed) for one, _ in chosen)
