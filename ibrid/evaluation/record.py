"""The record of an evaluation: what was fitted, how well, how sure, and enough to rebuild
everything. Plain data.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ibrid.assembly.interconnection import interconnect_rows
from ibrid.assembly.modules_at import ModuleMatrices, module_matrices, require_finite
from ibrid.assembly.rest import terminal_point
from ibrid.assembly.symbolic import symbolic_model
from ibrid.border import methods_take_kinds, require_kinds, takes_kinds
from ibrid.errors import IbridError, OperatingPointError, near
from ibrid.evaluation.outcome import Outcome
from ibrid.fit.kernel import admittance
from ibrid.foreign_data import json_in, text_in
from ibrid.frozen import Frozen
from ibrid.interrupts import undisturbed
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, choose_vocabulary
from ibrid.schemas import breach
from ibrid.showing import brief, made_above, shown
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.network.outside import Outside
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import Wiring, wire
from ibrid.writing import PlainData, plain, write_json

if TYPE_CHECKING:
    import control

SCHEMA = "ibrid.record/1"
#: Part of an end of a box by which a value of it may be rounded.
ROUNDED = 1e-6
#: No number of a record is larger: what is computed from it stays finite.
LARGEST = 1e100


@methods_take_kinds
@dataclass(frozen=True)
class Record(Frozen):
    """Answer of `evaluate`; the JSON of `to_json` has these fields and `schema`.

    `nrmse` : mean over operating points. `parameters` : operating point -> free name -> value, per
    unit, s, rad/s.
    `intervals` : the same names -> 95 % interval, or None where the data leave the value open.
    `noise_floor` : NRMSE that the noise of the data alone would leave, None when it is not known.
    `grade` : explains, close, rough or fails, and `misfit` what it stands on
    (`ibrid.evaluation.grade`); None without a fit. `over_noise` : root mean square of the residual
    over the deviation of a stated or repeated noise, 1 when only noise is left.
    `labels` : those of the data that were found wrong, by id (such as power_scale) with its number,
    a sentence that says what to write, and which others these data cannot tell from it; points and
    errors are then of the data put right. `nrmse_by_record`, `nrmse_by_window` : of records of
    events, of which `settings` name the file and the limits that stand beside the program
    (`large_signal`); empty without any. `validation` : error measures of a standard, where one was
    asked for.
    `identifiability` : what the data cannot see, in sentences. `twins` : other values that fit
    equally well.
    `order` : states of the exported matrices, Pade forms included. `settings` : how it was made,
    with the operating points, f0 and power node that are needed to rebuild the model. `starts` :
    the work that the fit took.
    `seconds` : that it took just now, 0 in files: they say the same whatever a clock does.
    """

    outcome: str
    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    nrmse: float | None = None
    reward: float = 0.0
    nrmse_by_op: Mapping[str, float] = field(default_factory=dict)
    nrmse_by_band: Mapping[str, float | None] = field(default_factory=dict)
    nrmse_by_entry: Mapping[str, float | None] = field(default_factory=dict)
    share_by_band: Mapping[str, float | None] = field(default_factory=dict)
    nrmse_by_part: Mapping[str, Mapping[str, Mapping[str, float | None]]] = field(
        default_factory=dict
    )
    holdout: Mapping[str, float] = field(default_factory=dict)
    modules: int = 0
    sums: int = 0
    order: int = 0
    residual_modules: int = 0
    free_parameters: int = 0
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    intervals: Mapping[str, Mapping[str, Sequence[float] | None]] = field(default_factory=dict)
    boxes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    at_bound: tuple[str, ...] = ()
    stable: Mapping[str, bool] = field(default_factory=dict)
    poles: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict)
    identifiability: tuple[str, ...] = ()
    twins: tuple[Mapping[str, float], ...] = ()
    starts: Mapping[str, Any] = field(default_factory=dict)
    covariance: Mapping[str, Any] = field(default_factory=dict)
    noise_floor: float | None = None
    grade: str | None = None
    misfit: Mapping[str, Any] | None = None
    over_noise: float | None = None
    labels: tuple[Mapping[str, Any], ...] = ()
    nrmse_by_record: Mapping[str, float] = field(default_factory=dict)
    nrmse_by_window: Mapping[str, float] = field(default_factory=dict)
    validation: Mapping[str, Any] = field(default_factory=dict)
    program: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = field(default=0.0, compare=False)
    vocabulary: tuple[ModuleKind, ...] = field(
        default_factory=lambda: VOCABULARY, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_kinds(self)

    @property
    def diagram(self) -> Diagram:
        """The block diagram."""
        written = parse_program(self.program, "the record's program")
        return (
            written.behind(Outside.from_json(self.settings["outside"]))
            if "outside" in self.settings
            else written
        )

    @property
    def wiring(self) -> Wiring:
        """The diagram with its kinds."""
        return wire(self.diagram, self.vocabulary)

    @property
    def physics(self) -> dict[str, Any]:
        """The words with which a model of the diagram is assembled: equilibrium, power_node and
        omega_0 (rad/s).
        """
        return {
            "equilibrium": self.settings["equilibrium"],
            "power_node": self.settings["power_node"],
            "omega_0": 2 * np.pi * self.settings["f0_hz"],
        }

    def point(self, op: str) -> OperatingPoint:
        """The operating point of that name; OperatingPointError, with the near names, if there is
        none.
        """
        points = self.settings["operating_points"]
        if op not in points:
            raise OperatingPointError(
                f"the record has no operating point {op!r:.60}; {near(op, points)}"
            )
        numbers = points[op]
        return OperatingPoint(op, *(float(numbers[key]) for key in "pqv"))

    def to_json(self) -> PlainData:
        """Plain data in the order of the fields, with the schema first."""
        left_out = {"vocabulary", *([] if self.validation else ["validation"])}
        fields = (one.name for one in dataclasses.fields(self) if one.name not in left_out)
        return {
            "schema": SCHEMA,
            **{name: plain(getattr(self, name)) for name in fields},
            "seconds": 0.0,
        }

    @classmethod
    def from_json(
        cls, data: Mapping[str, Any], vocabulary: str | Sequence[ModuleKind] = "extended"
    ) -> "Record":
        """Rebuild a record; IbridError when `data` is not one."""
        if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
            schema = (
                repr(data["schema"]) if isinstance(data, Mapping) and "schema" in data else "none"
            )
            raise IbridError(
                f"a record has the schema {SCHEMA!r}, found {schema}; make one with ibrid evaluate "
                "--json"
            )
        if (
            reason := breach(data, "record") or _broken_link(data) or _impossible_number(data)
        ) is not None:
            raise IbridError(f"the record {reason}; make it again with ibrid evaluate --json")
        names = {one.name for one in dataclasses.fields(cls)} - {"vocabulary"}
        values: dict[str, Any] = {
            name: tuple(value) if name in _TUPLES else value
            for name, value in data.items()
            if name in names
        }
        values["outcome"] = str(Outcome(values["outcome"]))  # the words of old files
        return cls(**values, vocabulary=choose_vocabulary(vocabulary))

    def write(self, path: str | Path) -> None:
        """Write the JSON, replacing the file atomically."""
        write_json(path, self.to_json())

    def state_space(self, op: str, cut: str | None = None) -> "control.StateSpace":
        """The full (A, B, C, D) at an operating point by python-control; states "instance.state".
        cut : a module that gives nothing out.

        Raises OperatingPointError for a point that is not the record's, IbridError for a record
        without a fit.
        """
        with undisturbed():
            from ibrid.assembly.numeric import closed_loop  # python-control is slow to import

        matrices = self._matrices(op, cut)
        return closed_loop(self.wiring, matrices, name="inverter")

    def state_matrix(self, op: str, cut: str | None = None) -> tuple[np.ndarray, tuple[str, ...]]:
        """A and the names of its states, as in `state_space`, without python-control."""
        matrices = self._matrices(op, cut)
        require_finite(matrices)
        joined = interconnect_rows(self.wiring, matrices, exact_delays=False)
        return joined.matrices()[0], joined.states

    def response(self, op: str, frequency: np.ndarray) -> np.ndarray:
        """Admittance (K, 2, 2) at frequencies in Hz, per unit, current out; delays are exact."""
        self._require(op)
        model = symbolic_model(self.wiring, **self.physics)
        self._require_values(op, [one.name for one in model.parameters])
        theta = np.array([self.parameters[op][one.name] for one in model.parameters])
        return admittance(model, theta, self.point(op).pqv, 2 * np.pi * frequencies_of(frequency))

    def terminal_point(self, op: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """v0 and i0 at the PCC at rest, (D, Q) per unit, from p, q, v and the plant; raises as
        `state_space`.
        """
        self._require(op)
        wiring, physics = self.wiring, self.physics
        values = self._values_at(wiring, op)
        return terminal_point(
            wiring, values, self.point(op).pqv, physics["power_node"], physics["omega_0"]
        )

    def __repr__(self) -> str:
        error = (
            ""
            if self.nrmse is None
            else f", NRMSE {self.nrmse:.3g} at {'; '.join(self.parameters)}"
        )
        return brief(
            f"<Record: {self.outcome}{error}, {self.modules} modules, order {self.order}", ">"
        )

    def plot(self, ax: Any = None, entry: str = "dd", *, band: bool = False) -> Any:
        """A matplotlib figure of the four admittances, measured and model; with ax=(magnitude,
        phase) of one entry, on those.

        band : with the 95 % bands that the uncertainty of the parameters leaves (`ibrid.predict`).
        """
        return shown(self, "plotting", "record_plot", ax, entry, band)

    def save(self, path: str | Path) -> None:
        """The same as `write`; `read_record` takes it back."""
        self.write(path)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of the free parameters: op, parameter, value, and the 95 % interval,
        NaN where the data leave it open.
        """
        rows = []
        for op, values in self.parameters.items():
            for name, value in values.items():
                low, high = self.intervals.get(op, {}).get(name) or (np.nan, np.nan)
                bound = name in self.at_bound
                found = {"value": value, "low": low, "high": high, "at_bound": bound}
                rows.append({"op": op, "parameter": name, **found})
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def _repr_html_(self) -> str:
        """Verdict, response and parameters, for notebooks."""
        return shown(self, "pages.notebook", "record_html")

    def _require(self, op: str) -> None:
        if self.outcome != Outcome.OK:
            raise IbridError(
                f"the record has no fit (outcome {self.outcome}: {'; '.join(self.reasons)}); fit "
                "again"
            )
        if op not in self.parameters:
            raise OperatingPointError(
                f"the record has no operating point {op!r}; {near(op, self.parameters)}"
            )

    def _require_values(self, op: str, names: Sequence[str]) -> None:
        lacking = [name for name in names if name not in self.parameters[op]]
        if lacking:
            raise IbridError(
                f"the record's parameters at {op} lack {', '.join(lacking)}; make it again with "
                "ibrid evaluate --json"
            )

    def _matrices(self, op: str, cut: str | None) -> ModuleMatrices:
        """The matrices of the modules; those of `cut` without outputs."""
        self._require(op)
        wiring = self.wiring
        values = self._values_at(wiring, op)
        orders = self.settings["pade_orders"]
        for name, kind in wiring.kinds.items():
            if kind.delay is not None and name not in orders:
                raise IbridError(
                    f"the record's pade_orders lack {name}; make it again with ibrid evaluate "
                    "--json"
                )
        point = self.point(op).pqv
        matrices = module_matrices(wiring, values, point, pade_orders=orders, **self.physics)
        if cut is not None:
            if cut not in matrices:
                raise IbridError(f"the record has no module {cut!r:.60}; {near(cut, matrices)}")
            a, b, c, d = matrices[cut]
            matrices[cut] = a, b, [[0.0] * len(row) for row in c], [[0.0] * len(row) for row in d]
        return matrices

    def _values_at(self, wiring: Wiring, op: str) -> Any:
        """Module -> parameter -> value at an operating point; IbridError where one lacks."""
        table = parameter_table(wiring, self.settings["equilibrium"])
        self._require_values(op, table.names)
        return parameters_at(wiring, table, self.parameters[op])


