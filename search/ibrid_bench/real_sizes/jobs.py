"""The jobs: a fit of the true structure, a first result, a search, and gaps, each on an input that
is made anew. `run` gives what came out, in words.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from ibrid_bench.events.__main__ import case_of
from ibrid_bench.hidden.case import Case, draw_case
from ibrid_bench.hidden.hardware import draw_hardware
from ibrid_search.starting.start import start

import ibrid
from ibrid.gap.results.gap import Gap
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.plants.sweeping import plant_named
from ibrid.structure.diagrams.program import parse_program

POINTS = tuple(
    OperatingPoint(f"p={p:g},q={q:g}", p, q, 1.0) for p, q in ((0.8, 0.1), (0.4, -0.2), (0.6, 0.0))
)
#: Hz.
BAND = (2.0, 4000.0)
#: dB below the norm of the admittance.
NOISE = 50.0
#: Evaluations of a search, as people leave them.
BUDGET = 80


class Job(Protocol):
    """Something that is timed, once its input is there."""

    def prepared(self) -> Callable[[int], str]:
        """Make the input; what does the job with a seed, and says what came out."""
        ...


@dataclass(frozen=True)
class Measured:
    """A sweep of a reference inverter; `noise_db` : None for clean data."""

    plant: str
    points: int
    frequencies: int
    noise_db: float | None = None

    def __str__(self) -> str:
        noise = "clean" if self.noise_db is None else f"{self.noise_db:g} dB"
        return f"{self.plant} {self.points} x {self.frequencies}, {noise}"

    def sweep(self) -> Sweep:
        """The admittance, with its noise."""
        frequency = np.geomspace(*BAND, self.frequencies)
        clean = ibrid.sweep(plant_named(self.plant), POINTS[: self.points], frequency)
        if self.noise_db is None:
            return clean
        return ibrid.add_noise(clean, self.noise_db, rng=np.random.default_rng(0))


@dataclass(frozen=True)
class Fit:
    """The true structure from default starts, as `ibrid evaluate` does it."""

    measured: Measured
    diagram: str = ""

    def __str__(self) -> str:
        return f"fit of {self.measured}"

    def prepared(self) -> Callable[[int], str]:
        """As of `Job`."""
        sweep, diagram = self.measured.sweep(), ibrid.textbook(self.diagram or self.measured.plant)

        def run(seed: int) -> str:
            record = ibrid.evaluate(diagram, sweep, seed=seed)
            return "no fit" if record.nrmse is None else f"NRMSE {record.nrmse:.2e}"

        return run


@dataclass(frozen=True)
class Start:
    """A first result, as `ibrid start` gives it."""

    measured: Measured

    def __str__(self) -> str:
        return f"start on {self.measured}"

    def prepared(self) -> Callable[[int], str]:
        """As of `Job`."""
        sweep = self.measured.sweep()

        def run(seed: int) -> str:
            best = start(sweep, tell=lambda *_: None, seed=seed).best
            return f"{best.diagram}, NRMSE {best.nrmse:.2e}"

        return run


@dataclass(frozen=True)
class StartOnRecordings:
    """The same on the recordings of a device with a current limit."""

    seed: int

    def __str__(self) -> str:
        return f"start on {_recorded(case_of('current_limit', self.seed)[0].events)}"

    def prepared(self) -> Callable[[int], str]:
        """As of `Job`."""
        events = case_of("current_limit", self.seed)[0].events

        def run(seed: int) -> str:
            best = start(events, tell=lambda *_: None, seed=seed).best
            return f"{best.diagram}, NRMSE {best.nrmse:.2e}"

        return run


@dataclass(frozen=True)
class Search:
    """A search of a device of the independent generator that has two effects, without a hint."""

    seed: int
    frequencies: int = 48

    def __str__(self) -> str:
        return f"search, device {self.seed}, 2 x {self.frequencies}, {NOISE:g} dB"

    def prepared(self) -> Callable[[int], str]:
        """As of `Job`."""
        sweep = _hiding("pair", self.seed, self.frequencies).sweep

        def run(seed: int) -> str:
            with tempfile.TemporaryDirectory() as folder:
                found = ibrid.search(
                    sweep, Path(folder) / "run", budget=BUDGET, seed=seed, progress="silent"
                )
            error = np.nan if found.best is None else found.best.nrmse or np.nan
            return f"{found.evaluations} evaluations, NRMSE {error:.2e}"

        return run


@dataclass(frozen=True)
class FindGap:
    """The effects that a device of the independent generator hides; `kind` : "effect", "pair",
    "triple", "convention", or "hardware" for two of what built devices have.
    """

    kind: str
    seed: int
    frequencies: int = 48
    effects: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"gap, {self.kind} {self.seed}, 2 x {self.frequencies}, {NOISE:g} dB"

    def prepared(self) -> Callable[[int], str]:
        """As of `Job`."""
        if self.kind == "hardware":
            case = draw_hardware(
                self.seed, self.effects, noise_db=NOISE, frequencies=self.frequencies, points=2
            )
        else:
            case = _hiding(self.kind, self.seed, self.frequencies)
        program, sweep, values = parse_program(case.program), case.sweep, case.values
        return lambda seed: _found(ibrid.find_gap(program, sweep, values, seed=seed))


@dataclass(frozen=True)
class FindGapInRecordings:
    """A limit or block that recordings show, with a sweep beside them or without."""

    hidden: str
    seed: int

    def __str__(self) -> str:
        case, under = case_of(self.hidden, self.seed)
        noise = "clean" if under.noise_db is None else f"{under.noise_db:g} dB"
        beside = " beside a sweep" if under.swept else ""
        return f"gap, {self.hidden}, {_recorded(case.events)}, {noise}{beside}"

    def prepared(self) -> Callable[[int], str]:
        """As of `Job`."""
        case, _ = case_of(self.hidden, self.seed)
        return lambda seed: _found(
            ibrid.find_gap(
                case.diagram,
                case.sweep,
                case.values,
                events=case.events,
                holdout_op=(case.held,),
                seed=seed,
            )
        )


def _hiding(kind: str, seed: int, frequencies: int) -> Case:
    return draw_case(kind, seed, noise_db=NOISE, frequencies=frequencies)  # type: ignore[arg-type]


def _recorded(events: Events) -> str:
    first = events.records[0]
    rate = 1.0 / float(np.median(np.diff(first.time)))
    seconds = sum(float(one.time[-1] - one.time[0]) for one in events.records)
    return f"{len(events.records)} recordings, {seconds:.1f} s at {rate / 1e3:.1f} kHz"


def _found(gap: Gap) -> str:
    return ", ".join((gap.verdict, *(effect.id for effect in gap.effects)))


FITS = (
    Fit(Measured("gfl_l_filter", 2, 60)),
    Fit(Measured("gfl_l_filter", 2, 240, 50.0)),
    Fit(Measured("paper_like", 3, 60, 50.0), "gfl_pll_filter_exact"),
    Fit(Measured("paper_like", 2, 384, 40.0), "gfl_pll_filter_exact"),
    Fit(Measured("gfl_dc_link", 2, 48, 50.0)),
    Fit(Measured("gfm_droop", 2, 16)),
    Fit(Measured("gfm_droop", 2, 60)),
    Fit(Measured("gfm_droop", 3, 60)),
    Fit(Measured("gfm_droop", 2, 240)),
    Fit(Measured("gfm_droop", 3, 60, 50.0)),
    Fit(Measured("gfm_vsm", 3, 60)),
    Fit(Measured("gfm_vsm", 2, 48, 50.0)),
    Fit(Measured("gfm_dvoc", 3, 60, 50.0)),
    Fit(Measured("hybrid_gfl_gfm", 3, 60, 50.0)),
)
OTHERS: tuple[Job, ...] = (
    Start(Measured("gfm_vsm", 2, 48, 50.0)),
    Start(Measured("gfl_dc_link", 2, 48, 50.0)),
    Start(Measured("paper_like", 3, 60, 50.0)),
    Start(Measured("hybrid_gfl_gfm", 3, 60)),
    StartOnRecordings(2),
    *(Search(seed) for seed in (11, 12, 13, 14)),
    *(FindGap("effect", seed) for seed in (1, 2, 3)),
    *(FindGap("convention", seed) for seed in (1, 2, 3)),
    *(FindGap("triple", seed) for seed in (4, 5, 6)),
    FindGap(
        "hardware", 1, effects=("delay_angle:add:command", "resonant_control:add:negative_sequence")
    ),
    *(FindGapInRecordings("current_limit", seed) for seed in (0, 2, 5)),
    *(FindGapInRecordings("delay", seed) for seed in (2, 6)),
)
