"""How fast the parts of a search are: fits a second with one and two workers, the archive at its
cap, the overhead.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import median

import numpy as np
from ibrid_bench.search.inverters import inverter
from ibrid_bench.search.scoring import Search
from ibrid_bench.search.trials import EXACT_MODE
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.updates import META, read_updates
from ibrid_search.archives.archive import Archive
from ibrid_search.archives.ranking import Entry
from ibrid_search.evaluation.assess import Assessor
from ibrid_search.evaluation.job import Evaluator, Job
from ibrid_search.evaluation.local import LocalEvaluator
from ibrid_search.proposers.choose import Proposers
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.settings import SearchSettings

from ibrid.errors import IbridError
from ibrid.structure.diagrams.library import textbook, textbook_text
from ibrid.study import Study

#: Noise of the data of a search whose pace is measured.
NOISE_DB = 60.0
#: NRMSE that a candidate of the fitting rate must promise for more effort: late in a search most
#: promise nothing.
PROMISING = 1e-3


@dataclass(frozen=True)
class Pace:
    """A search on the benchmark at 60 dB, since on clean data it ends as soon as the diagram is
    found.

    `fitting` : seconds of fits: of the workers on candidates, and of the final choice.
    """

    workers: int
    evaluations: int
    seconds: float
    fitting: float

    @property
    def rate(self) -> float:
        """Evaluations a second, everything included."""
        return self.evaluations / self.seconds

    @property
    def overhead(self) -> float:
        """Share of the workers' time in which they did not fit."""
        return 1 - self.fitting / (self.workers * self.seconds)


def pace(search: Search, folder: Path, *, workers: int, budget: int) -> Pace:
    """Make a search with the rules proposer and add up what its store says of every evaluation."""
    sweep = inverter("paper_like").noisy(NOISE_DB, seed=0).sweep
    run = search(
        sweep,
        folder,
        proposer="rules",
        budget=budget,
        seed=0,
        workers=workers,
        holdout_op=(),
        **EXACT_MODE,
    )
    with Store.open(folder / ARCHIVE, read_only=True) as store:
        fitting = sum(step.seconds for step in store.steps())
        fitting += float(store.meta.get("refits", 0.0))
    return Pace(workers, run.evaluations, run.seconds, fitting)


def policy_step(search: Search, folder: Path, *, answers: int) -> dict[str, float]:
    """Median seconds of drawing so many answers of the shipped policy and of the update from them,
    in a search with the paper's profile; IbridError where torch is missing.
    """
    from ibrid_policy.backend import require

    require("torch")
    settings = LearningSettings(contexts=answers // LearningSettings().group)
    search(
        inverter("paper_like").sweep,
        folder,
        start=textbook("naive"),
        proposer=Proposers("policy", learn=settings),
        budget=answers,
        seed=0,
        holdout_op=(),
        **EXACT_MODE,
    )
    with Store.open(folder / ARCHIVE, read_only=True) as store:
        updates = read_updates(store.meta.get(META, ""))
    if not updates:
        raise IbridError(
            f"{folder}: ended before {answers} answers were drawn, so no step of the policy was "
            "timed"
        )
    return {
        "answers": answers,
        "sampling": median(one.seconds_sampling for one in updates),
        "update": median(one.seconds_update for one in updates),
    }


def local() -> Evaluator:
    """One worker: this process."""
    return LocalEvaluator(Assessor(Study(inverter("paper_like").sweep)))


def on_ray(workers: int) -> Evaluator:
    """Workers on a local Ray; IbridError where Ray is not installed."""
    from ibrid_search.evaluation.ray_actors import RayEvaluator

    return RayEvaluator(Assessor(Study(inverter("paper_like").sweep)), workers)


def fits_a_second(make: Callable[[], Evaluator], programs: Sequence[str]) -> float:
    """Rate at which candidates become records once every worker is there and has compiled code."""
    with make() as evaluator:
        number = 0
        while (
            number < 2 * evaluator.capacity
            or len(getattr(evaluator, "workers", "1")) < evaluator.capacity
        ):
            evaluator.submit(Job(-1 - number, programs[0], promising=PROMISING))
            evaluator.collect(-1 - number)
            number += 1
        started = time.perf_counter()
        for number, program in enumerate(programs):
            evaluator.submit(Job(number, program, promising=PROMISING))
        for number in range(len(programs)):
            evaluator.collect(number)
        return len(programs) / (time.perf_counter() - started)


_I_TI, _I_G = '"plant.i_ti", ', '"plant.i_g", '


def candidates() -> list[str]:
    """80 programs of 13 states each: the benchmark's structure with other wires, decouplings and
    shared gains.
    """
    base = textbook_text("gfl_pll_filter_exact")
    omega = '    g.connect("pll.delta_omega", "decoupling.delta_omega")\n'
    whole = '    g.add("JMul_omega", "decoupling")\n'
    wires = [f'    g.connect({i}"decoupling.in_")\n' for i in (_I_TI, _I_G)]
    out = '    g.connect("decoupling.out", "plant.u_r")\n'
    feedforward = '    g.connect("plant.e", "plant.u_r")\n'
    q_loop = '"q_loop", kP="power.kP", kI="power.kI"'
    decouplings = [
        [(wires[0], wires[0])],
        [(wires[0], wires[1])],
        [(whole, whole.replace("_omega", "")), (omega, "")],
        [(whole, whole.replace("_omega", "")), (omega, ""), (wires[0], wires[1])],
        [(whole, ""), (omega, ""), (wires[0], ""), (out, "")],
    ]
    found = []
    for decoupling, *others in product(
        decouplings,
        ([], [(f'{_I_TI}"minus_i', f'{_I_G}"minus_i')]),
        ([], [(f'{_I_G}"power.i"', f'{_I_TI}"power.i"')]),
        ([], [(feedforward, "")]),
        ([], [(q_loop, '"q_loop"')]),
    ):
        text = base
        for before, after in (*decoupling, *(change for part in others for change in part)):
            text = text.replace(before, after)
        found.append(text)
    return found


def archive_milliseconds(entries: int = 10_000, rounds: int = 2_000, seed: int = 0) -> float:
    """Median time of drawing one parent and admitting one child with so many entries in the
    archive, ms.
    """
    rng = np.random.default_rng(seed)
    settings = SearchSettings(population=entries)
    archive = Archive(settings)
    program = textbook_text("gfl_pll_filter_exact")
    archive.admit_start(_entry(0, None, 0, 0.0, program))
    spent = []
    for number in range(1, entries + rounds):
        started = time.perf_counter()
        parent, island = archive.sample(rng, number)
        drawn = time.perf_counter() - started
        child = _entry(number, parent.step, island, float(parent.reward + rng.normal()), program)
        started = time.perf_counter()
        archive.admit(child)
        spent.append(drawn + time.perf_counter() - started)
    return 1e3 * median(spent[-rounds:])


def _entry(step: int, parent: int | None, island: int, reward: float, program: str) -> Entry:
    return Entry(
        step,
        f"{step:064x}",
        parent,
        island,
        reward,
        float(np.exp(-reward)),
        13,
        12,
        step % 7 != 3,
        program,
    )
