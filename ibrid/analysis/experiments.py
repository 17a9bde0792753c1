"""What to measure next: sweeps and events ranked by what they would tell of parameters, and of structures left open.

A sweep of frequencies F at an operating point is n = 8 |F| real numbers with Gaussian errors of deviation s. To first order in
the parameters x, with J = dY/dx / s whitened and C their covariance so far (Laplace),

    C' = (C^-1 + J'J)^-1,    sd ratio of a parameter = sqrt(C'_jj / C_jj),    information = 1/2 log2 det(1 + J C J') bits,

and with a rival that answers r = (Y_rival - Y) / s differently, where the parameters of both may still move,

    bits = 1 / (2 ln 2) r' (1 + J C J' + J_r C_r J_r')^-1 r,

what is left of the difference beside the predictive spread of both (Box and Hill, Discrimination among mechanistic models,
1967; Fedorov, Theory of optimal experiments, 1972). Fits of few data are less linear than their covariance says, so both
are given `CAUTION` times their deviation. Frequencies are taken one by one, each where it adds most: at one operating point
(`experiments`), or of all operating points at once (`campaign`), where a rival has to follow at several with one set of
parameters. A record of an event is the same with the samples of the nonlinear model (`ibrid.analysis.event_answers`).
"""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np

from ibrid.analysis.event_answers import Structure, event_answers
from ibrid.analysis.linear_model import linear_model, whole_record, with_point
from ibrid.analysis.parametric import ParametricModel, Uncertainty, uncertainty
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import OperatingPoint

#: Bits that a pair of structures must be apart to count as told apart: odds of 20 to 1.
DECISIVE = float(np.log2(20.0))
#: A ratio of standard deviations above which a parameter has gained nothing.
NOTHING = 0.98
#: Factor on the deviations of parameters when structures are compared.
CAUTION = 2.0
#: |Y| below which nothing is measured, per unit: without current and with unit feedforward an inverter answers nothing.
LEAST = 1e-6
#: Relative noise of a measurement to come where the record knows none.
ASSUMED_NOISE = 0.01


@dataclass(frozen=True)
class Among:
    """What the user can do: operating points `p`, `q`, `v` (per unit, all combinations), `count` frequencies of those between
    `low` and `high` (Hz; None: the range of the record), with relative noise `noise` (None: that of the record); `events` at the
    same points, written as `ibrid record` takes them, with the noise `record_noise` of each sample, relative to the rms of what
    happens."""

    p: tuple[float, ...] = (0.0, 0.5, 1.0)
    q: tuple[float, ...] = (-0.3, 0.0, 0.3)
    v: tuple[float, ...] = (1.0,)
    count: int = 16
    low: float | None = None
    high: float | None = None
    noise: float | None = None
    events: tuple[str, ...] = ("dip:0.7", "phase:20")
    record_noise: float = 0.01
    of: int = 48

    def points(self) -> tuple[OperatingPoint, ...]:
        """All operating points."""
        return tuple(
            OperatingPoint(f"p={p:g},q={q:g}" + (f",v={v:g}" if v != 1 else ""), p, q, v)
            for p, q, v in product(self.p, self.q, self.v)
        )


@dataclass(frozen=True)
class Told:
    """What would be told. `gain` : parameter -> standard deviation afterwards over that before. `information` : bits on the
    parameters. `separates` : (structure, structure, bits)."""

    gain: dict[str, float]
    information: float
    separates: tuple[tuple[str, str, float], ...]

    def decides(self, without: Collection[tuple[str, str]] = ()) -> float:
        """Bits between the two structures that it tells apart least, some pairs left out; infinite where there are none."""
        return min((bits for *pair, bits in self.separates if tuple(pair) not in without), default=float("inf"))

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        pairs = [list(pair) for pair in self.separates]
        return {"gain": self.gain, "information": self.information, "separates": pairs}


@dataclass(frozen=True)
class Experiment(Told):
    """A sweep of `frequencies` at an operating point, Hz, or a record of an `event` there."""

    op: OperatingPoint
    frequencies: tuple[float, ...] = ()
    event: str = ""

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        what = (
            {"kind": "event", "event": self.event}
            if self.event
            else {"kind": "sweep", "frequencies": list(self.frequencies)}
        )
        return {**what, "op": _plain_point(self.op), **super().plain()}


@dataclass(frozen=True)
class Campaign(Told):
    """Frequencies, Hz, at one or more operating points, that are measured before anything is fitted again."""

    sweeps: tuple[tuple[OperatingPoint, tuple[float, ...]], ...]

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        sweeps = [{"op": _plain_point(op), "frequencies": list(frequencies)} for op, frequencies in self.sweeps]
        return {"sweeps": sweeps, **super().plain()}


