"""Which text may come next in an edit of a program: one SEARCH/REPLACE block, spelt out slot by
slot.

SEARCH holds lines of the program that follow one another; REPLACE holds `g.add` of kinds that exist
and `g.connect` between ports that exist and carry the same signal. What SEARCH takes away and
others need, and every input of a new module, is owed before the block may close, and no line is
begun that leaves no room for what is owed. Every slot has finitely many alternatives, none of which
begins another.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from ibrid_search.blocks import split_lines
from ibrid_search.evaluation.judging import judge_program
from ibrid_search.proposal import Context
from ibrid_search.step import Status

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import find_kind
from ibrid.signals import Signal
from ibrid.structure.diagrams.program import program_text

OPEN, MIDDLE, CLOSE = "<<<<<<< SEARCH\n", "=======\n", ">>>>>>> REPLACE\n"
ADD, CONNECT = '    g.add("', '    g.connect("'
V_DQ, I_DQ, PLANT = "v_DQ", "i_DQ", "physical plant"


@dataclass(frozen=True)
class Slot:
    """A place in an edit.

    `begin`, `end` : lines of SEARCH so far. `written` : lines of REPLACE. `partial` : of the
    statement under way: nothing, the kind, or the source and its signal.
    """

    phase: str = "open"
    begin: int = 0
    end: int = 0
    written: tuple[str, ...] = ()
    partial: tuple[str, ...] = ()


class ProgramDraft:
    """A program with the lines of SEARCH taken out and those of REPLACE put in, as far as they are
    written.

    `kinds` : module -> kind. `undriven` : inputs that nothing drives. `idle` : modules that drive
    nothing. `owed` : modules that wires mention and that are gone. `debt` : lines that are enough
    to mend all this.
    """

    def __init__(
        self, lines: list[str], known: Mapping[str, ModuleKind], gone: Mapping[str, ModuleKind]
    ) -> None:
        self.lines = set(lines)
        self.kinds = {
            _words(line)[1]: known[_words(line)[0]] for line in lines if line.startswith(ADD)
        }
        wires = [_words(line) for line in lines if line.startswith(CONNECT)]
        driven = {target for _, target in wires}
        mentioned = {port.partition(".")[0] for wire in wires for port in wire if "." in port}
        self.owed = {
            name: gone[name] for name in sorted(mentioned - self.kinds.keys()) if name in gone
        }
        self.undriven = [one for one in self.inputs if one not in driven]
        self.idle = self.kinds.keys() - {source.partition(".")[0] for source, _ in wires}
        self.debt = (
            len(self.undriven)
            + len(self.idle)
            + sum(
                1 + sum(f"{name}.{port}" not in driven for port in kind.inputs)
                for name, kind in self.owed.items()
            )
        )

    @cached_property
    def inputs(self) -> dict[str, Signal]:
        """Every input with its signal, the outer one too."""
        found = {
            f"{name}.{port}": signal
            for name, kind in self.kinds.items()
            for port, signal in kind.inputs.items()
        }
        return {**found, I_DQ: Signal.DQ_VEC}

    @cached_property
    def outputs(self) -> dict[str, Signal]:
        """Every output with its signal, the outer one too."""
        found = {
            f"{name}.{port}": signal
            for name, kind in self.kinds.items()
            for port, signal in kind.outputs.items()
        }
        return {V_DQ: Signal.DQ_VEC, **found}


class EditAutomaton:
    """The alternatives of every slot for one parent.

    lines : of SEARCH and of REPLACE at most. legal_end : the block is closed only where it makes a
    legal diagram that is not its parent's, or where no further line has room.
    """

    def __init__(self, context: Context, *, lines: int = 12, legal_end: bool = True) -> None:
        self.study, self.most, self.legal_end = context.study, lines, legal_end
        self.program = split_lines(program_text(context.parent.diagram))
        self.known = {one.name: one for one in self.study.kinds}
        self.adding = {_words(line)[1]: line for line in self.program if line.startswith(ADD)}
        self.kind_of = {
            one.name: find_kind(one.kind, self.study.kinds)
            for one in context.parent.diagram.instances
        }
        self.parent = judge_program("\n".join(self.program) + "\n", self.study).hash
        self._alternatives: dict[Slot, Mapping[str, Slot]] = {}
        self._drafts: dict[Slot, ProgramDraft] = {}

    def alternatives(self, slot: Slot) -> Mapping[str, Slot]:
        """Text -> slot after it; nothing when the edit is whole."""
        if slot not in self._alternatives:
            self._alternatives[slot] = getattr(self, f"_{slot.phase}")(slot)
        return self._alternatives[slot]

    def _open(self, slot: Slot) -> Mapping[str, Slot]:
        return {OPEN: replace(slot, phase="first")}

    def _first(self, slot: Slot) -> Mapping[str, Slot]:
        """Any line but the head of the function."""
        found = {line: Slot("search", line, line + 1) for line in range(1, len(self.program))}
        return {
            f"{self.program[line]}\n": after
            for line, after in found.items()
            if self._payable(after)
        }

    def _search(self, slot: Slot) -> Mapping[str, Slot]:
        found = {MIDDLE: replace(slot, phase="replace")}
        longer = replace(slot, end=slot.end + 1)
        if (
            slot.end < len(self.program)
            and longer.end - slot.begin <= self.most
            and self._payable(longer)
        ):
            found[f"{self.program[slot.end]}\n"] = longer
        return found

    def _replace(self, slot: Slot) -> Mapping[str, Slot]:
        found = {}
        if self._room(slot) > 0:
            begun = {ADD: replace(slot, phase="kind"), CONNECT: replace(slot, phase="source")}
            found = {text: after for text, after in begun.items() if self.alternatives(after)}
        stuck = self._room(slot) <= 0 or not found
        if stuck or (
            not self._draft(slot).debt and (not self.legal_end or self._makes_sense(slot))
        ):
            found[CLOSE] = Slot("done")
        return found

    def _done(self, slot: Slot) -> Mapping[str, Slot]:
        return {}

    def _kind(self, slot: Slot) -> Mapping[str, Slot]:
        found = {name: replace(slot, phase="name", partial=(name,)) for name in self.known}
        return {f'{name}", "': after for name, after in found.items() if self.alternatives(after)}

    def _name(self, slot: Slot) -> Mapping[str, Slot]:
        """A module that is owed, of its kind or one with the same ports; a new one, where there is
        room to wire it.
        """
        (name,) = slot.partial
        kind, draft = self.known[name], self._draft(slot)
        lines = []
        for module, before in draft.owed.items():
            if before.name == name:
                lines.append(self.adding[module])
            elif (dict(before.inputs), dict(before.outputs)) == (
                dict(kind.inputs),
                dict(kind.outputs),
            ):
                lines.append(f'{ADD}{name}", "{module}")')
        spare = self._room(slot) - draft.debt
        if 2 + len(kind.inputs) <= spare and not (kind.family == PLANT and self._has_plant(draft)):
            taken = {*self.kind_of, *draft.kinds}
            fresh = (f"{name.lower()}_{number}" for number in range(1, 99))
            lines.append(f'{ADD}{name}", "{next(one for one in fresh if one not in taken)}")')
        return {
            line.removeprefix(f'{ADD}{name}", "') + "\n": self._after(slot, line) for line in lines
        }

    def _source(self, slot: Slot) -> Mapping[str, Slot]:
        found = {
            one: signal
            for one, signal in self._draft(slot).outputs.items()
            if self._targets(slot, one, signal)
        }
        return {
            f'{one}", "': replace(slot, phase="target", partial=(one, signal))
            for one, signal in found.items()
        }

    def _target(self, slot: Slot) -> Mapping[str, Slot]:
        source, signal = slot.partial
        found = self._targets(slot, source, Signal(signal))
        return {f'{one}")\n': self._after(slot, f'{CONNECT}{source}", "{one}")') for one in found}

    def _targets(self, slot: Slot, source: str, signal: Signal) -> list[str]:
        """Inputs of this signal that the source does not drive yet; only undriven ones where there
        is no room for others.
        """
        draft = self._draft(slot)
        useful = source.partition(".")[0] in draft.idle
        ports = draft.inputs if useful or self._room(slot) > draft.debt else draft.undriven
        fitting = [one for one in ports if draft.inputs[one] is signal]
        return [one for one in fitting if f'{CONNECT}{source}", "{one}")' not in draft.lines]

    def _room(self, slot: Slot) -> int:
        return self.most - len(slot.written)

    def _payable(self, slot: Slot) -> bool:
        return self._draft(slot).debt <= self.most

    def _after(self, slot: Slot, line: str) -> Slot:
        return Slot("replace", slot.begin, slot.end, (*slot.written, line))

    def _draft(self, slot: Slot) -> ProgramDraft:
        plain = Slot("", slot.begin, slot.end, slot.written)
        if plain not in self._drafts:
            self._drafts[plain] = ProgramDraft(self._lines(slot), self.known, self.kind_of)
        return self._drafts[plain]

    def _lines(self, slot: Slot) -> list[str]:
        return [*self.program[: slot.begin], *slot.written, *self.program[slot.end :]]

    def _has_plant(self, draft: ProgramDraft) -> bool:
        return any(kind.family == PLANT for kind in (*draft.kinds.values(), *draft.owed.values()))

    def _makes_sense(self, slot: Slot) -> bool:
        verdict = judge_program(
            "\n".join(self._lines(slot)) + "\n", self.study, parent_hash=self.parent
        )
        return verdict.status is Status.PENDING


def _words(line: str) -> tuple[str, str]:
    """The first two texts of a statement."""
    _, first, _, second, *_ = line.split('"')
    return first, second
