"""The form in which the device draws its delays, as far as an answer depends on it: its intervals
hold for every form that the data allow.
"""

from dataclasses import replace
from math import sqrt

from ibrid.evaluation.adequacy import EQUALLY_GOOD
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.gap.trials.delay_forms import over_forms
from ibrid.parts.plant.delay_form import delay_forms
from ibrid.study import Study
from ibrid_search.screening.diagnosis import forms_of
from ibrid_search.screening.merit import Floor
from ibrid_search.screening.rankings import rankings_of


def over_delay_forms(record: Record, study: Study, floor: Floor) -> Record:
    """An answer with intervals that hold in each form of its delays that fits as well, and a
    sentence about it; the same without delays, with parameters of each operating point, and of
    records alone.

    A form fits as well where chi2 is at most `EQUALLY_GOOD.bic` larger; where the noise is not
    known, where the error is within `EQUALLY_GOOD.error_ratio`.
    """
    if (study.parameters, study.equilibrium) != ("shared", "exact") or not (
        forms := forms_of(record.diagram, study)
    ):
        return record
    blind = study.blind
    values, looker = (
        [record.parameters[name] for name in blind.fitted.names],
        rankings_of(blind).looker,
    )
    least = floor.error(record)
    limit = (
        sqrt(least**2 + EQUALLY_GOOD.bic * floor.level**2 / floor.numbers)
        if floor.known
        else EQUALLY_GOOD.error_ratio * least
    )
    looks = [look for form in forms if (look := looker.look(form, values)).values]
    drawn = [record_at(look.edit.diagram, study, look.values[0]) for look in looks]
    alike = [
        one
        for one in drawn
        if one.outcome == Outcome.OK and all(one.stable.values()) and floor.error(one) <= limit
    ]
    if not alike:
        return record
    names = dict.fromkeys(
        form for one in (record, *alike) for form in delay_forms(one.diagram, study.kinds)
    )
    told = (
        f"in which form the device has its delays is not told ({', '.join(names)} fit alike): "
        "intervals hold for all of these"
    )
    intervals = over_forms(record.intervals, [one.intervals for one in alike])
    return replace(record, intervals=intervals, identifiability=(*record.identifiability, told))
