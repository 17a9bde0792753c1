"""A record as a nonlinear averaged model: the laws of its modules joined, at rest and linear there
as the record says.
"""

from ibrid.analysis.models.linear_model import linear_model, whole_record, with_point
from ibrid.assembly.averaged import NonlinearModel, assembled
from ibrid.assembly.rest import Rest, rest
from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import Wiring

#: What the numbers of every nonlinear export mean.
ABSOLUTE = (
    "Absolute quantities, per unit on the inverter's base, time in s, angles in rad; v and i are "
    "(D, Q) in a frame that turns at "
    "omega_0, current out of the inverter, q axis leading d; averaged over a switching period"
)


@takes_kinds
def nonlinear_model(record: Record, op: str | None = None) -> NonlinearModel:
    """The nonlinear averaged model of a record at an operating point, as `linear_model` takes it.

    Delays are the Pade forms of the record. Raises as `linear_model`, and IbridError for a record
    of the paper's equilibrium, whose matrices linearise nothing; ModuleError for a kind without a
    large-signal law.
    """
    linear_model(
        record, op
    )  # what has no linear model has none at all, and is refused in the same words
    with whole_record():
        whole, name = with_point(record, op)
        wiring, at = rest_of_record(whole, name)
        return assembled(wiring, at)


def rest_of_record(record: Record, op: str) -> tuple[Wiring, Rest]:
    """Wiring and operating point of a record at one of its points; raises as `nonlinear_model`."""
    settings = record.settings
    if settings["equilibrium"] != "exact":
        raise IbridError(
            "a nonlinear model needs a record with the exact equilibrium, found equilibrium "
            f"{settings['equilibrium']!r}; evaluate with --equilibrium exact, or export the linear "
            "model"
        )
    wiring, physics = record.wiring, record.physics
    at = rest(
        wiring,
        parameter_table(wiring, "exact"),
        record.parameters[op],
        record.point(op).pqv,
        power_node=physics["power_node"],
        omega_0=physics["omega_0"],
        pade_orders=settings["pade_orders"],
    )
    return wiring, at