def _plain_point(op: OperatingPoint) -> dict[str, Any]:
    return {"name": op.name, "p": op.p, "q": op.q, "v": op.v}


@dataclass(frozen=True)
class _Known:
    """A structure with its parameters at one operating point: whitened answer (K, 8), and its slopes along R directions of
    standard deviation one, (K, 8, R). `sure`, `names` : of the parameters."""

    name: str
    answer: np.ndarray
    slopes: np.ndarray
    sure: Uncertainty


def experiments(records: Sequence[Record], names: Sequence[str], among: Among) -> tuple[Experiment, ...]:
    """Sweeps and events at all operating points of `among` at which every record has an answer, the most telling first.

    records : the answer, then its rivals; `names` : what each structure is called (its hash). With rivals the one that leaves
    the least doubt between them comes first, else the one with most information on the answer's parameters.

    Raises IbridError where the answer cannot predict, or no operating point can be asked.
    """
    answer = records[0]
    frequency = _frequencies(answer, among)
    noise = among.noise or _noise(answer)
    found, why = list[Experiment](), "none was asked"
    for op in among.points():
        for event in ("", *among.events):
            try:
                with whole_record():
                    structures = [_structure(record, op) for record in records]
                    if event:
                        known = _recorded(structures, names, event, among.record_noise)
                        told = _told(known, np.arange(len(known[0].answer)))
                        found.append(Experiment(**vars(told), op=op, event=event))
                    else:
                        known = _swept(structures, names, op, frequency, noise)
                        chosen = _chosen(known, among.count)
                        asked = tuple(float(hz) for hz in frequency[chosen])
                        found.append(Experiment(**vars(_told(known, chosen)), op=op, frequencies=asked))
            except IbridError as error:
                why = str(error)
    if not found:
        raise IbridError(f"no operating point can be asked ({why}); give others with --among FILE")
    blind = hopeless(found)
    return tuple(sorted(found, key=lambda one: (-min(one.decides(blind), DECISIVE * 8), -one.information)))


def with_twins(names: Sequence[str], records: Sequence[Record]) -> tuple[tuple[str, ...], tuple[Record, ...]]:
    """The structures, and beside them the other values of the answer's that fit as well, named "twin 1 of HASH" and so on.

    A twin is given the covariance of the answer, which holds relative deviations.
    """
    answer = records[0]
    twins = [
        replace(answer, parameters={op: {**values, **twin} for op, values in answer.parameters.items()})
        for twin in answer.twins
    ]
    told = [f"twin {number} of {names[0]}" for number in range(1, len(twins) + 1)]
    return (*names, *told), (*records, *twins)


