"""What the figures and tables of a gap compare: measurement, model as given, refitted and repaired, and the noise."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.convention import Convention, rotation
from ibrid.gap.noise import noise_of
from ibrid.gap.result import Gap
from ibrid.measurement.sweep import PointSweep
from ibrid.report.bode import Curves, line_frequency

#: Points of a model line.
DENSE = 240
#: Colours and dashes (`ibrid.report.style.series`) of the model's three states, also of their words in legends.
REPAIRED, REFITTED, GIVEN = 0, 1, 3


@dataclass(frozen=True, eq=False)
class Line:
    """A state of the model at one operating point. `name` : in legends. `index` : of its colour. `at_data` : (K, 2, 2) at the
    measured frequencies. `frequency`, `response` : (N,) Hz and (N, 2, 2), the same between them."""

    name: str
    index: int
    at_data: np.ndarray
    frequency: np.ndarray
    response: np.ndarray


@dataclass(frozen=True, eq=False)
class PointView:
    """One operating point. `point` : the measurement with the sigma it is judged by, whose noise is `known` or only taken
    to be no smaller. `held_out` : predicted, not fitted. `lines` : as given, refitted, repaired, as far as there are."""

    point: PointSweep
    known: bool
    held_out: bool
    lines: tuple[Line, ...]

    @property
    def name(self) -> str:
        """The operating point."""
        return self.point.op.name

    @cached_property
    def noise(self) -> np.ndarray:
        """Root mean square of the noise of each complex number, (K, 2, 2)."""
        return np.sqrt(2.0) * np.asarray(self.point.sigma)

    @cached_property
    def curves(self) -> tuple[Curves, ...]:
        """For `draw_bode`: the lines, the measurement with the last of them."""
        dots = self.point if self.known else replace(self.point, sigma=None)
        last = len(self.lines) - 1
        return tuple(
            Curves(one.name, one.index, dots if number == last else None, one.frequency, one.response)
            for number, one in enumerate(self.lines)
        )


def repaired(gap: Gap) -> bool:
    """True when there is a model after the repair beside the refitted one."""
    return gap.repaired is not gap.baseline


def convention_of(gap: Gap) -> Convention:
    """How the data are written, as the repaired model reads them."""
    return Convention(angle=gap.angle) if gap.convention == Convention() else gap.convention


def comparable(gap: Gap) -> bool:
    """False where the repaired model answers in a convention that nobody told."""
    return gap.verdict != "data-convention" or convention_of(gap) != Convention()


def point_views(gap: Gap) -> tuple[PointView, ...]:
    """Every operating point of the data, those with the worst located misfit first, then the others in their order."""
    noise = noise_of(gap.sweep, gap.noise_level)
    names = noise.sweep.names
    worst = [one.op for one in gap.located if one.op in names]
    return tuple(_view(gap, noise.sweep.point(name), noise.known) for name in dict.fromkeys([*worst, *names]))


def _view(gap: Gap, point: PointSweep, known: bool) -> PointView:
    name, lines = point.op.name, []
    given = np.asarray(gap.nominal.get(name, np.nan))
    if np.isfinite(given).all():  # nominal values may have no operating point there
        lines.append(Line("as given", GIVEN, given, point.frequency, given))
    lines.append(_line("refitted", REFITTED if repaired(gap) else REPAIRED, gap.baseline, point, Convention()))
    if repaired(gap) and comparable(gap):
        lines.append(_line("repaired", REPAIRED, gap.repaired, point, convention_of(gap)))
    found = tuple(line for line in lines if line is not None)
    return PointView(point, known, name in gap.held_out, found)


def _line(name: str, index: int, record: Record, point: PointSweep, convention: Convention) -> Line | None:
    """A record's response as the data are written; None where the record has none."""
    exchanged = {label: other for pair in convention.labels for label, other in (pair, pair[::-1])}
    op = exchanged.get(point.op.name, point.op.name)
    frequency = line_frequency(record, op, (point.frequency[0], point.frequency[-1]), point, DENSE)
    try:
        response = record.response(op, frequency)
    except IbridError:
        return None
    mirror, turn = np.diag([1.0, float(convention.q)]), rotation(convention.angle)
    response = turn @ (convention.sign * convention.factor * mirror @ response @ mirror) @ turn.T
    return Line(name, index, response[np.isin(frequency, point.frequency)], frequency, response)
