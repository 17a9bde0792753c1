"""The searches that the benchmark makes: which inverter, which data, which rules, which proposer,
which seed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ibrid_bench.search.hidden import Hidden
from ibrid_bench.search.inverters import hardware, inverter, inverter_names

from ibrid.errors import IbridError, near
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook

#: The paper's own setting; the structure of the benchmark, clean and noisy; all other hidden
#: inverters; measured ones.
TABLES = ("paper", "structure", "inverters", "hardware")
#: Evaluations of a search of each table. Measured sweeps have 60 to 100 frequencies, and a fit
#: takes as much longer.
BUDGETS: Mapping[str, int] = {"paper": 500, "structure": 1000, "inverters": 1000, "hardware": 150}
#: The same on noisy data: what comes after the noise floor, which is reached in a third of that,
#: changes little.
NOISY_BUDGET = 500
#: By diagnosis a tenth of that is plenty.
DIAGNOSIS, DIAGNOSIS_BUDGET = "diagnosis", 100
#: The default on the left, the baselines beside it.
PROPOSERS = (DIAGNOSIS, "rules", "random")
#: Hidden pairs of inverters: the search is told so.
PAIRS = ("parallel_gfl_gfm",)
#: Noise on the data of the benchmark, and of all other hidden inverters; None: clean.
NOISE_DB, OTHERS_DB = (None, 60.0, 40.0), (None, 50.0, 40.0)

#: The inverter of the first two tables.
BENCHMARK = "paper_like"

PAPER_MODE: Mapping[str, Any] = {
    "parameters": "per-op",
    "equilibrium": "paper",
    "vocabulary": "paper",
}
EXACT_MODE: Mapping[str, Any] = {
    "parameters": "shared",
    "equilibrium": "exact",
    "vocabulary": "extended",
}


@dataclass(frozen=True)
class Trial:
    """A search to make.

    `table` : of `TABLES`. `inverter` : name of a hidden one. `noise_db` : None for clean data.
    """

    table: str
    inverter: str
    proposer: str
    seed: int
    budget: int
    noise_db: float | None = None

    @property
    def data(self) -> str:
        """clean, or the noise in words."""
        return "clean" if self.noise_db is None else f"{self.noise_db:g} dB"

    @property
    def key(self) -> str:
        """Names the trial, in the results and as a folder."""
        data = self.data.replace(" ", "")
        return f"{self.table}-{self.inverter}-{data}-{self.proposer}-{self.budget}-{self.seed}"

    @property
    def start(self) -> str | None:
        """The baselines begin with the naive diagram, as everything does in the paper's setting;
        None: with what ships.
        """
        return None if self.proposer == DIAGNOSIS and self.table != "paper" else "naive"

    @property
    def devices(self) -> int:
        """Inverters behind the terminals, which a search is told."""
        return 2 if self.inverter in PAIRS else 1

    @property
    def mode(self) -> Mapping[str, Any]:
        """Options of the search and of every evaluation."""
        return PAPER_MODE if self.table == "paper" else EXACT_MODE

    def hidden(self) -> Hidden:
        """The inverter with the data that the search gets; the noise has the trial's seed."""
        clean = inverter(self.inverter)
        return clean if self.noise_db is None else clean.noisy(self.noise_db, self.seed)

    def truth(self, hidden: Hidden) -> Diagram | None:
        """What should be found: in the paper's setting the benchmark in the paper's kinds; None for
        hardware.
        """
        return textbook("gfl_pll_filter") if self.table == "paper" else hidden.truth


def rules_trial(name: str, budget: int, noise_db: float | None = None) -> Trial:
    """The search of an inverter by rules, seed 0, exact equilibrium, under the name that it has in
    the tables.
    """
    return Trial(
        "structure" if name == BENCHMARK else "inverters", name, "rules", 0, budget, noise_db
    )


def trials(
    seeds: Sequence[int],
    budget: int | None = None,
    *,
    only: Sequence[str] = (),
    proposers: Sequence[str] = PROPOSERS,
    data: Sequence[str] = (),
    few: bool = False,
) -> Iterator[Trial]:
    """All searches, seed by seed and proposer beside proposer.

    budget : evaluations of each; None: the usual ones. only : names of tables or inverters; none:
    all. data : "clean", "50 dB" and so on; none: all. few : one inverter of each sort instead of
    all of them. Raises IbridError, at the first one asked for, when a name is unknown.
    """
    known = (*TABLES, *inverter_names(), *_hardware_names())
    for name in only:
        if name not in known:
            raise IbridError(
                f"there is no table and no hidden inverter called {name}; {near(name, known)}"
            )
    for table, name, noise_db in _cases(few):
        if not only or table in only or name in only:
            for seed in seeds:
                for proposer in proposers:
                    limit = budget or _usual_budget(table, proposer, noise_db)
                    trial = Trial(table, name, proposer, seed, limit, noise_db)
                    if not data or trial.data in data:
                        yield trial


def _usual_budget(table: str, proposer: str, noise_db: float | None) -> int:
    if proposer == DIAGNOSIS:
        return DIAGNOSIS_BUDGET
    return BUDGETS[table] if noise_db is None else NOISY_BUDGET


def _cases(few: bool) -> Iterator[tuple[str, str, float | None]]:
    yield "paper", BENCHMARK, None
    for noise_db in NOISE_DB:
        yield "structure", BENCHMARK, noise_db
    others = ("l_filter", "delay", "droop", "unusual", "random_00") if few else inverter_names()[1:]
    for name in others:
        for noise_db in OTHERS_DB:
            yield "inverters", name, noise_db
    for name in _hardware_names():
        yield "hardware", name, None


def _hardware_names() -> tuple[str, ...]:
    return tuple(one.name for one in hardware())
