"""What gaps and fits answer: verdicts, names, ranks and numbers of small cases, as they were before
the code was cut anew.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_bench.hidden.case import draw_case

import ibrid
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.gap.results.gap import Gap
from ibrid.gap.workflow import find_gap
from ibrid.parts.catalogue import CATALOGUE
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program

FOLDER = Path(__file__).parent
#: The amplitude case is drawn by simulation in time, which takes long: its files lie beside the
#: answers.
GOLDEN, AMPLITUDES = FOLDER / "gap.json", FOLDER / "gap_amplitudes.csv"
#: name -> kind and seed of a hidden case, how it is drawn, the effects that are tried, whether
#: edits are suggested.
CASES: dict[str, tuple[str, int, dict[str, Any], tuple[str, ...]]] = {
    "removed": (
        "effect",
        0,
        {"effects": ["decoupling:remove"], "severity": "gross", "noise_db": 60},
        ("decoupling",),
    ),
    "named": (
        "effect",
        3,
        {
            "effects": ["pll_prefilter:add"],
            "severity": "gross",
            "noise_db": 60,
            "points": 1,
            "frequencies": 6,
        },
        ("control_delay", "pll_prefilter"),
    ),
    "nothing": (
        "nothing",
        2,
        {"frequencies": 12},
        ("control_delay", "pll_prefilter", "decoupling"),
    ),
    "parameters": ("parameters", 1, {"noise_db": 50}, ("control_delay", "pll_prefilter")),
    "located": (
        "effect",
        3,
        {"effects": ["pll_prefilter:add"], "severity": "gross", "noise_db": 60, "frequencies": 8},
        ("decoupling",),
    ),
}
#: Shipped sweep, diagram: of each the fit without further waves.
FITS = (
    ("paper_like", "gfl_exact"),
    ("paper_like", "gfl_pll_filter_exact"),
    ("published_sienna_lcl", "gfl"),
)
#: Hz, from the slowest loop to beyond the corner of the filter.
FREQUENCY = np.geomspace(0.5, 5000.0, 60)


def effects(names: Sequence[str]):
    return tuple(one for one in CATALOGUE if one.id in names)


def answered(name: str) -> Gap:
    if name == "amplitudes":
        given = json.loads(GOLDEN.read_text(encoding="utf-8"))["given"]
        return find_gap(
            parse_program(given["program"]), ibrid.read_sweep(AMPLITUDES), given["values"]
        )
    kind, seed, options, tried = CASES[name]
    case = draw_case(kind, seed, **options)
    held = case.sweep.names[-1:] if name == "located" else ()
    return find_gap(
        parse_program(case.program),
        case.sweep,
        case.values,
        catalogue=effects(tried),
        holdout_op=held,
    )


def words_of(gap: Gap) -> dict[str, Any]:
    """What must be the same to the letter."""
    return {
        "verdict": gap.verdict,
        "sentence": gap.sentence,
        "effects": [
            [one.id, one.change, one.where, *one.indistinguishable_from] for one in gap.effects
        ],
        "candidates": [[one.id, one.change, one.where, one.reason] for one in gap.candidates],
        "adequate": [one.port.name for one in gap.ports if one.adequate],
        "ports": sorted(one.port.name for one in gap.ports),
        "located": [[one.op, one.entry] for one in gap.located],
        "moved": sorted(one.name for one in gap.moved),
        "unseen": sorted({one.id for one in gap.could_not_have_seen}),
        "suggested": [[one.words, one.reason] for one in gap.suggested],
        "nonlinear": []
        if gap.amplitude is None
        else [[one.id, one.words] for one in gap.amplitude.tried],
        "program": gap.program,
    }


def numbers_of(gap: Gap) -> dict[str, list[float]]:
    """What must be the same but for rounding; -1 for what is not known."""
    transfer = gap.missing_transfer
    numbers = {
        "errors": [*gap.before.values(), *gap.after.values(), gap.noise_floor],
        "parameters": [
            value for one in gap.effects for value in (next(iter(one.parameters.values()), ()))
        ],
        "costs": [one.cost for one in gap.candidates],
        "ports": [one.chi2_per_dof for one in gap.ports if one.adequate],
        "transfer": []
        if transfer is None
        else [*transfer.value.real, *transfer.value.imag, *transfer.deviation],
        "nonlinear": []
        if gap.amplitude is None
        else [one.chi2_per_dof for one in gap.amplitude.tried],
    }
    return {
        what: [-1.0 if one is None else float(one) for one in found]
        for what, found in numbers.items()
    }


def fitted(sweep: str, diagram: str) -> Record:
    """The fit of a shipped diagram to a shipped sweep, without further waves."""
    data = ibrid.read_sweep(ibrid.benchmarks()[sweep])
    return ibrid.evaluate(textbook(diagram), data, settings=FitSettings(restarts=1, hops=1))


def seen_parameters(record: Record) -> set[str]:
    """Those that the data determine: the others have no interval, and end wherever the rounding of
    a processor left them.
    """
    return {
        name
        for intervals in record.intervals.values()
        for name, interval in intervals.items()
        if interval is not None
    }


def with_values(record: Record, values: dict[str, float]) -> Record:
    return replace(
        record, parameters={op: {**known, **values} for op, known in record.parameters.items()}
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CASES, "amplitudes"])
def test_a_gap_has_the_answer_that_it_had(name: str):
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))[name]
    gap = answered(name)
    assert words_of(gap) == golden["words"]
    for what, numbers in numbers_of(gap).items():
        # costs without noise are what rounding leaves, far below one
        assert numbers == pytest.approx(golden["numbers"][what], rel=1e-6, abs=1e-6), what


@pytest.mark.slow
@pytest.mark.parametrize(("sweep", "diagram"), FITS)
def test_a_fit_ends_in_the_minimum_in_which_it_ended(sweep: str, diagram: str):
    """What the data show is compared: the error, the parameters that they determine, and the
    admittance of all of them.
    """
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))["fits"][f"{sweep} {diagram}"]
    record = fitted(sweep, diagram)
    known = {name: value for name, value in golden.items() if name != "nrmse"}
    (found,) = {tuple(sorted(values.items())) for values in record.parameters.values()}
    assert dict(found).keys() == known.keys()
    # a descent ends within 1e-7 of its minimum; an error without noise is what rounding leaves
    assert record.nrmse == pytest.approx(golden["nrmse"], rel=1e-6, abs=1e-12)
    seen = seen_parameters(record)
    assert {name: dict(found)[name] for name in seen} == pytest.approx(
        {name: known[name] for name in seen}, rel=1e-6
    )
    golden_model = with_values(record, known)
    for op in record.parameters:
        response = record.response(op, FREQUENCY)
        wanted = golden_model.response(op, FREQUENCY)
        # processors differ by 1e-14 here; a parameter that ends 1e-6 elsewhere, out of step with
        # the others, by more than 1e-9
        np.testing.assert_allclose(response, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
