"""What a model says about an operating point that nobody measured: admittance, matrices and poles,
with bands.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.analysis.models.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.analysis.models.modes import QUANTILE, Mode, modes
from ibrid.analysis.models.parametric import ParametricModel, Uncertainty, uncertainty
from ibrid.analysis.models.validity import doubts, measured_frequencies
from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.identifiability import MODEL_FLOOR
from ibrid.frozen import Frozen
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.conventions.rotation import rotation
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.sweep import ENTRIES, OperatingPoint, PointSweep, Sweep
from ibrid.showing import brief, made_above, shown
from ibrid.writing import PlainData, write_json

SCHEMA = "ibrid.prediction/1"
#: Part of |Y| by which an invisible direction must move a prediction to be named, and |Y| below
#: which nothing is measured, per unit: without current and with unit feedforward an inverter
#: answers nothing.
MATTERS, LEAST = 1e-6, 1e-6
#: Frequencies of a prediction where none are asked for.
POINTS = 200


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Prediction(Frozen):
    """A model at one operating point.

    `frequency` (K,) Hz; `admittance` (K, 2, 2) complex, per unit, current out, q leading, delays
    exact, in the frame of the measurement. `deviation` (2, K, 2, 2) : one standard deviation of the
    real and of the imaginary parts, None without a covariance. `model` : (A, B, C, D) in the frame
    of the PCC voltage. `modes` : the rightmost first, with deviations.
    `warnings` : where the answer is less sure than the bands say, in sentences.
    """

    op: OperatingPoint
    frequency: np.ndarray
    admittance: np.ndarray
    deviation: np.ndarray | None
    model: LinearModel
    modes: tuple[Mode, ...]
    frame_angle: float
    warnings: tuple[str, ...]

    A = property(lambda self: self.model.A, doc="(n, n)")
    B = property(lambda self: self.model.B, doc="(n, 2)")
    C = property(lambda self: self.model.C, doc="(2, n)")
    D = property(lambda self: self.model.D, doc="(2, 2)")

    @property
    def poles(self) -> np.ndarray:
        """(n,) rad/s."""
        return np.linalg.eigvals(self.model.A)

    @property
    def stable(self) -> bool:
        """On an ideal grid."""
        return all(one.stable for one in self.modes)

    @property
    def band(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Lower and upper ends (K, 2, 2) complex of the 95 % band of each real and each imaginary
        part.
        """
        if self.deviation is None:
            return None
        half = QUANTILE * (self.deviation[0] + 1j * self.deviation[1])
        return self.admittance - half, self.admittance + half

    @property
    def sigma(self) -> np.ndarray | None:
        """(K, 2, 2) root mean square of the deviations of both parts, as the columns sigma_dd .. of
        a sweep mean it.

        Not below 1e-9 of |Y|, which is believed of no model.
        """
        if self.deviation is None:
            return None
        floor = MODEL_FLOOR * sizes(self.admittance)[:, None, None]
        return np.hypot(np.sqrt((self.deviation**2).mean(axis=0)), floor)

    @property
    def relative_band(self) -> np.ndarray | None:
        """(K,) half width of the 95 % band of the whole matrix over |Y|."""
        if self.deviation is None:
            return None
        return QUANTILE * np.sqrt((self.deviation**2).sum(axis=(0, 2, 3))) / sizes(self.admittance)

    def plain(self) -> PlainData:
        """For JSON."""
        band = self.relative_band
        return {
            "op": self.op.name,
            "p": self.op.p,
            "q": self.op.q,
            "v": self.op.v,
            "stable": self.stable,
            "largest_band": None if band is None else float(band.max()),
            "modes": [one.plain() for one in self.modes],
            "frame_angle": self.frame_angle,
            "warnings": list(self.warnings),
            "states": list(self.model.states),
            **{part: getattr(self.model, part).tolist() for part in "ABCD"},
        }

    def __repr__(self) -> str:
        stable = "stable" if self.stable else "UNSTABLE"
        return brief(
            f"<Prediction at {self.op.name}: {stable}, {len(self.frequency)} frequencies", ">"
        )

    def plot(self, ax: Any = None, entry: str = "dd") -> Any:
        """A matplotlib figure of the four admittances with bands; with ax=(magnitude, phase) of one
        entry, on those.
        """
        return shown(self, "plotting", "prediction_plot", ax, entry)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the JSON of `ibrid predict --json`, replacing the file atomically."""
        write_json(Path(path), {"schema": SCHEMA, "points": [self.plain()]})

    def to_dataframe(self) -> Any:
        """A pandas DataFrame: freq_hz, entry, real, imaginary, and sigma of each part, NaN where it
        is not known.
        """
        sigma = np.full(self.admittance.shape, np.nan) if self.sigma is None else self.sigma
        rows = [
            {"freq_hz": hz, "entry": entry, "real": y.real, "imaginary": y.imag, "sigma": deviation}
            for hz, matrix, deviations in zip(
                self.frequency.tolist(), self.admittance, sigma, strict=True
            )
            for entry, y, deviation in zip(ENTRIES, matrix.flat, deviations.flat, strict=True)
        ]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def _repr_html_(self) -> str:
        """Stability, warnings and the four admittances with bands, for notebooks."""
        return shown(self, "pages.notebook", "prediction_html")


@takes_kinds
@hearing_interrupts()
def predict(
    record: Record, op: str | OperatingPoint, frequency: np.ndarray | None = None
) -> Prediction:
    """Admittance, matrices and poles of a record at an operating point, with bands from its
    covariance.

    Parameters
    ----------
    record : with shared parameters and the exact equilibrium.
    op : a point of the record, or "p=0.5,q=0[,v=1]" or an OperatingPoint anywhere, p and q at the
    record's power node.
    frequency : (K,) Hz, positive, ascending; None: POINTS of them over the measured range.

    Bands: the delta method, dY/dx by the model's exact derivatives, on `uncertainty`: the
    covariance of the fit, and the boxes along what the data cannot see; and the answers of other
    minima within the noise, by their likelihood. They hold for the structure of the diagram; a
    wrong structure is not in them.

    Raises IbridError for a record that cannot predict, OperatingPointError for a point that does
    not exist.
    """
    require_able(record)
    if frequency is None:
        frequency = np.geomspace(*measured_frequencies(record), POINTS)
    frequency = frequencies_of(frequency)
    if not frequency.size:
        raise IbridError("a prediction takes one frequency in Hz or more; found none")
    text = op if isinstance(op, str) else f"p={op.p!r},q={op.q!r},v={op.v!r}"
    with whole_record():
        whole, name = with_point(record, text)
        model = linear_model(whole, name)
        point = OperatingPoint(name, model.p, model.q, model.v)
        parametric = ParametricModel(whole, point)
        sure = uncertainty(whole, parametric)
        by_point = record.settings.get("frame_angles", {})
        angle = float(record.settings.get("frame_angle", 0.0) + by_point.get(name, 0.0))
        warnings = list(doubts(record, model, frequency))
        if by_point and name not in by_point:
            warnings.append(
                "the measuring frame has another angle at each measured operating point; this one "
                "is answered in the frame of "
                "the voltage"
            )
        deviation, slopes = None, None
        if sure is not None:
            moved = _turned(
                np.moveaxis(parametric.slopes(frequency) @ sure.directions, -1, 0), angle
            )
            spread = np.concatenate([moved, _other_minima(sure, parametric, frequency, angle)])
            deviation = np.sqrt(
                np.stack([(part**2).sum(axis=0) for part in (np.real(spread), np.imag(spread))])
            )
            slopes = parametric.matrix_slopes(sure.directions, lambda matrices: matrices[0])
            warnings += _from_the_boxes(sure, moved, parametric.admittance(frequency))
        else:
            warnings.append("the record holds no covariance, so that no band can be given")
        found = modes(model.A, model.states, slopes)
        admittance = _turned(parametric.admittance(frequency), angle)
    return Prediction(point, frequency, admittance, deviation, model, found, angle, tuple(warnings))


def predicted_sweep(record: Record, predictions: Sequence[Prediction]) -> Sweep:
    """The predictions as a sweep, sigma being one standard deviation of each; SweepError when a
    point is there twice.
    """
    return Sweep(
        points=tuple(
            PointSweep(one.op, one.frequency, one.admittance, one.sigma, predicted=True)
            for one in predictions
        ),
        f0_hz=float(record.settings["f0_hz"]),
        power_node=record.settings["power_node"],
        source="prediction",
    )


def sizes(admittance: np.ndarray) -> np.ndarray:
    """(K,) |Y| of (K, 2, 2), not below `LEAST`."""
    return np.maximum(np.linalg.norm(admittance, axis=(1, 2)), LEAST)


def require_able(record: Record) -> None:
    """IbridError for a record whose parameters are not those of every operating point."""
    if record.outcome != "ok":
        return  # linear_model says why
    options = record.settings.get("parameters"), record.settings.get("equilibrium")
    if options != ("shared", "exact"):
        raise IbridError(
            "only a record with shared parameters and the exact equilibrium predicts, found "
            f"{options[0]} parameters and the {options[1]} equilibrium; fit again with "
            "--parameters shared --equilibrium exact"
        )


def _turned(admittance: np.ndarray, angle: float) -> np.ndarray:
    """R(a) Y R(-a), R(a) = [[cos a, sin a], [-sin a, cos a]]: in a measuring frame that leads by a
    (rad).
    """
    turn = rotation(angle)
    return admittance if angle == 0.0 else turn @ admittance @ turn.T


def _other_minima(
    sure: Uncertainty, model: ParametricModel, frequency: np.ndarray, angle: float
) -> np.ndarray:
    """(M, K, 2, 2) what the answers of other minima add to the spread: their distance times the
    root of their likelihood.
    """
    here = model.admittance(frequency)
    away = [
        np.sqrt(likelihood) * (model.admittance(frequency, x) - here)
        for x, likelihood in sure.others
    ]
    answers = [_turned(one, angle) for one in away if np.isfinite(one).all()]
    return np.array(answers, dtype=complex).reshape(-1, *here.shape)


def _from_the_boxes(sure: Uncertainty, moved: np.ndarray, admittance: np.ndarray) -> Iterator[str]:
    """Where a prediction depends on what the data cannot see."""
    size = sizes(admittance)
    reach = np.array(
        [(np.linalg.norm(one, axis=(1, 2)) / size).max() for one in moved[sure.root.shape[1] :]]
    )
    if names := sure.open_parameters(reach > MATTERS):
        yield (
            f"the data do not see {', '.join(names)} well enough, and the prediction depends on "
            f"{'it' if len(names) == 1 else 'them'}: there the bands come from the boxes of the "
            "parameters"
        )
