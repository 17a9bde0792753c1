"""What a plant of several devices shows at its PCC, with bands, and the one device that stands for
them, with its error.

The equivalent follows Muljadi et al. (IEEE PES General Meeting 2006): a device of all ratings
behind the series impedance with the same losses, the sum of share^2 Z over the branches of a node,
and the sum of their shunt capacitances. How far it is from the plant itself is said, frequency by
frequency: devices at different voltages and distances are no single device.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from ibrid.analysis.models.linear_model import with_point
from ibrid.analysis.models.prediction import require_able, sizes
from ibrid.analysis.several_devices.collector import Collector, WorkingPoint
from ibrid.analysis.several_devices.freed_fits import known_of_plant, plant_model
from ibrid.evaluation.record import Record
from ibrid.fit.identifiability import MODEL_FLOOR
from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.quantities import hertz
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.structure.network.outside import PortElement
from ibrid.writing import PlainData

#: Apparent power over the rating, and voltages per unit, beyond which a device is not expected to
#: work.
LOADED, VOLTAGE = 1.3, (0.8, 1.2)


@dataclass(frozen=True)
class Equivalent(Frozen):
    """One device in place of a plant's. `elements` : from the PCC inwards, per unit of the plant.
    `rating` : of the device.

    `nrmse` : ||Y_equivalent - Y|| / ||Y|| over all points; `by_point` : at each. `worst` : (Hz,
    error there), the largest of one frequency.
    """

    elements: tuple[PortElement, ...]
    rating: float
    nrmse: float
    by_point: dict[str, float]
    worst: tuple[float, float]

    @property
    def sentence(self) -> str:
        """In words."""
        return (
            f"One device of rating {self.rating:.3g} behind the equivalent network is "
            f"{self.nrmse:.2g} away (NRMSE) from the "
            f"plant; most at {hertz(self.worst[0])}, {self.worst[1]:.2g}."
        )


@dataclass(frozen=True, eq=False)
class PlantPrediction(Frozen):
    """`sweep` : at the PCC, sigma one standard deviation.

    `devices` : name -> where each works at each point.
    """

    sweep: Sweep
    devices: dict[str, dict[str, WorkingPoint]]
    equivalent: Equivalent

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of devices that work where none is built to."""
        return tuple(
            f"at {op} {name} works at {hypot(rest.p, rest.q):.3g} of its rating and {rest.v:.3g} "
            "of its voltage: see p, q, the "
            "ratings and the units of the elements"
            for name, rests in self.devices.items()
            for op, rest in rests.items()
            if hypot(rest.p, rest.q) > LOADED or not VOLTAGE[0] < rest.v < VOLTAGE[1]
        )

    def plain(self) -> PlainData:
        """For JSON."""
        equivalent = self.equivalent
        devices = {
            name: {op: rest._asdict() for op, rest in rests.items()}
            for name, rests in self.devices.items()
        }
        elements = [
            {"kind": element.kind, **element.values, "unit": "pu"}
            for element in equivalent.elements
        ]
        numbers = {
            "rating": equivalent.rating,
            "nrmse": equivalent.nrmse,
            "nrmse_by_point": equivalent.by_point,
        }
        worst = {"frequency_hz": equivalent.worst[0], "error": equivalent.worst[1]}
        told = {"element": elements, **numbers, "sentence": equivalent.sentence, "worst": worst}
        return {
            "schema": "ibrid.plant/1",
            "devices": devices,
            "warnings": list(self.warnings),
            "equivalent": told,
        }


def predict_plant(
    record: Record, collector: Collector, ops: Sequence[str], frequency: np.ndarray
) -> PlantPrediction:
    """The admittance at the PCC when every device is the record's, but for values that are known to
    differ.

    ops : "p=0.5,q=0[,v=1]" of the plant at the PCC, or names of points of the record. frequency :
    (K,) Hz. The bands have what the record knows of its parameters, alike in all devices, and the
    tolerances of the network. Raises IbridError for a record that cannot predict.
    """
    require_able(record)
    nothing_measured = np.ones((len(frequency), 2, 2), dtype=complex)
    asked = [with_point(record, op) for op in ops]
    points = [PointSweep(whole.point(name), frequency, nothing_measured) for whole, name in asked]
    plant = plant_model(record, collector, points)
    seen, root = plant.responses(plant.x), known_of_plant(record, plant)
    predicted = []
    for point, admittance, slopes in zip(points, seen, plant.jacobians(plant.x), strict=True):
        floor = MODEL_FLOOR * sizes(admittance)[:, None, None]
        spread = np.sqrt((np.abs(slopes @ root) ** 2).sum(axis=-1) / 2)
        predicted.append(
            replace(point, admittance=admittance, sigma=np.hypot(spread, floor), predicted=True)
        )
    sweep = Sweep(
        tuple(predicted),
        float(record.settings["f0_hz"]),
        "pcc",
        *collector.bases,
        source="prediction",
    )
    devices = {one.name: plant.rests(k) for k, one in enumerate(collector.devices)}
    return PlantPrediction(sweep, devices, _compared(record, collector, sweep))


def _compared(record: Record, collector: Collector, sweep: Sweep) -> Equivalent:
    single = equivalent_of(collector)
    plant = plant_model(record, single, sweep.points)
    whole = np.array([one.admittance for one in sweep.points])
    away = np.linalg.norm(np.array(plant.responses(plant.x)) - whole, axis=(2, 3))
    size = np.array([sizes(one) for one in whole])
    errors = np.linalg.norm(away, axis=1) / np.linalg.norm(size, axis=1)
    point, k = np.unravel_index(int((away / size).argmax()), away.shape)
    worst = float(sweep.points[point].frequency[k]), float((away / size)[point, k])
    by_point = dict(zip(sweep.names, errors.tolist(), strict=True))
    return Equivalent(
        single.elements,
        single.rating,
        float(np.linalg.norm(away) / np.linalg.norm(size)),
        by_point,
        worst,
    )


def equivalent_of(root: Collector) -> Collector:
    """One device behind the elements of the root and, where it has branches, one transformer and
    one shunt for all of them.
    """
    if not root.branches:
        return root
    r, x, ratio, c, rc = map(float, _joined(root))
    line = PortElement("transformer", {"R": r, "L": x, "ratio": ratio})
    shunts = (PortElement("shunt", {"R": rc / c**2, "C": c}),) if c else ()
    inner = (line,) if r or x or ratio != 1 else ()
    return Collector("device_1", (*root.elements, *inner, *shunts), (), root.rating)


def _joined(node: Collector) -> np.ndarray:
    """R, L and ratio in front of all devices, the sum of C and of C^2 R behind, seen from the
    node.
    """
    total = np.zeros(5)
    for branch in node.branches:
        r, x, ratio, c, rc = _joined(branch) if branch.branches else (0.0, 0.0, 1.0, 0.0, 0.0)
        for element in reversed(branch.elements):
            values = element.values
            if element.kind == "shunt":
                c, rc = c + values["C"], rc + values["C"] ** 2 * values["R"]
                continue
            turns = values.get("ratio", 1.0)
            r, x = values["R"] + turns**2 * r, values["L"] + turns**2 * x
            ratio, c, rc = turns * ratio, c / turns**2, rc / turns**2
        total += [branch.share**2 * r, branch.share**2 * x, branch.share * ratio, c, rc]
    return total
