"""Labels of data as data with uncertainty: a fitted diagram on the sweep as it would read with
another label.

A wrong label is believed where it explains what a fit alone does not: with it the grade is better,
or it is a usual mistake and takes most of the squared misfit away, and no operating point is worse
off. Nothing else is certain enough beside a diagram that may itself be wrong.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import log

from ibrid.evaluation.grade import Grade
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.fit.settings import FitSettings
from ibrid.measurement.conventions.frequency_base import USUAL as USUAL_FREQUENCIES
from ibrid.measurement.conventions.labels import (
    FRAME,
    FREQUENCY,
    ROTATION,
    SECTORS,
    Convention,
    written_otherwise,
)
from ibrid.measurement.conventions.rotation import half_turn
from ibrid.structure.compiling.compiled import CompiledDiagram
from ibrid.structure.network.outside import LABEL, LABELS, PEAKS
from ibrid.study import Study

#: |ln| within which a label is tried at a usual number, and for how many free numbers any other one
#: counts: a scale of sqrt 2, sqrt 3 or 3/2 is far more probable than another.
USUAL, UNUSUAL = 0.04, 2
#: Part of chi2 that is left where a usual mistake is put right.
LEFT = 0.5
#: A fit that begins at the values of another.
WARM = FitSettings(starts=32, kept=4, kept_misfit=4, restarts=0, hops=0)
_GRADES = list(Grade)

Evaluate = Callable[[CompiledDiagram, Study, FitSettings, Record], Record]


def read_otherwise(
    record: Record, compiled: CompiledDiagram, study: Study, effort: FitSettings, evaluate: Evaluate
) -> Record:
    """The record of the same diagram on the data as they read with the label that is wrong, which
    it names in `labels`; the given one where none is.

    record : of the diagram, behind its port, as the labels say. evaluate : (diagram, study, effort,
    record to begin at).
    """
    if record.outcome != Outcome.OK or record.grade == Grade.EXPLAINS:
        return record
    believed = replace(study, labels="exact")
    quick = replace(WARM, objective=effort.objective)

    def fitted(
        convention: Convention, thorough: FitSettings = quick, before: Record = record
    ) -> Record:
        return evaluate(
            compiled, replace(believed, sweep=convention.undone(study.sweep)), thorough, before
        )

    words = (one for one in written_otherwise(study.sweep) if one.ids)
    tried = [
        (one, fitted(one))
        for one in (*words, *_numbers(record, compiled, believed, quick, evaluate))
    ]
    candidates = sorted(
        ((one, other) for one, other in tried if _explains_far_more(one, record, other)),
        key=lambda pair: _left(pair[1]),
    )
    if not candidates:
        return record
    near = [
        pair
        for pair in candidates
        if _left(pair[1]) < EQUALLY_GOOD.chi2_ratio * _left(candidates[0][1])
    ]
    convention, best = min(near, key=lambda pair: _likely(pair[0]))
    rivals = [one for one, _ in near if one is not convention]
    alike = dict.fromkeys(name for one in rivals for name in one.ids)
    also = "".join(
        f" As likely: {one.words}." for one in rivals if one.ids.keys() == convention.ids.keys()
    )
    best = fitted(convention, effort, best)
    told = tuple(
        {
            "id": name,
            **numbers,
            "sentence": f"{convention.words[0].upper()}{convention.words[1:]}. "
            f"{convention.remedy}{also}",
            "indistinguishable_from": [
                *(other for other in alike if other not in convention.ids),
                *convention.equivalents.get(name, ()),
            ],
        }
        for name, numbers in convention.ids.items()
    )
    return replace(best, labels=told, settings={**best.settings, "labels": study.labels})


def usual_first(label: str, value: float) -> Iterator[tuple[float, int]]:
    """A label's number and the free numbers it counts for: usual ones beside it for none, for
    itself two.
    """
    if LABELS[label].low > 0:
        yield from ((peak, 0) for peak in PEAKS[1:] if abs(log(value / peak)) < USUAL)
    yield value, UNUSUAL if LABELS[label].low > 0 else 1


def _numbers(
    record: Record, compiled: CompiledDiagram, study: Study, effort: FitSettings, evaluate: Evaluate
) -> Iterator[Convention]:
    """Labels with a number, each at the one that a fit with it free ends at, and at the usual one
    beside that.
    """
    for label in LABELS:
        free = evaluate(_doubting(compiled, label), study, effort, record)
        if free.outcome == Outcome.OK:
            value = next(iter(free.parameters.values()))[f"{LABEL}.{label}"]
            yield from (Convention.of(label, number) for number, _ in usual_first(label, value))
    yield from _turned_frames(record, compiled, study, effort, evaluate)


def _turned_frames(
    record: Record, compiled: CompiledDiagram, study: Study, effort: FitSettings, evaluate: Evaluate
) -> Iterator[Convention]:
    """A frame turned beyond what is called misaligned, and one turned by another angle at each
    operating point.
    """
    doubted = _doubting(compiled, FRAME)
    for sector in SECTORS:
        free = evaluate(
            doubted,
            replace(study, sweep=Convention(angle=sector).undone(study.sweep)),
            effort,
            record,
        )
        if free.outcome == Outcome.OK:
            value = next(iter(free.parameters.values()))[f"{LABEL}.{FRAME}"]
            yield Convention(angle=half_turn(sector + value))
    if len(study.fitted.points) > 1:
        free = evaluate(_doubting(compiled, ROTATION), study, effort, record)
        if free.outcome == Outcome.OK:
            angles = {
                name: half_turn(values[f"{LABEL}.{ROTATION}"])
                for name, values in free.parameters.items()
            }
            yield Convention(angles=tuple(angles.items()))


def _doubting(compiled: CompiledDiagram, label: str) -> CompiledDiagram:
    """The same diagram with one more label free."""
    outside = compiled.diagram.outside
    return compiled.behind(replace(outside, labels=(*outside.labels, label)))


def _explains_far_more(convention: Convention, before: Record, after: Record) -> bool:
    if after.outcome != Outcome.OK or not all(after.stable.values()):
        return False
    if any(after.nrmse_by_op[name] >= error for name, error in before.nrmse_by_op.items()):
        return False
    usual = is_usual(convention)
    better = _GRADES.index(Grade(str(after.grade))) < _GRADES.index(Grade(str(before.grade)))
    return _left(after) < LEFT * _left(before) and (
        usual or (better and after.grade in (Grade.EXPLAINS, Grade.CLOSE))
    )


def is_usual(convention: Convention) -> bool:
    """True for what is often mistaken: a sign, an axis, the node, a usual frequency, or a scale of
    `PEAKS`.
    """
    return _likely(convention)[0] < len(PEAKS)


def _likely(convention: Convention) -> tuple[int, int]:
    """Place of a label's number among the usual mistakes, beyond them where it is none, and last
    with one for each operating point, 0 without a number; and of the label.
    """
    wrong = convention.ids
    frequency = wrong.pop(FREQUENCY, None)
    if convention.angles:
        return len(PEAKS) + 1, -1
    numbers = [number for one in wrong.values() for number in one.values()]
    if frequency and frequency["f0_hz"] not in USUAL_FREQUENCIES:
        numbers.append(frequency["f0_hz"])
    place = max((PEAKS.index(one) if one in PEAKS else len(PEAKS) for one in numbers), default=0)
    return place, max(
        (list(LABELS).index(name) for name in convention.ids if name in LABELS), default=-1
    )


def _left(record: Record) -> float:
    """chi2 per degree of freedom; infinite where a fit says nothing."""
    ratio = (record.misfit or {}).get("chi2_per_dof")
    return float("inf") if ratio is None else float(ratio)
