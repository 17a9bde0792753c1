"""Suggested edits where something is located that the catalogue does not know.

A suggestion is refitted and passes the tests of a named effect, or is reported with the test that
it fails. Low-order blocks at the ports that could explain everything are always tried; callers may
add sources of their own: rules, a language model, a colleague.
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

#: Elements that a low-order block may be, by the signal that it filters.
LOW_ORDER_ELEMENTS: Mapping[Signal, tuple[Element, ...]] = {
    Signal.SCALAR: (Element.GAIN, Element.LOW_PASS, Element.NOTCH, Element.PADE),
    Signal.DQ_VEC: (Element.GAIN, Element.LOW_PASS, Element.DELAY, Element.PADE),
}
BLOCK_NAME = "residual_block"
#: Ports at which low-order blocks are tried, and random starts of each suggestion.
MOST_PORTS = 6
DRAWS = 24


@dataclass(frozen=True, eq=False)
class SuggestionRequest:
    """What a source of suggestions is given.

    Parameters
    ----------
    diagram : Diagram
        The given model.
    record : Record
        Of the refitted model.
    ports : tuple of PortFit
        Ports at which one unknown transfer function explains the data, best first, with that.
    kinds : Vocabulary
        Module kinds that a suggestion may use.
    sweep : Sweep
        The measured data.
    """

    diagram: Diagram
    record: Record
    ports: tuple[PortFit, ...]
    kinds: Vocabulary
    sweep: Sweep


@dataclass(frozen=True, eq=False)
class Suggestion(Frozen):
    """A diagram that may be that of the device.

    Parameters
    ----------
    words : str
        The change in words.
    source : str
        Who or what suggests it.
    values : mapping, optional
        Where a fit may begin, besides the nominal values and those of the refitted model.
    """

    diagram: Diagram
    words: str
    source: str
    values: Mapping[str, float] | None = None


class Suggest(Protocol):
    """A source of suggestions."""

    def __call__(self, question: SuggestionRequest, /) -> Iterable[Suggestion]: ...


def low_order_blocks(request: SuggestionRequest) -> Iterator[Suggestion]:
    """Suggest a low-order block in place of the unknown transfer function, at the first ports."""
    for port_fit in request.ports[:MOST_PORTS]:
        port = port_fit.port
        kinds = (*request.kinds, *PORT_KINDS)
        signal = Edit(port.diagram, kinds).signal(f"{port.block}.in_")
        for element in LOW_ORDER_ELEMENTS.get(signal, ()):
            draft = Edit(port.diagram, kinds)
            kind = usual_kind(element, signal, request.kinds).name
            try:
                draft.replace(port.block, kind, BLOCK_NAME)
            except NotInVocabulary:
                continue
            words = f"{kind} at {port.words}"
            yield Suggestion(draft.diagram(), words, "block of low order", port_fit.values)


def check_suggestions(
    findings: Findings,
    dataset: SweepDataset,
    request: SuggestionRequest,
    suggest: Sequence[Suggest] = (low_order_blocks,),
) -> tuple[SuggestedEdit, ...]:
    """Refit every suggestion and put it to the tests of a named effect.

    Those that pass come first, then by chi2 per degree of freedom. An illegal diagram, and one
    without a response, is reported with that; equal diagrams are tried once.
    """
    suggestions: dict[str, Suggestion] = {}
    for source in suggest:
        for suggestion in source(request):
            suggestions.setdefault(program_text(suggestion.diagram), suggestion)
    if not suggestions:
        return ()
    tests = findings.tests + len(suggestions)
    errors_before = findings.before or dataset.cross_validate(findings.given)
    checked = [
        _check_suggestion(findings, dataset, errors_before, suggestion, program, tests)
        for program, suggestion in suggestions.items()
    ]
    return tuple(sorted(checked, key=lambda edit: (bool(edit.reason), edit.chi2_per_dof)))


def _check_suggestion(
    findings: Findings,
    dataset: SweepDataset,
    errors_before: ValidationErrors,
    suggestion: Suggestion,
    program: str,
    tests: int,
) -> SuggestedEdit:
    """Refit a suggestion, one of so many tests, and check it."""
    given = findings.given
    diagram = suggestion.diagram
    before = given.refit.chi2 / given.refit.dof
    checked = SuggestedEdit(suggestion.words, suggestion.source, program, float("inf"), before)
    illegal = violations(diagram, dataset.kinds)
    if illegal:
        return replace(checked, reason=f"not legal: {illegal[0].message}")
    starts = [given.refit.values, {}]
    if suggestion.values is not None:
        starts.insert(0, suggestion.values)
    dataset.budget.spend()
    try:
        refit = dataset.fitter_for(given.convention).fit(diagram, starts, draws=DRAWS)
    except (IbridError, ArithmeticError):
        refit = None
    if refit is None:
        return replace(checked, reason="has no response")
    model = Model(diagram, given.convention, refit, given.edits)
    reason = _find_failed_test(findings, dataset, model, tests)
    held_out = {}
    if not reason:
        errors_after = dataset.cross_validate(model)
        held_out = {"before": asdict(errors_before), "after": asdict(errors_after)}
    added = {name: value for name, value in refit.values.items() if name not in given.refit.values}
    return replace(
        checked,
        chi2_per_dof=refit.chi2 / refit.dof,
        parameters=added,
        held_out=held_out,
        reason=reason,
    )


def _find_failed_test(findings: Findings, dataset: SweepDataset, model: Model, tests: int) -> str:
    """Return the test of a named effect that a model fails; "" where it passes all."""
    if not is_significant(findings.given, model, tests, findings.scale):
        return "does not pay"
    if not explains_data(model, findings.noise, findings.scale):
        return "does not fit as well as the noise allows"
    return "" if dataset.is_stable(model) else "unstable"
