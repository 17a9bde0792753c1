"""Which form of a missing limit explains records, from values 15 % off; the device is simulated apart from the package."""

from ibrid_bench.events.cases import draw

from ibrid.gap.event_places import LimitPlace
from ibrid.gap.event_question import asked
from ibrid.structure.library import textbook


def test_of_all_forms_the_limit_that_a_device_has_explains_its_records_with_its_value():
    case = draw("command_limit", 1, 60.0, swept=False)
    question = asked(textbook(case.textbook), case.sweep, case.values, case.events, {"holdout_op": (case.held,)})
    records = question.records(question.prior())
    given = records.given(question.diagram)
    assert given is not None
    assert not given.adequate()
    limits = [one for one in records.insertions(given) if isinstance(one, LimitPlace)]
    fits = [one for one in (records.edited(given, limit) for limit in limits) if one is not None]
    best = min(fits, key=lambda one: one.cost())
    (place,), (told,) = best.edits, case.device.limits.values()
    assert best.adequate()
    assert isinstance(place, LimitPlace)
    assert (place.limit.id, place.limit.windup) == ("command_limit", told["windup"])
    assert abs(best.refit.values["command_limit.u_max"] / told["u_max"] - 1.0) < 1e-3
