"""Effects of large signals: limits, freezes, ramps and ride-through logic around the current
controller.

r = (i_ref_d, i_ref_q) is the sum that drives the current controller, u the whole voltage command,
both absolute; |e| the magnitude of the voltage at the filter, unfiltered and without hysteresis.
They act in this order: outer loops, voltage support, reference ramp, momentary cessation, current
limit, current controller, command limit, delay. None of them shows near an operating point that is
off its limit, so that no program holds them: they stand beside one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from ibrid.assembly.averaged import Shaped
from ibrid.errors import IbridError
from ibrid.frozen import Frozen
from ibrid.modules.kind import Range
from ibrid.playback.places import Places
from ibrid.structure.reading.wiring import Channel
from ibrid.writing import PlainData

#: Time since the last block of a device that was never blocked, s.
NEVER = 1e6

_LIMIT = Range(1e-2, 20.0, 1.2, "pu", "largest magnitude")
_RATE = Range(1e-2, 1e4, 5.0, "pu/s", "largest rate")
_VOLTAGE = Range(1e-2, 3.0, 0.7, "pu", "magnitude of the voltage below which it acts")


@dataclass(frozen=True, eq=False)
class Limit(Frozen):
    """One effect of large signals in one form.

    `mode` : of a current limit, which axis comes first. `windup` : True where the integrators
    behind it go on.
    `parameters` : name -> range. `banks` : name -> values that a fit begins with. `jumps` :
    parameters that say when it acts where its law jumps, so that slopes say little of them. `each`
    : parameters that every record has of its own.
    """

    id: str
    law: str
    parameters: Mapping[str, Range]
    banks: Mapping[str, tuple[float, ...]]
    mode: str = ""
    windup: bool = False
    jumps: tuple[str, ...] = ()
    each: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Its form, for people."""
        parts = [
            f"{self.mode} first" if self.mode in ("d", "q") else self.mode,
            "windup" if self.windup else "",
        ]
        return ", ".join(one for one in parts if one)

    def plain(self) -> PlainData:
        """For JSON."""
        return {"id": self.id, "mode": self.mode, "windup": self.windup}


def _forms() -> Iterator[Limit]:
    limits = (0.8, 1.0, 1.1, 1.2, 1.35, 1.6, 2.0)
    for windup in (False, True):
        for mode in ("magnitude", "d", "q"):
            law = {
                "magnitude": "r is scaled to |r| <= i_max",
                "d": "|r_d| <= i_max, then |r_q| <= sqrt(i_max^2 - r_d^2)",
                "q": "|r_q| <= i_max, then |r_d| <= sqrt(i_max^2 - r_q^2)",
            }[mode]
            yield Limit("current_limit", law, {"i_max": _LIMIT}, {"i_max": limits}, mode, windup)
    for windup in (False, True):
        law = "u_r is scaled to |u_r| <= u_max, before the delay"
        yield Limit("command_limit", law, {"u_max": _LIMIT}, {"u_max": limits}, windup=windup)
    law = "while |e| < v_freeze e_q counts as zero"
    depths = (0.3, 0.5, 0.6, 0.7, 0.8, 0.9)
    yield Limit(
        "pll_freeze", law, {"v_freeze": _VOLTAGE}, {"v_freeze": depths}, jumps=("v_freeze",)
    )
    yield Limit(
        "momentary_cessation",
        "while |e| < v_block and for t_hold after it |r| <= 0, then |r| <= ramp x (time since)",
        {"v_block": _VOLTAGE, "t_hold": Range(1e-4, 1.0, 0.02, "s", "hold"), "ramp": _RATE},
        {
            "v_block": (0.3, 0.5, 0.7, 0.9),
            "t_hold": (0.002, 0.006, 0.012, 0.02, 0.03, 0.045, 0.07, 0.12),
            "ramp": (1.0, 3.0, 8.0, 20.0, 60.0),
        },
        jumps=("v_block", "t_hold"),
    )
    yield Limit(
        "voltage_support",
        "r_q -= k (1 - dead - |e|) while |e| < 1 - dead, r_q += k (|e| - 1 - dead) while |e| > 1 + "
        "dead",
        {
            "k": Range(1e-2, 100.0, 2.0, "1", "gain"),
            "dead": Range(0.0, 0.9, 0.1, "pu", "dead band"),
        },
        {"k": (1.0, 2.0, 4.0), "dead": (0.03, 0.1, 0.2)},
    )
    rates = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
    yield Limit(
        "reference_ramp", "the rate of i_ref_d is at most ramp", {"ramp": _RATE}, {"ramp": rates}
    )


