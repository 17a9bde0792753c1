"""Operating points that are measured already: a measurement that was stopped goes on where it
ended.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.devices.device_file import DeviceFile
from ibrid.devices.experiment import MeasuredResponse
from ibrid.devices.fresh_device import MeasureSettings
from ibrid.devices.isolation.child import plain_device
from ibrid.devices.multisine import Multisine
from ibrid.errors import SweepError
from ibrid.foreign_data import json_in
from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.own_files import remove_own, same_file
from ibrid.writing import require_place, write_whole

#: Ending of the file of a measurement that is not finished.
PART = ".part"
#: Part of an answer that odd powers of the amplitude make, from which on it is said.
NOT_LINEAR = 0.01
#: Part of an answer that lies at frequencies that were not injected, from which on it is said.
NOT_ALONE = 0.5


@dataclass(frozen=True, eq=False)
class MeasuredPoint(Frozen):
    """rest : what the device delivers.

    references : at which it does. simulated_s : seconds that it lived for all of this. files : that
    the model was made of, path -> SHA-256.
    """

    rest: OperatingPoint
    references: Mapping[str, float]
    response: MeasuredResponse
    simulated_s: float
    files: Mapping[str, str] = field(default_factory=dict)

    def swept(self, multisine: Multisine, peak: float) -> PointSweep:
        """As a point of a sweep."""
        amplitude = np.full(len(multisine.bins), multisine.line_amplitude(peak))
        response = self.response
        return PointSweep(
            self.rest, multisine.frequency, response.admittance, response.sigma, amplitude=amplitude
        )

    @property
    def note(self) -> str:
        """What was found and done, for the file."""
        references = "".join(f"{role} = {value:.7g}, " for role, value in self.references.items())
        distortion, guard = self.response.distortion.max(), self.response.guard.max()
        return (
            f"{self.rest.name}: {references}{self.simulated_s:.4g} s simulated with "
            f"{self.response.periods} periods; of the size "
            f"of Y odd powers change {distortion:.1e} at most, and other bins hold {guard:.1e}"
        )

    def warning(self, frequency: np.ndarray) -> str:
        """Where the answer is not linear, or not at the injected frequencies alone, a sentence that
        says so; else empty.
        """
        guard = float(self.response.guard.max())
        if guard > NOT_ALONE:
            return (
                f"at {self.rest.name} frequencies that were not injected hold up to {guard:.1%} of "
                "the answer: the device does not rest, or mixes frequencies; the sweep's sigma has "
                "it, look at the device before the sweep is used"
            )
        distortion = self.response.distortion
        worst = int(np.argmax(distortion))
        if distortion[worst] < NOT_LINEAR:
            return ""
        return (
            f"at {self.rest.name} the answer at {frequency[worst]:.4g} Hz is not linear: odd "
            "powers of the injected voltage make "
            f"{distortion[worst]:.1%} of it; measure with a smaller --peak"
        )

    def plain(self) -> dict[str, Any]:
        """In the types of JSON."""
        response = self.response
        return {
            "rest": [self.rest.name, *self.rest.pqv],
            "references": dict(self.references),
            "simulated_s": self.simulated_s,
            "files": dict(self.files),
            "response": {
                "admittance": response.admittance[..., None].view(float).tolist(),
                "sigma": response.sigma.tolist(),
                "distortion": response.distortion.tolist(),
                "guard": response.guard.tolist(),
                "periods": response.periods,
            },
        }

    @classmethod
    def of_plain(cls, content: Mapping[str, Any]) -> "MeasuredPoint":
        """The point of `plain`."""
        held = dict(content["response"])
        pairs = np.array(held.pop("admittance"))
        admittance = pairs[..., 0] + 1j * pairs[..., 1]
        numbers = {name: np.array(held[name]) for name in ("sigma", "distortion", "guard")}
        response = MeasuredResponse(admittance, **numbers, periods=int(held["periods"]))
        return cls(
            OperatingPoint(*content["rest"]),
            dict(content["references"]),
            response,
            float(content["simulated_s"]),
            dict(content["files"]),
        )


@dataclass
class KeptPoints:
    """Measured points by the name of their operating point; in a file too, where there is a place
    for one.

    key : a hash of what a point depends on (device file, model file, points, lines, settings), so
    that points of another measurement are not mixed in.
    """

    place: Path | None
    key: str
    points: dict[str, MeasuredPoint] = field(default_factory=dict)

    @classmethod
    def beside(
        cls,
        out: str | Path | None,
        file: DeviceFile,
        operating_points: Sequence[OperatingPoint],
        multisine: Multisine,
        settings: MeasureSettings,
    ) -> "KeptPoints":
        """The points beside a sweep file, `out` with the ending .part; none without one, and none
        of an object in Python.

        Raises SweepError where what lies there is of another measurement, or was changed.
        """
        told = [
            plain_device(file),
            [one.pqv for one in operating_points],
            multisine.bins.tolist(),
            multisine.samples,
        ]
        model = sha256(file.path.read_bytes()).hexdigest() if file.path.is_file() else ""
        key = sha256(
            json.dumps([*told, model, asdict(settings)], sort_keys=True).encode()
        ).hexdigest()
        is_of_a_file = file.kind == "reference" or file.path.is_file()
        if out is None or not is_of_a_file:  # an object may be another one next time
            return cls(None, key)
        require_place(out)
        if Path(out).exists() and not Path(out).is_file():  # holds nothing
            return cls(None, key)
        place = Path(out).with_suffix(PART)
        require_place(place)
        if same_file(place, out):
            raise SweepError(
                f"{out}: the ending {PART} is that of a measurement that is not finished; name the "
                "sweep with another, such as .csv"
            )
        if not place.is_file():
            return cls(place, key)
        return cls(place, key, _earlier(place, key))

    def add(self, point: MeasuredPoint) -> None:
        """Keep a point, on the disk too."""
        self.points[point.rest.name] = point
        if self.place is not None:
            points = [one.plain() for one in self.points.values()]
            content = {"key": self.key, "hash": _hash_of(points), "points": points}
            write_whole(self.place, json.dumps(content))

    def drop(self) -> None:
        """Take the file away: the sweep is written."""
        if self.place is not None:
            remove_own(self.place)


def files_of(paths: Sequence[str]) -> dict[str, str]:
    """Path -> SHA-256 of files, "" of one that cannot be read."""
    hashes = {}
    for path in paths:
        try:
            hashes[path] = sha256(Path(path).read_bytes()).hexdigest()
        except OSError:
            hashes[path] = ""
    return hashes


def _hash_of(points: Sequence[Mapping[str, Any]]) -> str:
    return sha256(json.dumps(points, sort_keys=True).encode()).hexdigest()


def _earlier(place: Path, key: str) -> dict[str, MeasuredPoint]:
    """The points in a file of this measurement."""
    try:
        content = json_in(place.read_text(encoding="utf-8"))
        points = [MeasuredPoint.of_plain(one) for one in content["points"]]
        is_whole = content["hash"] == _hash_of(content["points"])
        is_of_this = content["key"] == key
    except (ValueError, KeyError, TypeError, AttributeError, LookupError, OverflowError, OSError):
        is_whole = is_of_this = False
        points = []
    if not is_whole:
        raise SweepError(
            f"{place} must be as a measurement that was stopped left it; found something else, "
            "remove it, or measure into another file"
        )
    if not is_of_this:
        raise SweepError(
            _of_another(place, "device, model file, operating points, frequencies or settings")
        )
    for point in points:
        for path, known in point.files.items():
            if files_of([path])[path] != known:
                raise SweepError(_of_another(place, f"file {path}, which the model reads,"))
    return {point.rest.name: point for point in points}


def _of_another(place: Path, what: str) -> str:
    return (
        f"{place} has points of another measurement: the {what} changed; remove it, or measure "
        "into another file"
    )
