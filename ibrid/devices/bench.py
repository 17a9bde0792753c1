"""A device on the bench: voltages in the turning frame go to it, its currents come back, and its
clock runs on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ibrid.devices.frame import to_dq, to_phases, turning
from ibrid.devices.opening import TerminalDevice
from ibrid.errors import IbridError, OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint

#: Samples that a device is asked for at a time.
BLOCK = 50_000
#: Periods of the nominal frequency between two looks at whether the device rests. The change of the
#: current from look to look, rms, per unit, in which it does.
CYCLES, STILL = 5, 1e-7
#: The same of a device that noise or its own steps keep awake, and the change of its mean current;
#: looks in which it does not become stiller by half.
NOISY, AWAKE, PATIENCE = 0.01, 1e-3, 20
#: Currents, per unit, that no inverter at rest has: the device is unstable.
UNSTABLE = 20.0
#: Rounds in which references are corrected; power that is near enough, per unit, or in deviations
#: of what noise makes of it; the step that shows what v_ref moves; a step of a reference, per unit,
#: that none needs which moves a power.
ROUNDS, NEAR, UNSURE, TRIED, FARTHEST = 12, 1e-5, 5.0, 0.01, 20.0
#: Of the power that is asked for, from which on it is told from its opposite.
OPPOSITE = 0.5


@dataclass
class DeviceBench:
    """A device and its clock. The D axis lies on phase a at sample 0.

    settle_s : simulated seconds in which it starts, and does not rest whatever it looks like.
    longest_s : behind those, in which
    it must settle. played : samples so far. noise : deviation of the mean current of the last look
    at rest, per unit.
    """

    device: TerminalDevice
    step_s: float
    f0_hz: float
    longest_s: float = 20.0
    settle_s: float = 0.0
    played: int = field(default=0, init=False)
    noise: float = field(default=0.0, init=False)

    def play_telling(self, v: np.ndarray, told: Mapping[str, np.ndarray]) -> np.ndarray:
        """Play voltages as `play` while references move.

        told : reference -> (n,) per unit, at every sample; it is put where it differs from the
        sample before.
        """
        values = np.column_stack([np.empty((len(v), 0)), *told.values()])
        changes = np.flatnonzero(np.any(np.diff(values, axis=0) != 0.0, axis=1)) + 1
        parts = []
        for begin, end in pairwise([0, *changes.tolist(), len(v)]):
            for role, value in told.items():
                if begin and value[begin] != value[begin - 1]:
                    self.device.move(role, float(value[begin]))
            parts.append(self.play(v[begin:end]))
        return np.vstack(parts)

    def play(self, v: np.ndarray) -> np.ndarray:
        """(n, 2) current, d and q, per unit, at the terminal voltages d + j q (n,) of the next
        samples.
        """
        parts = []
        for begin in range(0, len(v), BLOCK):
            part = v[begin : begin + BLOCK]
            turn = turning(self.played, len(part), self.step_s, self.f0_hz)
            i = to_dq(self.device.play(self.played, to_phases(part, turn)), turn)
            self.played += len(part)
            parts.append(np.column_stack([np.real(i), np.imag(i)]))
        return np.vstack(parts)

    @property
    def simulated_s(self) -> float:
        """Seconds that the device has lived."""
        return self.played * self.step_s

    def settle(self, op: OperatingPoint) -> OperatingPoint:
        """Wait at [v, 0], from `settle_s` on until the current rests; p and q that the device then
        delivers, per unit.

        Raises OperatingPointError where it does not rest, or leaves.
        """
        count = max(round(CYCLES / self.f0_hz / self.step_s), 4)
        voltage = np.full(count, complex(op.v))
        before = self.play(voltage)
        change = least = np.inf
        looks = 0
        stillest = 0
        starting_s = max(self.settle_s - self.simulated_s, 0.0)
        for looks in range(1, max(int((starting_s + self.longest_s) / (count * self.step_s)), 2)):
            now = self.play(voltage)
            change = float(np.sqrt(np.mean((now - before) ** 2)))
            moved = float(np.abs(now.mean(axis=0) - before.mean(axis=0)).max())
            before = now
            if np.abs(now).max() > UNSTABLE:
                raise OperatingPointError(
                    f"the device is unstable at {op.name}: its current passes {UNSTABLE:g} per "
                    f"unit at {self.simulated_s:g} s; "
                    "try another operating point, or see whether its base (s_base_va, v_base_v) "
                    "and its signs are right"
                )
            if self.simulated_s < self.settle_s:  # it starts, and how still it is says nothing
                continue
            if change < least / 2:
                least = change
                stillest = looks
            is_noise = change < NOISY and moved < AWAKE and looks >= stillest + PATIENCE
            if change < STILL or is_noise:
                self.noise = change / float(np.sqrt(count))
                d, q = now.mean(axis=0).tolist()
                return OperatingPoint(op.name, op.v * d, -op.v * q, op.v)
        raise OperatingPointError(
            f"the device must rest at {op.name}; after {self.simulated_s:g} simulated seconds its "
            f"current still moves by {change:.2g} per unit; see whether its base (s_base_va, "
            "v_base_v) and the units of its signals are right, or try another operating point, or "
            "other [start] and [parameters]"
        )

    def reach(
        self, op: OperatingPoint, references: tuple[str, ...]
    ) -> tuple[OperatingPoint, Mapping[str, float]]:
        """Find the references at which the device delivers p and q, and settle there; what it
        delivers, and the references.

        Law: Newton's method on (p, q), its slopes known for p_ref and q_ref (what is asked for is
        delivered), tried once for v_ref, and corrected by what each step does (Broyden). f_ref
        stands at the nominal frequency.

        Raises OperatingPointError where the device does not settle, does not reach p and q, or
        delivers their opposite.
        """
        taken = [role for role in ("p_ref", "q_ref") if role in references]
        if "q_ref" not in references and "v_ref" in references:
            taken.append("v_ref")
        if "v_ref" in references:
            self.device.put("v_ref", op.v)
        if "f_ref" in references:
            self.device.put("f_ref", 1.0)
        values = np.array([{"p_ref": op.p, "q_ref": op.q, "v_ref": op.v}[role] for role in taken])
        self._put(taken, values)
        delivered = self.settle(op)
        if not taken:
            return self._as_it_is(op, delivered), {}
        if self._seems_reversed(op, delivered, taken):
            self._require_same_direction(op, delivered, taken, values)
        slopes = self._slopes(op, taken, values, delivered)
        for _ in range(ROUNDS):
            missing = _missing(op, delivered, taken)
            if np.abs(missing).max() < max(NEAR, UNSURE * self.noise):
                return delivered, dict(zip(taken, values.tolist(), strict=True))
            step = np.linalg.solve(slopes, missing)
            if np.abs(step).max() > FARTHEST:
                deaf = taken[int(np.argmax(np.abs(step)))]
                raise OperatingPointError(
                    f"{deaf} moves no power of the device at {op.name}, which delivers p = "
                    f"{delivered.p:.4g}, "
                    f"q = {delivered.q:.4g}; see whether [parameters] let it follow that "
                    "reference, which a flag of a voltage or power factor control among them may "
                    "switch off, and whether settle_s is long enough for it to start"
                )
            values = values + step
            self._put(taken, values)
            delivered = self.settle(op)
            done = missing - _missing(op, delivered, taken)
            slopes = slopes + np.outer(done - slopes @ step, step) / float(step @ step)
        raise OperatingPointError(
            f"the device must deliver p = {op.p:g} and q = {op.q:g} at v = {op.v:g}; it comes to p "
            f"= {delivered.p:.4g} and "
            f"q = {delivered.q:.4g} with {_told(taken, values)}, ask for what it can deliver"
        )

    def _put(self, roles: list[str], values: np.ndarray) -> None:
        for role, value in zip(roles, values.tolist(), strict=True):
            self.device.put(role, value)

    def _as_it_is(self, op: OperatingPoint, delivered: OperatingPoint) -> OperatingPoint:
        """Of a device without references, which rests where it does."""
        if max(abs(delivered.p - op.p), abs(delivered.q - op.q)) > AWAKE:
            raise OperatingPointError(
                "the device takes no p_ref and q_ref, and rests at "
                f"p={delivered.p:.6g},q={delivered.q:.6g} with v={op.v:g}; ask "
                "for that, or name its references in [signals]"
            )
        return delivered

    def _seems_reversed(
        self, op: OperatingPoint, delivered: OperatingPoint, taken: list[str]
    ) -> bool:
        """Whether a device delivers nearly the opposite of p_ref and q_ref."""
        asked = np.array([op.p, op.q if "q_ref" in taken else 0.0])
        came = np.array([delivered.p, delivered.q if "q_ref" in taken else 0.0])
        size = float(np.linalg.norm(asked))
        return (
            "p_ref" in taken
            and size > TRIED
            and float(np.linalg.norm(asked + came)) < OPPOSITE * size
        )

    def _require_same_direction(
        self, op: OperatingPoint, delivered: OperatingPoint, taken: list[str], values: np.ndarray
    ) -> None:
        """Raise where more p_ref delivers less power: the current is counted the other way."""
        more = values.copy()
        more[taken.index("p_ref")] += TRIED
        self._put(taken, more)
        if self.settle(op).p < delivered.p:
            raise OperatingPointError(
                f"asked for p = {op.p:g}, q = {op.q:g} the device delivers p = {delivered.p:.3g}, "
                f"q = {delivered.q:.3g}: its "
                "current counts the other way; write sign = -1 at i in [signals], or 1 where -1 is "
                "written"
            )
        self._put(taken, values)
        self.settle(op)

    def _slopes(
        self, op: OperatingPoint, taken: list[str], values: np.ndarray, delivered: OperatingPoint
    ) -> np.ndarray:
        """What each reference moves in (p, q); of v_ref tried, of the others what is asked for."""
        slopes = np.eye(len(taken))
        for column in [k for k, role in enumerate(taken) if role == "v_ref"]:
            moved = values.copy()
            moved[column] += TRIED
            self._put(taken, moved)
            other = self.settle(op)
            slopes[:, column] = (
                _missing(op, delivered, taken) - _missing(op, other, taken)
            ) / TRIED
            self._put(taken, values)
            self.settle(op)
        if np.linalg.matrix_rank(slopes, tol=1e-6) < len(taken):
            raise IbridError(
                f"{', '.join(taken)} move no power of the device; see whether [signals] names its "
                "references"
            )
        return slopes


def _missing(op: OperatingPoint, delivered: OperatingPoint, taken: list[str]) -> np.ndarray:
    """What is asked for less what is delivered, of p where p_ref is taken, of q with q_ref or
    v_ref.
    """
    return np.array(
        [op.p - delivered.p if role == "p_ref" else op.q - delivered.q for role in taken]
    )


def _told(taken: list[str], values: np.ndarray) -> str:
    return ", ".join(
        f"{role} = {value:.4g}" for role, value in zip(taken, values.tolist(), strict=True)
    )