#: Every form of every effect, those with the same id in the order in which they are tried.
LIMITS: tuple[Limit, ...] = tuple(_forms())
#: A cessation that ends at a moment of each record, s after its event begins, in place of a hold: a
#: hold begins where the voltage, which rings, last passes v_block, and that jumps from period to
#: period; the moment does not.
UNTIL = Limit(
    "momentary_cessation",
    "while |e| < v_block and until a moment |r| <= 0, then |r| <= ramp x (time since)",
    {"v_block": _VOLTAGE, "until": Range(1e-4, 10.0, 0.1, "s", "moment of release"), "ramp": _RATE},
    {},
    mode="until",
    jumps=("v_block",),
    each=("until",),
)
#: What a model at rest has; numbers of limits, which of it they bound, and whether from above (1)
#: or from below (-1).
SIZES = ("reference of the current", "voltage command", "voltage behind the grid-side filter")
BOUNDS = {"i_max": (0, 1), "u_max": (1, 1), "v_freeze": (2, -1), "v_block": (2, -1)}
#: In which they act on one another.
ORDER = (
    "voltage_support",
    "reference_ramp",
    "momentary_cessation",
    "current_limit",
    "command_limit",
    "pll_freeze",
)


def applicable(limit: Limit, places: Places | None) -> bool:
    """True where a diagram has the place at which an effect acts."""
    if places is None:
        return False
    return (places.pll if limit.id == "pll_freeze" else places.reference) is not None


def require_applicable(limits: Sequence[Limit], places: Places | None) -> None:
    """Raise IbridError where a diagram has no place for one of them."""
    for limit in limits:
        if not applicable(limit, places):
            raise IbridError(
                f"{limit.id} needs a current controller or PLL, which the program lacks; leave it "
                "out"
            )


def limit_named(id: str, mode: str = "", windup: bool = False) -> Limit:
    """One form; the first of an id where mode is not said."""
    return next(
        one for one in LIMITS if one.id == id and mode in ("", one.mode) and one.windup == windup
    )


def memory_at_rest(limits: Sequence[Limit], r_d: Any, e: Any, clock: Any) -> list[Any]:
    """What limits keep between steps, of a device at rest.

    clock : s, time since the event begins.
    """
    kept = {"reference_ramp": [r_d], "momentary_cessation": [NEVER, e]}
    until = [clock, e, 0.0, -NEVER]
    return [
        number
        for one in limits
        for number in (until if one.mode == UNTIL.mode else kept.get(one.id, []))
    ]


def returned_at(limits: Sequence[Limit], memory: np.ndarray) -> float:
    """Where `UNTIL` is among limits, when the voltage last came back, s after the event begins; far
    before it where never.
    """
    return float(memory[sum(one.id == "reference_ramp" for one in limits) + 3])


