"""The grammar of an answer: at every place the tokens that keep the edit one of this parent, ports
of the right signal.

    SWAP #i K:kind ...  DEL #i ...  ADD #i K:kind ...  AT input (- output ...) (+ output ...) ...
    SAME #i #j | OWN #i | TIE #i @p #j @q | FREE #i @p ...  <end>

Parts come in this order, modules and inputs in theirs, so that an edit has one form. An answer may
end when every input is driven and both rotations are there or none.
"""

from collections.abc import Iterator

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.grammar_rules.grammar import HIGHEST_ORDER
from ibrid_policy.diagram_words import output_words
from ibrid_policy.edit import NumberedEdit, exchangeable, is_plant, owners_after
from ibrid_policy.numbering import IN, OUT, OUTER, Numbered, Port, Slot
from ibrid_policy.sharing import Sharing
from ibrid_policy.tokens import (
    ADD,
    AT,
    CUT,
    DELETE,
    END,
    FREE,
    MOST_MODULES,
    OWN,
    SAME,
    SWAP,
    TIE,
    TOKENS,
    WIRE,
    LanguageError,
    kind_word,
    module_word,
)
from ibrid_policy.wires import Wires

#: New modules of one edit, and words of an answer, at most.
MOST_ADDED, LONGEST = 40, 160
_OPERATIONS = (SWAP, DELETE, ADD, AT, SAME, OWN, TIE, FREE, END)