_TUPLES = ("reasons", "warnings", "at_bound", "identifiability", "twins", "labels")


def _broken_link(data: Mapping[str, Any]) -> str | None:
    """What does not belong together in a record that its schema admits; wording as of `breach`."""
    settings, values = data["settings"], data["parameters"]
    points = settings.get("operating_points", {})
    if data["outcome"] != Outcome.OK:
        return None
    for name in (*values, *settings["fitted_points"]):
        if name not in points or name not in values:
            return f"lacks the parameters, or p, q and v, of the operating point {name[:40]}"
    covariance = {"names": [], "matrix": [], "other_minima": []} | data.get("covariance", {})
    size = len(covariance["names"])
    if [len(row) for row in covariance["matrix"]] != [size] * size or any(
        len(other["x"]) != size for other in covariance["other_minima"]
    ):
        return "has a covariance that does not fit its names"
    return None


def _impossible_number(data: Mapping[str, Any]) -> str | None:
    """What no fit can have left in a record that its schema admits; wording as of `breach`."""
    for name, part in data.items():
        if (
            number := next((one for one in _numbers(part) if abs(one) > LARGEST), None)
        ) is not None:
            return f"has {number:g} in {name[:40]}, more than any answer holds"
    boxes = data.get("boxes", {})
    for op, values in data["parameters"].items():
        for name, value in values.items():
            if name not in boxes:
                continue
            low, high = boxes[name]["low"], boxes[name]["high"]
            if not low - ROUNDED * abs(low) <= value <= high + ROUNDED * abs(high):
                return (
                    f"has {name[:40]} = {value:g} at {op[:40]}, outside its box, {low:g} to "
                    f"{high:g}"
                )
    matrix = data.get("covariance", {}).get("matrix", [])
    if any(row[place] < 0 for place, row in enumerate(matrix)):
        return "has a covariance with a negative variance"
    return None


def _numbers(part: Any) -> Iterator[float]:
    """Every number in a part of a record."""
    if isinstance(part, Mapping | list | tuple):
        for inner in part.values() if isinstance(part, Mapping) else part:
            yield from _numbers(inner)
    elif isinstance(part, int | float):
        yield part


@takes_kinds
def read_record(path: str | Path, vocabulary: str | Sequence[ModuleKind] = "extended") -> Record:
    """Read a record's JSON; IbridError, one sentence, for anything else."""
    path = Path(path)
    try:
        data = json_in(text_in(path))
    except OSError as error:
        raise IbridError(
            f"{path}: cannot be read ({error.strerror}); give the path of a record"
        ) from None
    except ValueError as error:
        raise IbridError(
            f"{path}: is not JSON ({error}); a record is made with ibrid evaluate --json"
        ) from None
    try:
        return Record.from_json(data, vocabulary)
    except IbridError as error:
        raise IbridError(f"{path}: {error}") from None
