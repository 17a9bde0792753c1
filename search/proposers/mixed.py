"""Proposers by their names and weights, as the command line gives them: "rules", or "rules:0.7,random:0.3"."""

from collections.abc import Callable, Mapping

from ibrid.errors import IbridError, near
from search.proposal import Proposer


def parse_proposers(text: str, makers: Mapping[str, Callable[[], Proposer]]) -> tuple[tuple[Proposer, float], ...]:
    """Make the proposers of "NAME[:WEIGHT],..."; IbridError for an unknown name or a weight that is not positive."""
    found = []
    for word in text.split(","):
        name, _, number = word.strip().partition(":")
        if name not in makers:
            raise IbridError(f"--proposer knows {', '.join(makers)}, found {name[:40]!r}; {near(name, makers)}")
        try:
            weight = float(number) if number else 1.0
        except ValueError:
            weight = 0.0
        if not 0 < weight < float("inf"):
            raise IbridError(f"--proposer {word.strip()[:60]}: a weight is a number above zero, such as {name}:0.5")
        found.append((makers[name](), weight))
    return tuple(found)