@dataclass
class Limited:
    """Effects at their places, as a shaping of the joined laws.

    `numbers` : "id.parameter" -> symbol. `rest` : symbols of what is taken at rest: of r and of u
    what the sums lack to be absolute, (2,) each, and |e|. `memory` : symbols of what is kept
    between steps; `since` : time since that was kept. Filled when it is called: `next` : what is
    kept behind a step. `switches` : 1 where something acts with a jump or a kink.
    """

    limits: Sequence[Limit]
    places: Places
    numbers: Mapping[str, ca.SX]
    lacking_r: ca.SX
    lacking_u: ca.SX
    e_rest: ca.SX
    memory: ca.SX
    since: ca.SX
    next: list[Any] = field(default_factory=list)
    switches: list[Any] = field(default_factory=list)

    def __call__(self, arriving: Callable[[Channel], Any], signal: Mapping[Channel, Any]) -> Shaped:
        """What arrives at the current controller, the command and the PLL instead, and which
        integrators stand.
        """
        chosen = {one.id: one for one in self.limits}
        changed: dict[Channel, Any] = {}
        stands: dict[tuple[str, int], Any] = {}
        e = ca.sqrt(sum(signal[self.places.voltage, axis] ** 2 for axis in (0, 1)))
        if self.places.reference is not None and set(chosen) & set(ORDER[:4]):
            port, others = (
                self.places.reference,
                [signal[self.places.measured, axis] for axis in (0, 1)],
            )
            r = [arriving((port, axis)) - others[axis] + self.lacking_r[axis] for axis in (0, 1)]
            limited = self._reference(chosen, r, e, arriving, stands)
            for axis in (0, 1):
                changed[port, axis] = limited[axis] + others[axis] - self.lacking_r[axis]
        if "command_limit" in chosen:
            port, u_max = self.places.command, self.numbers["command_limit.u_max"]
            u = [arriving((port, axis)) + self.lacking_u[axis] for axis in (0, 1)]
            size = ca.sqrt(u[0] ** 2 + u[1] ** 2)
            acts = size > u_max
            self.switches.append(acts)
            for axis in (0, 1):
                changed[port, axis] = (
                    ca.if_else(acts, u_max / size, 1.0) * u[axis] - self.lacking_u[axis]
                )
                if not chosen["command_limit"].windup and self.places.current_loop is not None:
                    stands[self.places.current_loop, axis] = acts
        if "pll_freeze" in chosen and self.places.pll is not None:
            frozen = e < self.numbers["pll_freeze.v_freeze"]
            self.switches.append(frozen)
            changed[self.places.pll, 0] = ca.if_else(frozen, 0.0, arriving((self.places.pll, 0)))
        return Shaped(changed, {key: 1.0 - one for key, one in stands.items()})

    def _reference(
        self, chosen: Mapping[str, Limit], r: list[Any], e: Any, arriving: Any, stands: Any
    ) -> list[Any]:
        if "voltage_support" in chosen:
            r = [r[0], r[1] + self._support(e) - self._support(self.e_rest)]
            dead = self.numbers["voltage_support.dead"]
            self.switches += [e < 1 - dead, e > 1 + dead]
        kept = 0
        if "reference_ramp" in chosen:
            reach = self.numbers["reference_ramp.ramp"] * self.since
            self.switches += [r[0] - self.memory[0] > reach, self.memory[0] - r[0] > reach]
            r = [self.memory[0] + ca.fmax(-reach, ca.fmin(reach, r[0] - self.memory[0])), r[1]]
            self.next.append(r[0])
            kept = 1
        if "momentary_cessation" in chosen:
            ceased = (
                self._until if chosen["momentary_cessation"].mode == UNTIL.mode else self._ceased
            )
            r = self._standing(r, ceased(r, e, kept), False, arriving, stands)
        if "current_limit" in chosen:
            limit = chosen["current_limit"]
            limited = _BY_MODE[limit.mode](r, self.numbers["current_limit.i_max"])
            r = self._standing(r, limited, limit.windup, arriving, stands)
        return r

    def _support(self, e: Any) -> Any:
        k, dead = (self.numbers[f"voltage_support.{name}"] for name in ("k", "dead"))
        return k * (ca.fmax(e - 1 - dead, 0) - ca.fmax(1 - dead - e, 0))

    def _ceased(self, r: list[Any], e: Any, kept: int) -> list[Any]:
        """r limited by the time since the voltage came back, of which two numbers are kept: that
        time, and |e| then.
        """
        v_block, t_hold, ramp = (
            self.numbers[f"momentary_cessation.{name}"] for name in ("v_block", "t_hold", "ramp")
        )
        time, before = self.memory[kept], self.memory[kept + 1]
        returned = self.since * (e - v_block) / ca.fmax(e - before, 1e-12)
        after = ca.if_else(
            e < v_block, 0.0, ca.if_else(before < v_block, returned, time + self.since)
        )
        self.next += [after, e]
        nothing = ca.logic_or(e < v_block, after < t_hold)
        self.switches += [e < v_block, nothing]
        return _magnitude(r, ca.if_else(nothing, 0.0, ramp * (after - t_hold)))

    def _until(self, r: list[Any], e: Any, kept: int) -> list[Any]:
        """r limited until a moment, of which four numbers are kept: the time, |e|, whether it was
        ever blocked, and when |e| last came back.
        """
        v_block, until, ramp = (
            self.numbers[f"momentary_cessation.{name}"] for name in ("v_block", "until", "ramp")
        )
        clock, before, blocked, returned = (self.memory[kept + k] for k in range(4))
        now, below = clock + self.since, e < v_block
        ever = ca.fmax(blocked, below)
        back = ca.logic_and(ca.logic_not(below), before < v_block)
        passed = now - self.since * (e - v_block) / ca.fmax(e - before, 1e-12)
        self.next += [now, e, ever, ca.if_else(back, passed, returned)]
        nothing = ca.logic_or(below, ca.logic_and(ever, now < until))
        self.switches += [below, nothing]
        return _magnitude(r, ca.if_else(nothing, 0.0, ramp * ca.if_else(ever, now - until, NEVER)))

    def _standing(
        self, r: list[Any], limited: list[Any], windup: bool, arriving: Any, stands: Any
    ) -> list[Any]:
        """r as limited; integrators whose error pushes further into what is cut away stand."""
        self.switches += [r[axis] != limited[axis] for axis in (0, 1)]
        for integrator in () if windup else self.places.outer:
            for axis in (0, 1) if integrator.axis is None else (integrator.axis,):
                key = (integrator.name, axis if integrator.axis is None else 0)
                pushes = (
                    integrator.sign
                    * arriving((f"{integrator.name}.in_", key[1]))
                    * (r[axis] - limited[axis])
                    > 0
                )
                stands[key] = ca.logic_or(stands[key], pushes) if key in stands else pushes
                self.switches.append(pushes)
        return limited


def _magnitude(r: list[Any], i_max: Any) -> list[Any]:
    size = ca.sqrt(r[0] ** 2 + r[1] ** 2)
    return [ca.if_else(size > i_max, i_max / size, 1.0) * one for one in r]


def _d_first(r: list[Any], i_max: Any) -> list[Any]:
    first = _clip(r[0], i_max)
    return [first, _clip(r[1], ca.sqrt(ca.fmax(i_max**2 - first**2, 0)))]


def _q_first(r: list[Any], i_max: Any) -> list[Any]:
    return _d_first(r[::-1], i_max)[::-1]


def _clip(value: Any, limit: Any) -> Any:
    return ca.fmax(-limit, ca.fmin(limit, value))


_BY_MODE = MappingProxyType({"magnitude": _magnitude, "d": _d_first, "q": _q_first})