def campaign(records: Sequence[Record], names: Sequence[str], among: Among) -> Campaign | None:
    """The `among.count` frequencies that tell most together, at whichever operating points; None where no sweep can be asked.

    records, names : as for `experiments`.
    """
    frequency = _frequencies(records[0], among)
    noise = among.noise or _noise(records[0])
    ops, swept = [], []
    for op in among.points():
        with suppress(IbridError), whole_record():
            swept.append(_swept([_structure(record, op) for record in records], names, op, frequency, noise))
            ops.append(op)
    if not ops:
        return None
    known = [_everywhere(structure) for structure in zip(*swept, strict=True)]
    chosen = _chosen(known, among.count)
    at = [(op, chosen[chosen // len(frequency) == k] % len(frequency)) for k, op in enumerate(ops)]
    sweeps = tuple((op, tuple(float(hz) for hz in frequency[places])) for op, places in at if len(places))
    return Campaign(**vars(_told(known, chosen)), sweeps=sweeps)


def _everywhere(known: Sequence[_Known]) -> _Known:
    """A structure at several operating points, with one set of parameters."""
    answers, slopes = ([getattr(one, what) for one in known] for what in ("answer", "slopes"))
    return replace(known[0], answer=np.concatenate(answers), slopes=np.concatenate(slopes))


def sentences(found: Sequence[Experiment], among: Among) -> tuple[str, ...]:
    """What no experiment can tell: structures that stay within odds of 20 to 1 everywhere, and parameters that gain nothing; and
    events in which a model has no answer anywhere."""
    said = [
        f"nothing you can do at the terminals will tell {one} from {other}, of all that was asked: at most {bits:.1g} bits; a "
        "record of an event that reaches a limit may"
        for (one, other), bits in _most_bits(found).items()
        if bits < DECISIVE
    ]
    if lost := [event for event in among.events if all(one.event != event for one in found)]:
        said.append(f"{', '.join(lost)} could not be asked: a model leaves or has no answer at every operating point")
    blind = [name for name in found[0].gain if min(one.gain[name] for one in found) > NOTHING]
    if len(blind) == len(found[0].gain):
        said.append("nothing that was asked tells more of the parameters than is known")
    elif blind:
        said.append(f"nothing that was asked tells more of {', '.join(blind)}")
    return tuple(said)


def _most_bits(found: Sequence[Told]) -> dict[tuple[str, str], float]:
    """Pair of structures -> bits by which the best experiment tells them apart."""
    bits: dict[tuple[str, str], float] = {}
    for one, other, more in (pair for told in found for pair in told.separates):
        bits[one, other] = max(more, bits.get((one, other), 0.0))
    return bits


def hopeless(found: Sequence[Told]) -> set[tuple[str, str]]:
    """Pairs that nothing tells apart, which must not hide what tells others; none where all are so."""
    bits = _most_bits(found)
    apart = {pair for pair, most in bits.items() if most < DECISIVE}
    return apart if len(apart) < len(bits) else set()


def _frequencies(record: Record, among: Among) -> np.ndarray:
    low, high = (float(hz) for hz in record.settings["frequency_hz"])
    low, high = among.low or low, among.high or high
    if not 0 < low < high:
        raise IbridError(f"frequencies are asked from low to high, found {low:g} to {high:g} Hz")
    return np.array([float(f"{hz:.4g}") for hz in np.geomspace(low, high, max(among.of, among.count))])


def _noise(record: Record) -> float:
    """Relative to |Y|: the noise floor that the record was judged by, where it was known."""
    floor = (record.misfit or {}).get("floor", {})
    known = floor.get("from") not in (None, "unknown") and floor.get("value")
    return float(floor["value"]) if known else ASSUMED_NOISE


def _structure(record: Record, op: OperatingPoint) -> Structure:
    """Raises IbridError where a record has no operating point, or is unstable on an ideal grid there."""
    whole, point = with_point(record, f"p={op.p!r},q={op.q!r},v={op.v!r}")
    linear = linear_model(whole, point)
    if np.linalg.eigvals(linear.A).real.max(initial=-1.0) > 1e-6:
        raise IbridError(f"the model is unstable at {op.name}")
    model = ParametricModel(whole, OperatingPoint(point, linear.p, linear.q, linear.v))
    sure = uncertainty(whole, model)
    if sure is None:
        raise IbridError("the record holds no covariance; fit again with --parameters shared")
    return whole, linear, model, sure


def _swept(
    structures: Sequence[Structure], names: Sequence[str], op: OperatingPoint, frequency: np.ndarray, noise: float
) -> list[_Known]:
    """Structures in a sweep, all whitened by the noise of the first one's answer. IbridError where one has no answer."""
    found, deviation = [], np.zeros(0)
    for (_, _, model, sure), name in zip(structures, names, strict=True):
        response, slopes = model.admittance(frequency), model.slopes(frequency) @ sure.directions
        if not (np.isfinite(response).all() and np.isfinite(slopes).all()):
            raise IbridError(f"the model has no finite answer at {op.name}")
        if not found:
            deviation = noise * np.maximum(np.linalg.norm(response, axis=(1, 2)), LEAST) / np.sqrt(8.0)
        answer = _real(response.reshape(len(frequency), 4, 1))[..., 0] / deviation[:, None]
        slopes = _real(slopes.reshape(len(frequency), 4, -1)) / deviation[:, None, None]
        found.append(_Known(name, answer, slopes, sure))
    return found


def _recorded(structures: Sequence[Structure], names: Sequence[str], event: str, noise: float) -> list[_Known]:
    """The same in a record, whose numbers go together by eight as those of a frequency do."""
    found = []
    for (answer, slopes), name, (*_, sure) in zip(
        event_answers(structures, event, noise), names, structures, strict=True
    ):
        rest = -len(answer) % 8
        rows = np.pad(slopes, ((0, rest), (0, 0))).reshape(-1, 8, slopes.shape[1])
        found.append(_Known(name, np.pad(answer, (0, rest)).reshape(-1, 8), rows, sure))
    return found


def _real(values: np.ndarray) -> np.ndarray:
    """(K, 4, R) complex as (K, 8, R)."""
    return np.concatenate([np.real(values), np.imag(values)], axis=1)


def _chosen(known: Sequence[_Known], count: int) -> np.ndarray:
    """The frequencies that tell most."""
    pairs = list(combinations(range(len(known)), 2))
    return _for_structures(known, pairs, count) if pairs else _for_parameters(known[0], count)


def _told(known: Sequence[_Known], chosen: np.ndarray) -> Told:
    """What is told by the chosen frequencies, or samples."""
    answer = known[0]
    after = _posterior(answer.slopes[chosen])
    before = (answer.sure.directions**2).sum(axis=1)
    left = np.einsum("pr,rs,ps->p", answer.sure.directions, after, answer.sure.directions)
    gain = np.sqrt(np.divide(left, before, out=np.ones_like(left), where=before > 0))
    gains = {name: float(ratio) for name, ratio in zip(answer.sure.names, gain, strict=True)}
    information = -0.5 * float(np.linalg.slogdet(after)[1]) / np.log(2.0)
    separates = tuple((one.name, other.name, _apart(one, other, chosen)) for one, other in combinations(known, 2))
    return Told(gains, information, separates)


def _posterior(slopes: np.ndarray) -> np.ndarray:
    """Covariance (R, R) along directions that had deviation one, after frequencies with slopes (n, 8, R)."""
    flat = slopes.reshape(-1, slopes.shape[-1])
    return np.linalg.inv(np.eye(flat.shape[1]) + flat.T @ flat)


def _for_parameters(known: _Known, count: int) -> np.ndarray:
    """Frequencies, one by one, each with the most information on the parameters (D-optimal)."""
    chosen: list[int] = []
    covariance = np.eye(known.slopes.shape[-1])
    for _ in range(count):
        inside = np.eye(8) + known.slopes @ covariance @ known.slopes.transpose(0, 2, 1)
        worth = np.linalg.slogdet(inside)[1]
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        covariance = _updated(covariance, known.slopes[best], inside[best])
    return np.sort(np.array(chosen))


def _updated(covariance: np.ndarray, slopes: np.ndarray, inside: np.ndarray) -> np.ndarray:
    follows = covariance @ slopes.T
    return covariance - follows @ np.linalg.solve(inside, follows.T)


def _for_structures(known: Sequence[_Known], pairs: Sequence[tuple[int, int]], count: int) -> np.ndarray:
    """Frequencies, one by one, each adding most to the bits of the pair that is told apart least so far, of those that all
    frequencies together tell apart.

    Bits add up over frequencies as normalised innovations of a Kalman filter do, in which the parameters of both follow.
    """
    every = np.arange(len(known[0].answer))
    able = [(i, j) for i, j in pairs if _apart(known[i], known[j], every) >= DECISIVE]
    follow = [_Following(known[i], known[j]) for i, j in able or pairs]
    chosen: list[int] = []
    for _ in range(count):
        worst = min(follow, key=lambda one: one.told)
        worth = worst.worth()
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        for one in follow:
            one.take(best)
    return np.sort(np.array(chosen))


class _Following:
    """Two structures that are fitted again and again while frequencies come in; `told` : the chi2 that is left between them."""

    def __init__(self, one: _Known, other: _Known) -> None:
        self.slopes = CAUTION * np.concatenate([one.slopes, other.slopes], axis=2)
        self.difference, self.told = other.answer - one.answer, 0.0
        size = self.slopes.shape[-1]
        self._at, self._covariance = np.zeros(size), np.eye(size)

    def worth(self) -> np.ndarray:
        """(K,) chi2 that each frequency would add."""
        inside = np.eye(8) + self.slopes @ self._covariance @ self.slopes.transpose(0, 2, 1)
        surprise = self.difference + self.slopes @ self._at
        return np.einsum("ki,ki->k", surprise, np.linalg.solve(inside, surprise[..., None])[..., 0])

    def take(self, k: int) -> None:
        """Measure a frequency."""
        slopes = self.slopes[k]
        inside = np.eye(8) + slopes @ self._covariance @ slopes.T
        surprise = self.difference[k] + slopes @ self._at
        solved = np.linalg.solve(inside, surprise)
        self.told += float(surprise @ solved)
        self._at = self._at - self._covariance @ slopes.T @ solved
        self._covariance = _updated(self._covariance, slopes, inside)


def _apart(one: _Known, other: _Known, chosen: np.ndarray) -> float:
    """Bits between two structures after the chosen frequencies."""
    follow = _Following(one, other)
    for k in chosen:
        follow.take(int(k))
    return follow.told / (2.0 * np.log(2.0))
