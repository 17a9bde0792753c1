"""What is made of a diagram once and asked for often, such as its symbolic model."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from ibrid.structure.diagrams.diagram import Diagram

Made = TypeVar("Made")


class DiagramCache(Generic[Made]):
    """A memory of what was made of diagrams, each found again by the very same object.

    A diagram says the same as another one that is equal, and cannot be hashed, since it can be
    added to; none is once something was made of it. The memory holds its diagrams, so that no other
    one takes their identity. `most` : entries beyond which it begins anew; None: it never does.
    """

    def __init__(self, most: int | None = None) -> None:
        self.most = most
        self._made: dict[Hashable, tuple[Diagram, Made]] = {}

    def of(self, diagram: Diagram, make: Callable[[], Made], *beside: Hashable) -> Made:
        """What was made of a diagram, and of what else is given beside it; made now where it was
        not.
        """
        key = id(diagram), *beside
        if key not in self._made:
            if self.most is not None and len(self._made) > self.most:
                self._made.clear()
            self._made[key] = diagram, make()
        return self._made[key][1]
