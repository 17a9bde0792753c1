"""Confidence intervals that hold for every form of the delays that the data allow.

Whether a device implements its delays exactly, as a hold or as a Pade approximation is often not
identifiable, and each form shifts the other parameters.
"""

from dataclasses import replace
from math import sqrt

from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.gap.delay_forms import unite_intervals
from ibrid.parts.plant.delay_form import delay_forms
from ibrid.study import Study
from ibrid_search.screening.candidate_edits import list_delay_form_edits
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.selection_criterion import NoiseFloor


def widen_over_delay_forms(record: Record, study: Study, floor: NoiseFloor) -> Record:
    """Widen the confidence intervals of a fit over the equally good forms of its delays.

    Each other form of the delays is screened from the fitted values. A form fits equally well where
    its chi2 is at most `EQUALLY_GOOD.bic` larger, or, with unknown noise, where its error is within
    `EQUALLY_GOOD.error_ratio`.

    Returns
    -------
    Record
        With widened intervals and a sentence on the forms in `identifiability`. The record itself
        where it has no delays, where no other form fits as well, and for recordings alone, separate
        parameters for each operating point or the approximate equilibrium of the paper.
    """
    if (study.parameters, study.equilibrium) != ("shared", "exact"):
        return record
    form_edits = list_delay_form_edits(record.diagram, study)
    if not form_edits:
        return record

    blind = study.blind
    values = [record.parameters[name] for name in blind.fitted.names]
    screener = rankings_for(blind).screener
    largest_error = _largest_equal_error(record, floor)
    equivalents = []
    for edit in form_edits:
        fit = screener.screen_from_parent(edit, values)
        if not fit.values:
            continue
        equivalent = record_at(fit.edit.diagram, study, fit.values[0])
        if equivalent.outcome != Outcome.OK or not all(equivalent.stable.values()):
            continue
        if floor.error_of(equivalent) <= largest_error:
            equivalents.append(equivalent)
    if not equivalents:
        return record

    forms = dict.fromkeys(
        form
        for equivalent in (record, *equivalents)
        for form in delay_forms(equivalent.diagram, study.kinds)
    )
    sentence = (
        f"the form of the device's delays is not identifiable ({', '.join(forms)} fit equally "
        "well): the intervals hold for all of these"
    )
    intervals = unite_intervals(record.intervals, [form.intervals for form in equivalents])
    return replace(record, intervals=intervals, identifiability=(*record.identifiability, sentence))


def _largest_equal_error(record: Record, floor: NoiseFloor) -> float:
    """Return the largest error of a model that fits as well as the record.

    With known noise chi2 = n (error / level)^2, so that an increase of chi2 by D is an increase of
    error^2 by D level^2 / n.
    """
    error = floor.error_of(record)
    if not floor.known:
        return EQUALLY_GOOD.error_ratio * error
    return sqrt(error**2 + EQUALLY_GOOD.bic * floor.level**2 / floor.number_count)
