"""A cache of what is derived from a diagram once and used often, such as its symbolic model."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from ibrid.structure.diagrams.diagram import Diagram

Derived = TypeVar("Derived")


class DiagramCache(Generic[Derived]):
    """A cache whose keys are diagrams, by identity.

    A diagram can be added to and so not be hashed; none is changed any more once something was
    derived from it. The cache holds its diagrams, so that no other one takes their identity.

    Parameters
    ----------
    most : int or None
        Entries beyond which the cache is cleared; None: never.
    """

    def __init__(self, most: int | None = None) -> None:
        self.most = most
        self._entries: dict[Hashable, tuple[Diagram, Derived]] = {}

    def get_or_make(
        self, diagram: Diagram, make: Callable[[], Derived], *further_keys: Hashable
    ) -> Derived:
        """Return what was derived from a diagram and further keys; derive it the first time."""
        key = id(diagram), *further_keys
        if key not in self._entries:
            if self.most is not None and len(self._entries) > self.most:
                self._entries.clear()
            self._entries[key] = diagram, make()
        return self._entries[key][1]