class Grammar:
    """Reads an answer word by word.

    `allowed` : the words that may come next. `edit` : what was read, once `ended`.
    """

    def __init__(self, parent: Numbered, vocabulary: Vocabulary) -> None:
        self.parent, self.old = parent, len(parent.kinds)
        self.vocabulary = {kind.name: kind for kind in vocabulary}
        self.kinds: list[ModuleKind] = list(parent.kinds)
        self.swapped: dict[int, ModuleKind] = {}
        self.removed: set[int] = set()
        self.added: list[ModuleKind] = []
        self._settled: tuple[tuple[int, int, int], Wires, Sharing] | None = None
        self.changed: dict[Slot, Slot] = {}
        self.part = 0
        self.last = -1  # the module that this part named last
        self.words: list[str] = []  # of the operation under way
        self.ended = False
        self._allowed: list[str] | None = None

    @property
    def edit(self) -> NumberedEdit:
        """What was read."""
        before = owners_after(self.parent, self.swapped, self.removed, self.added)
        return NumberedEdit(
            tuple(sorted((number, kind.name) for number, kind in self.swapped.items())),
            tuple(sorted(self.removed)),
            tuple(kind.name for kind in self.added),
            tuple(one.rewiring for one in self._wires.blocks),
            {
                slot: owner
                for slot, owner in sorted(self.changed.items())
                if before.get(slot) != owner
            },
        )

    @property
    def allowed(self) -> list[str]:
        """Words that may come next; where nothing helps any more, the end."""
        if self._allowed is None:
            self._allowed = [
                word for word in dict.fromkeys(self._next()) if word in TOKENS.ids
            ] or [END]
        return self._allowed

    def take(self, word: str) -> None:
        """Read a word; LanguageError for one that may not come here."""
        if self.ended or word not in self.allowed:
            raise LanguageError(f"{word} may not follow here; {' '.join(self.allowed[:8])} may")
        self._allowed = None
        if word in _OPERATIONS:
            self.words = []  # the block of an input is done
        if word == END:
            self.ended = True
            return
        self.words.append(word)
        getattr(self, f"_take_{_NAMES[self.words[0]]}")()

    # --- what may come
    # ------------------------------------------------------------------------------------------

    def _next(self) -> Iterator[str]:
        if self.ended:
            return
        if self.words:
            yield from getattr(self, f"_next_{_NAMES[self.words[0]]}")()
            return
        yield from self._operations()

    def _operations(self) -> Iterator[str]:
        if self.part == 0 and any(
            self._exchanges(number) for number in range(self.last + 1, self.old)
        ):
            yield SWAP
        if self.part <= 1 and any(True for _ in self._removable()):
            yield DELETE
        if self.part <= 2 and any(True for _ in self._addable()):
            yield ADD
        if len(self._rotations()) != 1:
            if self.part <= 3 and any(True for _ in self._wires.targets()):
                yield AT
            if self._wires.bare:
                return
            yield from self._shares()
            if self.swapped or self.removed or self.added or self._wires.blocks or self.changed:
                yield END

    def _next_swap(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield from (
                module_word(one) for one in range(self.last + 1, self.old) if self._exchanges(one)
            )
        else:
            yield from (kind_word(kind.name) for kind in self._exchanges(_number(self.words[1])))

    def _next_delete(self) -> Iterator[str]:
        yield from map(module_word, self._removable())

    def _next_add(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield module_word(len(self.kinds))  # the number by which the new module will be called
        else:
            yield from (kind_word(kind.name) for kind in self._addable())

    def _next_at(self) -> Iterator[str]:
        words, wires = self.words, self._wires
        if len(words) == 1:
            for number, _ in wires.targets():
                yield TERMINAL_CURRENT if number == OUTER else module_word(number)
        elif (target := self._target()) is None:
            yield from (
                f".{port}" for number, port in wires.targets() if number == _number(words[1])
            )
        elif words[-1] in (CUT, WIRE):
            yield from (
                output_words(one, self.kinds)[0] for one in wires.candidates(words[-1], target)
            )
        elif (maker := self._half_named()) is not None:
            yield from (
                f".{port}"
                for number, port in wires.candidates(self._mark, target)
                if number == maker
            )
        else:
            block = wires.block(target)
            for mark in (CUT, WIRE):
                may = mark == WIRE or not (block and block.wired)
                if may and any(True for _ in wires.candidates(mark, target)):
                    yield mark
            if block and wires.sources[target]:
                yield from self._operations()

    def _next_same(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield from (
                module_word(one)
                for one in self._later()
                if any(True for _ in self._sharing.lenders(one))
            )
        else:
            yield from map(module_word, self._sharing.lenders(_number(self.words[1])))

    def _next_own(self) -> Iterator[str]:
        yield from (module_word(one) for one in self._later() if self._sharing.borrows(one))

    def _next_free(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield from (
                module_word(one)
                for one in range(self._first, len(self.kinds))
                if self._sharing.borrows(one)
            )
        else:
            number = _number(self.words[1])
            yield from (
                f"@{name}"
                for name in self.kinds[number].parameters
                if self._sharing.foreign((number, name))
            )

    def _next_tie(self) -> Iterator[str]:
        words, number = self.words, _number(self.words[1]) if len(self.words) > 1 else -1
        if len(words) == 1:
            yield from (
                module_word(one)
                for one in range(self._first, len(self.kinds))
                if self._sharing.tied(one)
            )
        elif len(words) == 2:
            yield from (f"@{name}" for name in self._sharing.tied(number))
        elif len(words) == 3:
            yield from (
                module_word(one)
                for one in range(number)
                if self._sharing.lent(one, (number, words[2][1:]))
            )
        else:
            yield from (
                f"@{name}" for name in self._sharing.lent(_number(words[3]), (number, words[2][1:]))
            )

    def _exchanges(self, number: int) -> list[ModuleKind]:
        own = self.parent.kinds[number]
        room = HIGHEST_ORDER - self._order() + own.order
        return [
            kind
            for kind in self.vocabulary.values()
            if exchangeable(own, kind) and kind.order <= room
        ]

    def _removable(self) -> Iterator[int]:
        first = self.last + 1 if self.part == 1 else 0
        for number in range(first, self.old):
            if number not in self.swapped and not is_plant(self.parent.kinds[number]):
                yield number

    def _addable(self) -> Iterator[ModuleKind]:
        room, left = (
            HIGHEST_ORDER - self._order(),
            min(MOST_ADDED - len(self.added), MOST_MODULES - len(self.kinds)),
        )
        framed = self._rotations()
        for kind in self.vocabulary.values():
            partner = (
                len(framed) == 1 and kind.element in set(ROTATIONS) - framed
            )  # the last place is kept for it
            if (
                left > (0 if partner else 1)
                and not is_plant(kind)
                and not kind.shares
                and kind.order <= room
            ):
                yield kind

    def _order(self) -> int:
        return sum(
            kind.order for number, kind in enumerate(self.kinds) if number not in self.removed
        )

    def _rotations(self) -> set[Element]:
        there = {
            kind.element for number, kind in enumerate(self.kinds) if number not in self.removed
        }
        return {element for element in ROTATIONS if element in there}

    def _target(self) -> Port | None:
        """The input that AT names, once it is named in full."""
        words = self.words
        if len(words) < 2:
            return None
        if words[1] == TERMINAL_CURRENT:
            return OUT
        number = _number(words[1])
        ports = list(self.kinds[number].inputs)
        if len(ports) == 1:
            return number, ports[0]
        return (number, words[2][1:]) if len(words) > 2 else None

    def _half_named(self) -> int | None:
        """The module of an output whose port is still to be named."""
        if self.words[-2] in (CUT, WIRE) and self.words[-1] != TERMINAL_VOLTAGE:
            number = _number(self.words[-1])
            return number if len(self.kinds[number].outputs) > 1 else None
        return None

    @property
    def _mark(self) -> str:
        """Whether an output is being cut or wired."""
        return next(word for word in reversed(self.words) if word in (CUT, WIRE))

    def _shares(self) -> Iterator[str]:
        sharing, first = self._sharing, self._first
        if any(any(True for _ in sharing.lenders(one)) for one in self._later()):
            yield SAME
        if any(map(sharing.borrows, self._later())):
            yield OWN
        if any(map(sharing.borrows, range(first, len(self.kinds)))):
            yield FREE
        if any(map(sharing.tied, range(first, len(self.kinds)))):
            yield TIE

    @property
    def _first(self) -> int:
        return max(self.last, 0) if self.part == 4 else 0

    def _later(self) -> range:
        return range(self.last + 1 if self.part == 4 else 0, len(self.kinds))

    @property
    def _wires(self) -> Wires:
        """The wires, once it is settled which modules there are; anew while that changes."""
        return self._settle()[1]

    @property
    def _sharing(self) -> Sharing:
        """Who shares values, likewise."""
        return self._settle()[2]

    def _settle(self) -> tuple[tuple[int, int, int], Wires, Sharing]:
        size = len(self.swapped), len(self.removed), len(self.added)
        if self._settled is None or self._settled[0] != size:
            owners = owners_after(self.parent, self.swapped, self.removed, self.added)
            wires = Wires(self.parent, self.swapped, self.removed, self.kinds)
            self._settled = size, wires, Sharing(owners, self.kinds)
        return self._settled

    # --- what a word does
    # ------------------------------------------------------------------------------------------

    def _begin(self, part: int) -> None:
        if part != self.part:
            self.part, self.last = part, -1

    def _take_swap(self) -> None:
        if len(self.words) == 3:
            number = _number(self.words[1])
            self.swapped[number] = self.kinds[number] = self.vocabulary[self.words[2][2:]]
            self.last, self.words = number, []

    def _take_delete(self) -> None:
        self._begin(1)
        if len(self.words) == 2:
            self.last = _number(self.words[1])
            self.removed.add(self.last)
            self.words = []

    def _take_add(self) -> None:
        self._begin(2)
        if len(self.words) == 3:
            kind = self.vocabulary[self.words[2][2:]]
            self.added.append(kind)
            self.kinds.append(kind)
            self.words = []

    def _take_at(self) -> None:
        self._begin(3)
        words, target = self.words, self._target()
        if target is None or words[-1] in (AT, CUT, WIRE):
            return
        if CUT not in words and WIRE not in words:
            self._wires.begin(target)
        elif self._half_named() is None:
            self._wires.change(
                self._mark, target, IN if words[-1] == TERMINAL_VOLTAGE else self._source()
            )

    def _source(self) -> Port:
        word = self.words[-1]
        if word.startswith("."):
            return _number(self.words[-2]), word[1:]
        number = _number(word)
        return number, next(iter(self.kinds[number].outputs))

    def _share(self, number: int, owners: dict[Slot, Slot]) -> None:
        self._sharing.owners.update(owners)
        self.changed |= owners
        self.last, self.words = number, []

    def _take_same(self) -> None:
        self._begin(4)
        if len(self.words) == 3:
            number, lender = _number(self.words[1]), _number(self.words[2])
            owners = self._sharing.owners
            self._share(
                number,
                {(number, name): owners[lender, name] for name in self.kinds[number].parameters},
            )

    def _take_own(self) -> None:
        self._begin(4)
        if len(self.words) == 2:
            number = _number(self.words[1])
            self._share(
                number, {(number, name): (number, name) for name in self._sharing.free(number)}
            )

    def _take_free(self) -> None:
        self._begin(4)
        if len(self.words) == 3:
            slot = _number(self.words[1]), self.words[2][1:]
            self._share(slot[0], {slot: slot})

    def _take_tie(self) -> None:
        self._begin(4)
        if len(self.words) == 5:
            slot = _number(self.words[1]), self.words[2][1:]
            self._share(
                slot[0], {slot: self._sharing.owners[_number(self.words[3]), self.words[4][1:]]}
            )


_NAMES = {
    SWAP: "swap",
    DELETE: "delete",
    ADD: "add",
    AT: "at",
    SAME: "same",
    OWN: "own",
    TIE: "tie",
    FREE: "free",
}


def _number(word: str) -> int:
    return int(word[1:])
