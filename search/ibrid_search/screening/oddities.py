"""What an engineer would doubt: what cannot be an inverter before anything is fitted, and what is
odd in a fit however good.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, sqrt
from types import MappingProxyType

from ibrid.evaluation.record import Record
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.view import views_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.grammar_rules.violation import Violation
from ibrid.structure.reading.wiring import PLANT

#: A plant parameter further than this factor from its usual value is absurd; a small resistance is
#: not, it is just unseen.
ABSURD = 30.0
NOTHING: Mapping[str, tuple[float, float]] = MappingProxyType({})


@dataclass(frozen=True)
class Oddities:
    """`missing` : control layers that are not there; of two devices those of the one that lacks
    fewer.
    `at_bound` : parameters at the end of their box: a block that does nothing, say. `absurd` :
    plant parameters that stand in for a controller, such as a resistance of 1 per unit; with known
    noise only those that the data do not leave open. `residual` : modules that fit anything and
    mean little, which is a reason to look further, but none to doubt the rest. `impossible` :
    values that no device has (`impossible_values`): such a fit is never the answer, and it is no
    more doubtful as a parent.
    """

    missing: int = 0
    at_bound: int = 0
    absurd: int = 0
    residual: int = 0
    impossible: int = 0

    @property
    def total(self) -> int:
        """All that is doubtful, together."""
        return self.missing + self.at_bound + self.absurd


#: Nothing to doubt.
SOUND = Oddities()


def oddities(diagram: Diagram, record: Record, kinds: Vocabulary) -> Oddities:
    """Count them in a fitted diagram."""
    return Oddities(
        missing=min((view.roles.missing_layers for view in views_of(diagram, kinds)), default=0),
        at_bound=len(record.at_bound),
        absurd=max((_absurd(diagram, record, op, kinds) for op in record.parameters), default=0),
        residual=record.residual_modules,
        impossible=len(impossible_values(record)),
    )


def impossible_values(record: Record) -> tuple[str, ...]:
    """Fitted parameters that ended where physics has nothing, as the boxes of their kinds say.

    Those are a share of the power at either end of its box, where a device delivers nothing or
    everything and the other is none; and a plant parameter at the upper end of its box, unless the
    data leave it open. At its lower end a plant parameter is just not there, and a controller's box
    is what is tried, no law.
    """
    kinds = {kind.name: kind for kind in record.vocabulary}
    ended = {label.split(" at ")[0] for label in record.at_bound}
    impossible = dict[str, None]()
    for instance in record.diagram.instances if ended else ():
        kind = kinds[instance.kind]
        for name in (*kind.shares, *(kind.parameters if kind.family == PLANT else ())):
            bound = instance.bindings.get(name)
            label = bound if isinstance(bound, str) else f"{instance.name}.{name}"
            if label in ended and (name in kind.shares or _at_upper_end(label, record)):
                impossible[label] = None
    return tuple(impossible)


def _at_upper_end(label: str, record: Record) -> bool:
    """True at an operating point at which the data tell a positive value that is nearer to the
    upper end of its box.
    """
    low, high = record.boxes[label]["low"], record.boxes[label]["high"]
    return any(
        values[label] > sqrt(max(low, 0.0) * high)
        and record.intervals.get(op, {}).get(label) is not None
        for op, values in record.parameters.items()
    )


def _absurd(diagram: Diagram, record: Record, op: str, kinds: Vocabulary) -> int:
    values = record.parameters[op]
    if record.over_noise is None:
        return absurd(diagram, values, kinds)
    intervals = record.intervals.get(op, {})
    return absurd(
        diagram, values, kinds, {name: _wide(values[name], one) for name, one in intervals.items()}
    )


def _wide(value: float, interval: Sequence[float] | None) -> tuple[float, float]:
    """Twice an interval of a positive value in its logarithm: beyond that the data do not leave it
    open.
    """
    if interval is None or value <= 0 or min(interval) <= 0:
        return 0.0, inf
    return interval[0] ** 2 / value, interval[1] ** 2 / value


def absurd(
    diagram: Diagram,
    values: Mapping[str, float],
    kinds: Vocabulary,
    open_: Mapping[str, tuple[float, float]] = NOTHING,
) -> int:
    """How many plant parameters of an operating point are.

    open_ : name -> within which the data leave the value.
    """
    by_name, count = {kind.name: kind for kind in kinds}, 0
    for instance in diagram.instances:
        kind = by_name[instance.kind]
        for name, box in kind.parameters.items() if kind.family == PLANT else ():
            bound = instance.bindings.get(name)
            label = bound if isinstance(bound, str) else f"{instance.name}.{name}"
            value = values.get(label, box.typical)
            least, most = open_.get(label, (value, value))
            low = 0.0 if name.startswith("R_") else box.typical / ABSURD
            count += not (low <= most and least <= box.typical * ABSURD)
    return count


#: Warnings of the checker that a search takes as refusals, each a slip that a fit would only hide.
GATES = ("one_rotation", "voltage_unused", "idle_module", "coupling_unit")


def implausible(warnings: tuple[Violation, ...]) -> str:
    """Why a legal diagram is refused, in sentences; "" when it may be fitted.

    Half a frame (one rotation without the other), a terminal voltage that changes nothing, a module
    without a way to the terminal current, and a decoupling whose per-unit inductance stands for
    seconds (off by omega_0).
    """
    return "; ".join(str(one) for one in warnings if one.reason in GATES)
