"""What a model leaves unexplained: how much, where, which places of the model could explain it, and
what to measure next.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt

from ibrid.analysis.models.loop_modes import LoopMode, loops_told
from ibrid.evaluation.grade import Grade
from ibrid.evaluation.record import Record
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.results.gap import Gap, LocatedMisfit
from ibrid.measurement.sweeps.quantities import hertz, span
from ibrid.report.facts.bands import measured_band
from ibrid.report.facts.verdict import graded
from ibrid.report.look.numbers import error, number, percent

#: Places and ports that are named.
NAMED = 5
#: Effects that could not have been seen whose measurement is asked for.
ASKED = 2
#: Where the noise is from, in words; what is not here is measured.
_GUESSED = {
    "unknown": "The noise is not known, so that little of what is left can be told from it",
    "smoothness": "The noise is estimated from the scatter of the data",
    "vector-fit": "The noise is estimated from what a fit without a model leaves",
}


@dataclass(frozen=True)
class LeftPlace:
    """A part of the data that stands out of the noise.

    `band` : Hz, in words. `error` : relative to the measurement there, None where unknown. `share`
    : of the whole squared misfit, None where unknown. `z` : standard deviations of a normal
    distribution.
    """

    op: str
    entry: str
    band: str
    error: float | None
    share: float | None
    z: float

    @property
    def words(self) -> str:
        """The place and how much is left there, in words."""
        size = (
            f"error {error(self.error)}" if self.share is None else f"{percent(self.share)} of it"
        )
        return f"Y_{self.entry} at {self.op}, {self.band}: {size}, z {number(self.z, 3)}"


@dataclass(frozen=True)
class LeftOver:
    """What is left : `amount`, a sentence. `places` : the worst first. `causes` : which places of
    the model could explain it. `measure` : what to measure, sentences.
    """

    amount: str
    places: tuple[LeftPlace, ...]
    causes: tuple[str, ...]
    measure: tuple[str, ...]


def left_by_record(record: Record) -> LeftOver | None:
    """What a fit leaves; None where it explains its data, or nothing is known of what it leaves."""
    if record.nrmse is None or not record.misfit or graded(record) is Grade.EXPLAINS:
        return None
    places = tuple(
        LeftPlace(
            part["op"],
            part["entry"],
            _band_words(record, part["band"]),
            record.nrmse_by_part.get(part["op"], {}).get(part["band"], {}).get(part["entry"]),
            None,
            part["z"],
        )
        for part in record.misfit["by_entry_band"]
    )
    if not places:
        return None
    bands = list(dict.fromkeys(part["band"] for part in record.misfit["by_entry_band"]))
    source = record.misfit["floor"]["from"]
    points = record.settings.get("fitted_points") or list(record.nrmse_by_op)
    measure = (*_repeats(source), *_at_place(places[0], amplitudes=1), *_points(points))
    return LeftOver(
        _amount(record.misfit["chi2_per_dof"], source),
        places,
        (*_loops_there(record, bands), _ASK_GAP),
        (*measure, "ibrid next ranks further sweeps and events by what they would tell."),
    )


def left_by_gap(gap: Gap) -> LeftOver | None:
    """What a gap leaves without a name; None where the model, repaired or not, explains the data,
    and for records of events alone.
    """
    located = [place for place in gap.located if isinstance(place, LocatedMisfit)]
    if gap.verdict not in ("located-unnamed", "unexplained") or not located:
        return None
    places = tuple(
        LeftPlace(place.op, place.entry, span(*place.band), None, place.share, place.z)
        for place in located
    )
    misfit = gap.baseline.misfit or {}
    points = [name for name in gap.sweep.names if name not in gap.held_out]
    amplitudes = 1 if gap.amplitude is None else len(gap.amplitude.linearity.amplitudes)
    source = misfit.get("floor", {}).get("from", "unknown")
    measure = (
        *_repeats(source),
        *_at_place(places[0], amplitudes),
        *_points(points),
        *_unseen(gap),
    )
    amount = _amount(misfit.get("chi2_per_dof"), source)
    return LeftOver(amount, places, tuple(_ports_that_explain(gap.ports)), measure)


#: Said of a record, which has no port map.
_ASK_GAP = (
    "ibrid gap with this record as MODEL fits one unknown transfer at each place of the model and "
    "names those that explain what is left."
)


def _amount(chi2_per_dof: float | None, source: str) -> str:
    if chi2_per_dof is None:
        return "As many numbers were fitted as measured, so what is left says little."
    ratio = number(sqrt(chi2_per_dof), 3)
    known = "the noise" if source != "unknown" else "1e-4 of the measurement, its noise not known"
    return (
        f"What is left is {ratio} times as large as {known} (chi2 per degree of freedom "
        f"{number(chi2_per_dof, 3)})."
    )


def _band_words(record: Record, band: str) -> str:
    return span(*measured_band(record, band))


def _loops_there(record: Record, bands: Sequence[str]) -> Iterator[str]:
    """Loops whose bandwidth lies where something is left, band by band."""
    loops = [loop for loop in loops_told(record) if loop.bandwidth is not None]
    for band in bands[:NAMED]:
        low, high = measured_band(record, band)
        inside = [loop for loop in loops if low <= (loop.bandwidth or 0.0) < high]
        if inside:
            yield f"{_band_words(record, band)} holds the bandwidth of {_loop_words(inside)}."


def _loop_words(loops: Sequence[LoopMode]) -> str:
    words = [f"{loop.loop} ({loop.regulator}, {hertz(loop.bandwidth or 0.0)})" for loop in loops]
    return ", ".join(words)


def _ports_that_explain(ports: Sequence[PortFit]) -> Iterator[str]:
    adequate = [fit for fit in ports if fit.adequate]
    if adequate:
        yield from (
            f"One unknown transfer explains all of it at: {fit.port.words} ({fit.port.name})."
            for fit in adequate[:NAMED]
        )
        if len(adequate) > 1:
            yield "These data do not tell these places apart; a recording at one of them does."
    elif ports:
        nearest = ", ".join(
            f"{fit.port.words} (chi2 per degree of freedom {number(fit.chi2_per_dof, 3)})"
            for fit in ports[:3]
        )
        yield f"No single place explains all of it; nearest come {nearest}."


def _repeats(source: str) -> Iterator[str]:
    if source in _GUESSED:
        yield (
            f"Every operating point three times or more, unchanged. {_GUESSED[source]}; repeats "
            "measure it."
        )


def _at_place(place: LeftPlace, amplitudes: int) -> Iterator[str]:
    yield (
        f"{place.op}, {place.band}, with more frequencies: a few that stand alone are the "
        "measurement, a broad band is the device."
    )
    if amplitudes == 1:
        yield (
            f"The same with half and with twice the amplitude: what changes in Y_{place.entry} is "
            "no linear block."
        )


def _points(points: Sequence[str]) -> Iterator[str]:
    if len(points) < 3:
        yield (
            "Further operating points, of other p, q and v: what stays the same lies in the "
            "filter, the delays or the measurement, what moves with them in a loop or a frame."
        )


def _unseen(gap: Gap) -> Iterator[str]:
    """Measurements that would show the effects that came nearest to being seen."""
    nearest = sorted(gap.could_not_have_seen, key=lambda effect: -effect.detectability)
    asked = {effect.sweep: effect for effect in reversed(nearest) if effect.sweep}
    for sweep, effect in [*reversed(asked.items())][:ASKED]:
        yield f"{sweep[:1].upper()}{sweep[1:]} would show {effect.id}, if that is there."
