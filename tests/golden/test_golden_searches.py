"""What searches do, step by step: the structures and ends of a few short ones, as they were before
the code was cut anew.

Results follow from the structures alone, so that nothing depends on a fit; proposers, archive and
order of steps are real.
"""

import json
from pathlib import Path

import pytest
from ibrid_search.proposers.choose import Proposers
from scripted_search import ended, steps_of

import ibrid
from ibrid.fit import kernel

GOLDEN = Path(__file__).parent / "searches.json"
SWEEPS = ("paper_like", "published_sienna_lcl")
PROPOSERS = ("rules", "random", "rules:0.5,random:0.5")


def course(folder: Path, sweep: str, proposer: str, seed: int) -> dict[str, list[str]]:
    """Who proposed, on which parent, which structure, and how it ended, of every step."""
    data = ibrid.read_sweep(ibrid.benchmarks()[sweep])
    archive = folder / f"{sweep}-{proposer}-{seed}.sqlite".replace(":", "_")
    ending, _ = ended(
        archive, sweep=data, proposers=Proposers(proposer).weighted(), budget=20, seed=seed
    )
    steps = [
        f"{one.proposer or 'start'} {one.parent} {one.hash[:12]} {one.status}"
        for one in steps_of(archive)
    ]
    return {"steps": steps, "ending": [ending]}


@pytest.mark.slow
@pytest.mark.parametrize("sweep", SWEEPS)
def test_a_search_takes_the_steps_that_it_took(sweep: str, tmp_path: Path):
    kernel.load()
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))
    for proposer in PROPOSERS:
        for seed in (0, 1):
            assert (
                course(tmp_path, sweep, proposer, seed) == golden[f"{sweep} {proposer} {seed}"]
            ), (proposer, seed)
