"""The options of an evaluation, checked, and the data split into what is fitted and what is held out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ibrid.errors import IbridError, OperatingPointError, near
from ibrid.fit.objective import FINAL_OBJECTIVES, objective_for
from ibrid.fit.settings import FitSettings, require_one_of
from ibrid.measurement.noise_estimate import with_sigma
from ibrid.measurement.sweep import PointSweep, Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import NAMED_VOCABULARIES, VOCABULARY, Vocabulary, choose_vocabulary
from ibrid.structure.parameters import EQUILIBRIA

#: `shared`: one set of parameters fitted jointly over all operating points; `per-op`: a set for each, as in the paper.
PARAMETER_MODES = ("shared", "per-op")


@dataclass(frozen=True)
class Plan:
    """Checked options."""

    sweep: Sweep
    fitted: Sweep
    held_out: tuple[PointSweep, ...]
    parameters: str
    equilibrium: str
    vocabulary: str
    kinds: Vocabulary
    fit: FitSettings
    seed: int

    def described(self) -> dict[str, Any]:
        return {
            "parameters": self.parameters,
            "equilibrium": self.equilibrium,
            "vocabulary": self.vocabulary,
            "objective": self.fit.minimised,
            "restarts": self.fit.restarts,
            "starts": self.fit.starts,
            "seeds": self.fit.seeds,
            "seed": self.seed,
            "seconds": self.fit.seconds,
            "solver": "ipopt",
            "data": self.sweep.source,
            "f0_hz": self.sweep.f0_hz,
            "power_node": self.sweep.power_node,
            "operating_points": {
                one.op.name: {"p": one.op.p, "q": one.op.q, "v": one.op.v} for one in self.sweep.points
            },
            "fitted_points": list(self.fitted.names),
            "frequency_hz": [
                min(float(one.frequency[0]) for one in self.sweep.points),
                max(float(one.frequency[-1]) for one in self.sweep.points),
            ],
        }


def make_plan(
    sweep: Sweep,
    parameters: str,
    equilibrium: str,
    vocabulary: str | Sequence[ModuleKind],
    objective: str | None,
    restarts: int | None,
    seed: int,
    holdout_op: str | Sequence[str],
    settings: FitSettings | None,
) -> Plan:
    sweep, fit_settings = with_sigma(sweep), settings or FitSettings()
    held = (holdout_op,) if isinstance(holdout_op, str) else tuple(holdout_op)
    wanted = (
        objective or fit_settings.objective or objective_for(one for one in sweep.points if one.op.name not in held)
    )
    for value, allowed, what in (
        (parameters, PARAMETER_MODES, "parameters"),
        (equilibrium, EQUILIBRIA, "equilibrium"),
        (wanted, FINAL_OBJECTIVES, "objective"),
    ):
        require_one_of(what, value, allowed)
    for name in held:
        if name not in sweep.names:
            raise OperatingPointError(
                f"the data have no operating point {name!r} to hold out; {near(name, sweep.names)}"
            )
    if held and (parameters != "shared" or equilibrium != "exact"):
        raise IbridError(
            "a held-out operating point can be predicted only with shared parameters and the exact equilibrium; "
            "drop --holdout-op or the other options"
        )
    if len(set(held)) >= len(sweep.points):
        raise IbridError("every operating point is held out; leave at least one to fit")
    if restarts is not None:
        fit_settings = replace(fit_settings, restarts=restarts)
    return Plan(
        sweep=sweep,
        fitted=sweep.without(held) if held else sweep,
        held_out=tuple(sweep.point(name) for name in held),
        parameters=parameters,
        equilibrium=equilibrium,
        vocabulary=vocabulary if isinstance(vocabulary, str) else _vocabulary_name(vocabulary),
        kinds=choose_vocabulary(vocabulary),
        fit=replace(fit_settings, objective=wanted),
        seed=seed,
    )


def _vocabulary_name(kinds: Sequence[ModuleKind]) -> str:
    """A shipped vocabulary by its name; otherwise what is added to and left out of the extended one."""
    for name, shipped in NAMED_VOCABULARIES.items():
        if tuple(kinds) == shipped:
            return name
    added = [kind.name for kind in kinds if kind not in VOCABULARY]
    left_out = [kind.name for kind in VOCABULARY if kind.name not in {one.name for one in kinds}]
    return "extended" + "".join(f" + {name}" for name in added) + "".join(f" - {name}" for name in left_out)
