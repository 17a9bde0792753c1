"""The grammar of an answer: at every place the tokens that keep the edit one of this parent, ports of the right signal.

    SWAP #i K:kind ...  DEL #i ...  ADD K:kind ...  AT input (- output ...) (+ output ...) ...
    SAME #i #j | OWN #i | TIE #i @p #j @q | FREE #i @p ...  <end>

Parts come in this order, modules and inputs in theirs, so that an edit has one form. An answer may end when every input is
driven and both rotations are there or none.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal
from ibrid.structure.check import HIGHEST_ORDER
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from search.policy.diagram_words import input_words, output_words, sharing_words
from search.policy.edit import Edit, Rewiring, after_structure, exchangeable, input_order, is_plant, owners_after
from search.policy.numbering import IN, OUT, OUTER, Numbered, Port, Slot
from search.policy.tokens import (
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
    WIRE,
    LanguageError,
    kind_word,
    module_word,
)

#: New modules of one edit, and words of an answer, at most.
MOST_ADDED, LONGEST = 40, 160
_ROTATIONS = {"Rot_v", "Rot_i"}
_OPERATIONS = (SWAP, DELETE, ADD, AT, SAME, OWN, TIE, FREE, END)


def edit_words(edit: Edit, parent: Numbered, vocabulary: Vocabulary) -> list[str]:
    """The answer that stands for an edit."""
    known = {kind.name: kind for kind in vocabulary}
    kinds = list(parent.kinds)
    words: list[str] = []
    for number, kind in edit.swapped:
        kinds[number] = known[kind]
        words += [SWAP, module_word(number), kind_word(kind)]
    for number in edit.removed:
        words += [DELETE, module_word(number)]
    for kind in edit.added:
        kinds.append(known[kind])
        words += [ADD, kind_word(kind)]
    for one in edit.rewired:
        words += [AT, *input_words(one.target, kinds)]
        for mark, sources in ((CUT, one.cut), (WIRE, one.wired)):
            for source in sources:
                words += [mark, *output_words(source, kinds)]
    changed = dict(edit.owners or {})
    swapped = {number: known[kind] for number, kind in edit.swapped}
    owners = owners_after(parent, swapped, set(edit.removed), [known[kind] for kind in edit.added]) | changed
    for number in sorted({slot[0] for slot in changed}):
        own = {name: owners[number, name] for name in kinds[number].parameters if (number, name) in owners}
        whole = sharing_words(number, own, kinds)
        if not whole:
            words += [OWN, module_word(number)]
        elif whole[0] == SAME:
            words += [SAME, module_word(number), whole[1]]
        else:
            for (at, name), (lender, lent) in changed.items():
                if at == number and (lender, lent) == (at, name):
                    words += [FREE, module_word(at), f"@{name}"]
                elif at == number:
                    words += [TIE, module_word(at), f"@{name}", module_word(lender), f"@{lent}"]
    return [*words, END]


def read_edit(words: Sequence[str], parent: Numbered, vocabulary: Vocabulary) -> Edit:
    """The edit of an answer; LanguageError at the first word that the grammar does not allow there."""
    reader = Grammar(parent, vocabulary)
    for word in words:
        reader.take(word)
    if not reader.ended:
        raise LanguageError("the answer does not come to its end")
    return reader.edit


@dataclass
class _Block:
    """An input that is being rewired."""

    target: Port
    cut: list[Port]
    wired: list[Port]


class Grammar:
    """Reads an answer word by word. `allowed` : the words that may come next. `edit` : what was read, once `ended`."""

    def __init__(self, parent: Numbered, vocabulary: Vocabulary) -> None:
        self.parent, self.old = parent, len(parent.kinds)
        self.vocabulary = {kind.name: kind for kind in vocabulary}
        self.kinds: list[ModuleKind] = list(parent.kinds)
        self.swapped: dict[int, ModuleKind] = {}
        self.removed: set[int] = set()
        self.added: list[ModuleKind] = []
        self.sources: dict[Port, list[Port]] = {port: list(found) for port, found in parent.sources.items()}
        self.blocks: list[_Block] = []
        self.owners: dict[Slot, Slot] = {}
        self.owners_of: tuple[int, int, int] | None = None
        self.changed: dict[Slot, Slot] = {}
        self.part = 0
        self.last = -1  # the module that this part named last
        self.inputs: list[Port] = []  # in their order, once the structure stands
        self.input_at = -1
        self.words: list[str] = []  # of the operation under way
        self.ended = False
        self._allowed: list[str] | None = None

    @property
    def edit(self) -> Edit:
        """What was read."""
        before = owners_after(self.parent, self.swapped, self.removed, self.added)
        return Edit(
            tuple(sorted((number, kind.name) for number, kind in self.swapped.items())),
            tuple(sorted(self.removed)),
            tuple(kind.name for kind in self.added),
            tuple(Rewiring(one.target, tuple(sorted(one.cut)), tuple(sorted(one.wired))) for one in self.blocks),
            {slot: owner for slot, owner in sorted(self.changed.items()) if before.get(slot) != owner},
        )

    @property
    def allowed(self) -> list[str]:
        """Words that may come next; where nothing helps any more, the end."""
        if self._allowed is None:
            self._allowed = list(dict.fromkeys(self._next())) or [END]
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

    # --- what may come ------------------------------------------------------------------------------------------------

    def _next(self) -> Iterator[str]:
        if self.ended:
            return
        if self.words:
            yield from getattr(self, f"_next_{_NAMES[self.words[0]]}")()
            return
        yield from self._operations()

    def _operations(self) -> Iterator[str]:
        if self.part == 0 and any(self._exchanges(number) for number in range(self.last + 1, self.old)):
            yield SWAP
        if self.part <= 1 and any(True for _ in self._removable()):
            yield DELETE
        if self.part <= 2 and any(True for _ in self._addable()):
            yield ADD
        if len(self._rotations()) != 1:
            bare = self._bare()
            if self.part <= 3 and any(True for _ in self._targets()):
                yield AT
            if bare:
                return
            yield from self._sharing()
            if self.swapped or self.removed or self.added or self.blocks or self.changed:
                yield END

    def _next_swap(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield from (module_word(one) for one in range(self.last + 1, self.old) if self._exchanges(one))
        else:
            yield from (kind_word(kind.name) for kind in self._exchanges(_number(self.words[1])))

    def _next_delete(self) -> Iterator[str]:
        yield from map(module_word, self._removable())

    def _next_add(self) -> Iterator[str]:
        yield from (kind_word(kind.name) for kind in self._addable())

    def _next_at(self) -> Iterator[str]:
        words = self.words
        if len(words) == 1:
            for number, _ in self._targets():
                yield TERMINAL_CURRENT if number == OUTER else module_word(number)
        elif (target := self._target()) is None:
            number = _number(words[1])
            yield from (f".{port}" for at, port in self._targets() if at == number)
        elif words[-1] in (CUT, WIRE):
            yield from (output_words(one, self.kinds)[0] for one in self._candidates(words[-1], target))
        elif (maker := self._half_named()) is not None:
            mark = next(word for word in reversed(words) if word in (CUT, WIRE))
            yield from (f".{port}" for number, port in self._candidates(mark, target) if number == maker)
        else:
            block = self.blocks[-1] if self.blocks and self.blocks[-1].target == target else None
            if not (block and block.wired) and any(True for _ in self._candidates(CUT, target)):
                yield CUT
            if any(True for _ in self._candidates(WIRE, target)):
                yield WIRE
            if block and self.sources[target]:
                yield from self._operations()

    def _next_same(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield from (module_word(one) for one in self._later() if any(True for _ in self._lenders(one)))
        else:
            yield from map(module_word, self._lenders(_number(self.words[1])))

    def _next_own(self) -> Iterator[str]:
        yield from (module_word(one) for one in self._later() if self._borrows(one))

    def _next_free(self) -> Iterator[str]:
        if len(self.words) == 1:
            yield from (module_word(one) for one in range(max(self.last, 0), len(self.kinds)) if self._borrows(one))
        else:
            number = _number(self.words[1])
            yield from (f"@{name}" for name in self.kinds[number].parameters if self._strange((number, name)))

    def _next_tie(self) -> Iterator[str]:
        words, number = self.words, _number(self.words[1]) if len(self.words) > 1 else -1
        if len(words) == 1:
            yield from (module_word(one) for one in range(max(self.last, 1), len(self.kinds)) if self._tied(one))
        elif len(words) == 2:
            yield from (f"@{name}" for name in self._tied(number))
        elif len(words) == 3:
            yield from (module_word(one) for one in range(number) if self._lent(one, (number, words[2][1:])))
        else:
            yield from (f"@{name}" for name in self._lent(_number(words[3]), (number, words[2][1:])))

    def _exchanges(self, number: int) -> list[ModuleKind]:
        own = self.parent.kinds[number]
        room = HIGHEST_ORDER - self._order() + own.order
        return [kind for kind in self.vocabulary.values() if exchangeable(own, kind) and kind.order <= room]

    def _removable(self) -> Iterator[int]:
        first = self.last + 1 if self.part == 1 else 0
        for number in range(first, self.old):
            if number not in self.swapped and not is_plant(self.parent.kinds[number]):
                yield number

    def _addable(self) -> Iterator[ModuleKind]:
        room, left = HIGHEST_ORDER - self._order(), min(MOST_ADDED - len(self.added), MOST_MODULES - len(self.kinds))
        framed = self._rotations()
        for kind in self.vocabulary.values():
            partner = len(framed) == 1 and kind.name in _ROTATIONS - framed  # the last place is kept for it
            if left > (0 if partner else 1) and not is_plant(kind) and not kind.shares and kind.order <= room:
                yield kind

    def _order(self) -> int:
        return sum(kind.order for number, kind in enumerate(self.kinds) if number not in self.removed)

    def _rotations(self) -> set[str]:
        return _ROTATIONS & {kind.name for number, kind in enumerate(self.kinds) if number not in self.removed}

    def _bare(self) -> list[Port]:
        self._structured()
        return [port for port in self.inputs if not self.sources[port]]

    def _targets(self) -> Iterator[Port]:
        """Inputs that may be rewired next: none may be left behind undriven."""
        self._structured()
        for port in self.inputs[self.input_at + 1 :]:
            if self.sources[port] or any(True for _ in self._candidates(WIRE, port)):
                yield port
            if not self.sources[port]:
                return

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

    def _candidates(self, mark: str, target: Port) -> Iterator[Port]:
        """Outputs that may be cut from an input, or wired to it: in the order of their numbers."""
        block = self.blocks[-1] if self.blocks and self.blocks[-1].target == target else None
        done = [] if block is None else block.cut if mark == CUT else block.wired
        last = max(done, default=(OUTER - 1, ""))
        if mark == CUT:
            have = sorted(self.sources[target])
            only = len(have) == 1 and not any(one != have[0] for one in self._carrying(target))
            yield from (one for one in have if one > last and not only)
            return
        gone, have = block.cut if block else [], self.sources[target]
        for one in self._carrying(target):
            if one > last and one not in have and one not in gone:
                yield one

    def _carrying(self, target: Port) -> Iterator[Port]:
        """Outputs of the signal of an input, in the order of their numbers; the terminals are never joined directly."""
        signal = Signal.DQ_VEC if target == OUT else self.kinds[target[0]].inputs[target[1]]
        if signal is Signal.DQ_VEC and target != OUT:
            yield IN
        for number, kind in enumerate(self.kinds):
            if number not in self.removed:
                for port in sorted(name for name, carried in kind.outputs.items() if carried is signal):
                    yield number, port

    def _sharing(self) -> Iterator[str]:
        later = self._later()
        if any(any(True for _ in self._lenders(one)) for one in later):
            yield SAME
        if any(self._borrows(one) for one in later):
            yield OWN
        first = max(self.last, 0) if self.part == 4 else 0
        if any(self._borrows(one) for one in range(first, len(self.kinds))):
            yield FREE
        if any(self._tied(one) for one in range(max(first, 1), len(self.kinds))):
            yield TIE

    def _later(self) -> range:
        return range(self.last + 1 if self.part == 4 else 0, len(self.kinds))

    def _lenders(self, number: int) -> Iterator[int]:
        """Earlier modules of the same kind whose values a module does not share yet."""
        names = self._free(number)
        if not names or names != list(self.kinds[number].parameters):
            return
        owners = self._owners()
        for other in range(number):
            alike = other not in self.removed and self.kinds[other].name == self.kinds[number].name
            apart = alike and any(owners[number, name] != owners.get((other, name)) for name in names)
            if apart and self._free(other) == names:
                yield other

    def _free(self, number: int) -> list[str]:
        owners = self._owners()
        return [name for name in self.kinds[number].parameters if (number, name) in owners]

    def _strange(self, slot: Slot) -> bool:
        return self._owners().get(slot, slot) != slot

    def _borrows(self, number: int) -> bool:
        return any(self._strange((number, name)) for name in self.kinds[number].parameters)

    def _tied(self, number: int) -> list[str]:
        """Parameters of a module that may take the value of an earlier module's."""
        return [
            name for name in self._free(number) if any(self._lent(other, (number, name)) for other in range(number))
        ]

    def _lent(self, other: int, slot: Slot) -> list[str]:
        """Parameters of an earlier module, of the same unit, whose value this one does not take yet."""
        owners, unit = self._owners(), self.kinds[slot[0]].parameters[slot[1]].unit
        boxes = self.kinds[other].parameters
        return [name for name in self._free(other) if boxes[name].unit == unit and owners[other, name] != owners[slot]]

    def _owners(self) -> dict[Slot, Slot]:
        size = len(self.swapped), len(self.removed), len(self.added)
        if self.owners_of != size:
            self.owners_of = size
            self.owners = owners_after(self.parent, self.swapped, self.removed, self.added)
        return self.owners

    # --- what a word does ---------------------------------------------------------------------------------------------

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
        if len(self.words) == 2:
            kind = self.vocabulary[self.words[1][2:]]
            self.added.append(kind)
            self.kinds.append(kind)
            self.words = []

    def _structured(self) -> None:
        """Settle what is left of the wires once modules are exchanged, gone and new; again when that changes."""
        if self.part >= 3:
            return
        self.sources = after_structure(self.parent, self.swapped, self.removed)
        for index, kind in enumerate(self.added):
            self.sources |= {(self.old + index, port): [] for port in kind.inputs}
        self.inputs = []
        for number in input_order(self.parent, len(self.kinds)):
            if number == OUTER:
                self.inputs.append(OUT)
            elif number not in self.removed:
                self.inputs += [(number, port) for port in self.kinds[number].inputs]

    def _take_at(self) -> None:
        self._structured()
        self._begin(3)
        words = self.words
        target = self._target()
        if target is None or words[-1] in (AT, CUT, WIRE):
            return
        if CUT not in words and WIRE not in words:
            self.input_at = self.inputs.index(target)
            return
        if self._half_named() is not None:
            return
        source = IN if words[-1] == TERMINAL_VOLTAGE else self._source()
        if not self.blocks or self.blocks[-1].target != target:
            self.blocks.append(_Block(target, [], []))
        mark = next(word for word in reversed(words) if word in (CUT, WIRE))
        if mark == CUT:
            self.blocks[-1].cut.append(source)
            self.sources[target].remove(source)
        else:
            self.blocks[-1].wired.append(source)
            self.sources[target].append(source)

    def _source(self) -> Port:
        word = self.words[-1]
        if word.startswith("."):
            return _number(self.words[-2]), word[1:]
        number = _number(word)
        return number, next(iter(self.kinds[number].outputs))

    def _share(self, number: int, owners: dict[Slot, Slot]) -> None:
        self._owners().update(owners)
        self.changed |= owners
        self.last, self.words = number, []

    def _take_same(self) -> None:
        self._begin(4)
        if len(self.words) == 3:
            number, lender = _number(self.words[1]), _number(self.words[2])
            owners = self._owners()
            self._share(number, {(number, name): owners[lender, name] for name in self.kinds[number].parameters})

    def _take_own(self) -> None:
        self._begin(4)
        if len(self.words) == 2:
            number = _number(self.words[1])
            self._share(number, {(number, name): (number, name) for name in self._free(number)})

    def _take_free(self) -> None:
        self._begin(4)
        if len(self.words) == 3:
            slot = _number(self.words[1]), self.words[2][1:]
            self._share(slot[0], {slot: slot})

    def _take_tie(self) -> None:
        self._begin(4)
        if len(self.words) == 5:
            slot = _number(self.words[1]), self.words[2][1:]
            self._share(slot[0], {slot: self._owners()[_number(self.words[3]), self.words[4][1:]]})


_NAMES = {SWAP: "swap", DELETE: "delete", ADD: "add", AT: "at", SAME: "same", OWN: "own", TIE: "tie", FREE: "free"}


def _number(word: str) -> int:
    return int(word[1:])
