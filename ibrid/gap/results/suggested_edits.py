"""Located, but not in the catalogue: suggested edits pass the tests of an effect, or are shown with
what they fail.

Blocks of low order at the places that could explain everything are always tried; who asks may bring
suggestions of their own: rules, a language model, a colleague.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Protocol

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.gap.datasets.sweep_dataset import SweepDataset
from ibrid.gap.ports.port_kinds import PORT_KINDS
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.cross_validation import ValidationErrors
from ibrid.gap.refitting.model import Model, explains_data, is_significant
from ibrid.gap.results.gap import SuggestedEdit
from ibrid.gap.results.verdict import Findings
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary, usual_kind
from ibrid.parts.editing.edit import Edit, NotInVocabulary
from ibrid.signals import Signal
from ibrid.structure.compiling.check import violations
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text

#: What a block of low order may be, by the signal it shapes.
SHAPES: Mapping[Signal, tuple[Element, ...]] = {
    Signal.SCALAR: (Element.GAIN, Element.LOW_PASS, Element.NOTCH, Element.PADE),
    Signal.DQ_VEC: (Element.GAIN, Element.LOW_PASS, Element.DELAY, Element.PADE),
}
NAME = "residual_block"
#: Places at which blocks are tried, and random starts of every suggestion.
PLACES, DRAWS = 6, 24


@dataclass(frozen=True, eq=False)
class Question:
    """What whoever suggests is told: the model and its record, and the places where one unknown
    transfer explains all, best first, with the transfer that was measured there.
    """

    diagram: Diagram
    record: Record
    ports: tuple[PortFit, ...]
    kinds: Vocabulary
    sweep: Sweep


@dataclass(frozen=True, eq=False)
class Suggestion(Frozen):
    """A diagram that may be the device's.

    `words` : the change in words. `source` : whose idea. `values` : where a fit may begin, besides
    the nominal values and those of the refitted model.
    """

    diagram: Diagram
    words: str
    source: str
    values: Mapping[str, float] | None = None


class Suggest(Protocol):
    """Who is asked for edits."""

    def __call__(self, question: Question, /) -> Iterable[Suggestion]: ...


def low_order_blocks(question: Question) -> Iterator[Suggestion]:
    """A block of low order in place of the unknown transfer, at each of the first places."""
    for fit in question.ports[:PLACES]:
        kinds = (*question.kinds, *PORT_KINDS)
        signal = Edit(fit.port.diagram, kinds).signal(f"{fit.port.block}.in_")
        for element in SHAPES.get(signal, ()):
            draft = Edit(fit.port.diagram, kinds)
            kind = usual_kind(element, signal, question.kinds).name
            try:
                draft.replace(fit.port.block, kind, NAME)
            except NotInVocabulary:
                continue
            yield Suggestion(
                draft.diagram(), f"{kind} at {fit.port.words}", "block of low order", fit.values
            )


def suggested(
    findings: Findings,
    dataset: SweepDataset,
    question: Question,
    suggest: Sequence[Suggest] = (low_order_blocks,),
) -> tuple[SuggestedEdit, ...]:
    """Every suggestion, refitted and put to the tests of a named effect; what passes first, then by
    the fit.

    An illegal diagram, and one without a response, is told with its reason; the same diagram is
    weighed once.
    """
    ideas: dict[str, Suggestion] = {}
    for source in suggest:
        for idea in source(question):
            ideas.setdefault(program_text(idea.diagram), idea)
    if not ideas:
        return ()
    tests, before = (
        findings.tests + len(ideas),
        findings.before or dataset.cross_validate(findings.given),
    )
    rows = [_weighed(findings, dataset, before, one, text, tests) for text, one in ideas.items()]
    return tuple(sorted(rows, key=lambda one: (bool(one.reason), one.chi2_per_dof)))


def _weighed(
    findings: Findings,
    dataset: SweepDataset,
    held: ValidationErrors,
    idea: Suggestion,
    text: str,
    tests: int,
) -> SuggestedEdit:
    given, before = findings.given, findings.given.refit.chi2 / findings.given.refit.dof
    told = SuggestedEdit(idea.words, idea.source, text, float("inf"), before)
    if wrong := violations(idea.diagram, dataset.kinds):
        return replace(told, reason=f"not legal: {wrong[0].message}")
    starts = (
        [given.refit.values, {}] if idea.values is None else [idea.values, given.refit.values, {}]
    )
    dataset.budget.spend()
    try:
        refit = dataset.refitter(given.convention).fit(idea.diagram, starts, draws=DRAWS)
    except (IbridError, ArithmeticError):
        refit = None
    if refit is None:
        return replace(told, reason="has no response")
    model = Model(idea.diagram, given.convention, refit, given.edits)
    reason = _fails(findings, dataset, model, tests)
    after = None if reason else dataset.cross_validate(model)
    return replace(
        told,
        chi2_per_dof=refit.chi2 / refit.dof,
        parameters={
            name: value for name, value in refit.values.items() if name not in given.refit.values
        },
        held_out={} if after is None else {"before": asdict(held), "after": asdict(after)},
        reason=reason,
    )


def _fails(findings: Findings, dataset: SweepDataset, model: Model, tests: int) -> str:
    """Which test of an effect a suggestion fails, "" when none."""
    if not is_significant(findings.given, model, tests, findings.scale):
        return "does not pay"
    if not explains_data(model, findings.noise, findings.scale):
        return "does not fit as well as the noise allows"
    return "" if dataset.is_stable(model) else "unstable"
