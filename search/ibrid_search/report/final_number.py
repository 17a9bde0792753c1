"""Why the number that a search ends with is not the last of its curve; evaluations as the
one counter of a page.
"""

from collections.abc import Iterator, Mapping

from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import BETTER
from ibrid.report.look.numbers import error
from ibrid_search.report.run_data import RunData
from ibrid_search.run.trajectory import ROUNDING, Point
from ibrid_search.screening.plausibility import count_issues, find_impossible_values


def number_evaluations(run: RunData) -> Mapping[int, int]:
    """Step -> the number of its evaluation, the one counter of a page."""
    return {point.step: point.evaluation for point in run.points}


def rival_words(run: RunData) -> tuple[str, ...]:
    """The sentences about rivals, which name a step, by the numbers of their evaluations."""
    numbers = number_evaluations(run)
    words = []
    for sentence, step in zip(run.selection.rivals, run.selection.rival_steps, strict=False):
        begin = f"step {step} "
        number = f"evaluation {numbers[step]} " if step in numbers else begin
        words.append(number + sentence.removeprefix(begin) if begin in sentence[:20] else sentence)
    return tuple(words) or run.selection.rivals


def explain_final_number(run: RunData) -> tuple[str, ...]:
    """Why the error of the answer is not the lowest of the curve; nothing where it is."""
    if run.answer is None or run.answer.nrmse is None:
        return ()
    return (*_not_the_lowest(run), *_fitted_again(run))


def _not_the_lowest(run: RunData) -> Iterator[str]:
    lowest = _lowest(run.points)
    answer = run.answer
    if lowest is None or lowest.nrmse is None or answer is None or answer.nrmse is None:
        return
    if answer.nrmse <= max((1 + BETTER.tie) * lowest.nrmse, ROUNDING):
        return
    numbers = number_evaluations(run)
    where = f"evaluation {numbers[answer.number]}" if answer.number in numbers else "the answer"
    yield (
        f"The curve goes down to {error(lowest.nrmse)} at evaluation {lowest.evaluation}; the "
        f"answer is {where} with {error(answer.nrmse)}."
    )
    reasons = [*_against(run, lowest)]
    if reasons:
        yield f"Against evaluation {lowest.evaluation} counts: {'; '.join(reasons)}."
    if run.selection.why:
        yield f"The answer was chosen since {run.selection.why}."


def _lowest(points: tuple[Point, ...]) -> Point | None:
    """The evaluation with the least error of those that may be the best."""
    able = [point for point in points if point.stable and point.nrmse is not None]
    return min(able, key=lambda point: (point.nrmse, point.evaluation), default=None)


def _against(run: RunData, lowest: Point) -> Iterator[str]:
    """What the search holds against the model with the least error."""
    step, record, answer = run.steps[lowest.step], run.records.get(lowest.step), run.answer
    if answer is not None and (step.free or 0) > (answer.free or 0):
        yield f"{step.free} free parameters against {answer.free}"
    if record is None:
        return
    if impossible := find_impossible_values(record):
        yield f"values that no device has ({', '.join(impossible)})"
    issues = count_issues(record.diagram, record, run.kinds)
    if issues.missing:
        yield f"control layers that are missing ({issues.missing})"
    if issues.at_bound:
        yield f"parameters at an end of their box ({', '.join(record.at_bound)})"
    if issues.absurd:
        yield f"plant parameters far from usual ones ({issues.absurd})"


def _fitted_again(run: RunData) -> Iterator[str]:
    final, answer = run.final, run.answer
    if final is None or final.nrmse is None or answer is None or answer.nrmse is None:
        return
    if abs(final.nrmse - answer.nrmse) <= max(BETTER.tie * answer.nrmse, ROUNDING):
        return
    yield (
        f"best.json has {error(final.nrmse)}: after the search the answer was fitted again, "
        f"{_how(final)}; the curve has the fits made during the search."
    )


def _how(final: Record) -> str:
    together = bool(final.nrmse_by_record) and bool(final.nrmse_by_op)
    return "to sweep and records of events together" if together else "with full effort"
