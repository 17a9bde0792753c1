"""A diagram is compiled once: one evaluation wires it once, and answers of the compiled value are
those of the functions.
"""

import pickle
from collections import Counter
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

import ibrid
from ibrid.errors import DiagramError
from ibrid.evaluation.evaluate import record_at
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.structure.compiling.canonical import canonical_order
from ibrid.structure.compiling.check import examine
from ibrid.structure.compiling.compiled import CompiledDiagram, compile_diagram
from ibrid.structure.network.outside import Outside
from ibrid.structure.reading import parameters, wiring
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.study import Study

#: The least that a fit can do: what is counted does not depend on it.
BRIEF = ibrid.FitSettings(starts=4, kept=1, kept_misfit=1, restarts=0, hops=0)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How many wirings `wire` and how many tables `parameter_table` made, by whatever name they
    were called: both look up the class that they make in the module in which they are defined.
    """
    counts: Counter[str] = Counter()

    def count(module, name: str, what: str) -> None:
        cls = getattr(module, name)

        def counted(*args, **keywords):
            counts[what] += 1
            return cls(*args, **keywords)

        monkeypatch.setattr(module, name, counted)

    count(wiring, "Wiring", "wirings")
    count(parameters, "ParameterTable", "tables")
    return counts


@pytest.fixture(scope="module")
def small() -> Sweep:
    """One operating point at few frequencies."""
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    point = sweep.points[0]
    kept = np.arange(0, len(point.frequency), max(1, len(point.frequency) // 12))
    sigma = None if point.sigma is None else point.sigma[kept]
    fewer = replace(
        point, frequency=point.frequency[kept], admittance=point.admittance[kept], sigma=sigma
    )
    return replace(sweep, points=(fewer,))


def test_an_evaluation_wires_its_diagram_once(small: Sweep, made: Counter[str]):
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), small, settings=BRIEF)
    assert record.outcome == "ok"
    assert made == {
        "wirings": 1,
        "tables": 2,
    }  # in the order of the program, and in the canonical one for the fit


def test_an_evaluation_with_fitted_equilibria_wires_once(small: Sweep, made: Counter[str]):
    diagram = ibrid.textbook("gfl_pll_filter")
    record = ibrid.evaluate(
        diagram, small, equilibrium="paper", parameters="per-op", settings=BRIEF
    )
    assert record.outcome == "ok"
    assert made == {"wirings": 1, "tables": 3}  # and of the exact equilibrium, for algebraic loops


def test_a_record_at_given_values_wires_once(small: Sweep, made: Counter[str]):
    diagram = ibrid.textbook("gfl_pll_filter_exact")
    values = {one.name: one.typical for one in compile_diagram(diagram).parameter_table.free}
    made.clear()
    assert record_at(diagram, small, values).outcome == "ok"
    assert made["wirings"] == 1


def test_all_answers_of_the_grammar_come_from_one_wiring(made: Counter[str]):
    compiled = compile_diagram(ibrid.textbook("gfl_exact"))
    assert not compiled.violations
    assert not compiled.warnings
    assert compiled.structure_hash
    assert len(compiled.canonical_order) == len(compiled.canonical_wiring.instances)
    assert made == {"wirings": 1, "tables": 1}


@pytest.mark.parametrize("equilibrium", ["exact", "paper"])
@pytest.mark.parametrize("name", ["gfl", "gfl_exact", "gfl_pll_filter_exact"])
def test_the_functions_answer_as_the_compiled_diagram(name: str, equilibrium: str):
    diagram = ibrid.textbook(name)
    compiled = compile_diagram(diagram, "extended", equilibrium=equilibrium)
    table = parameter_table(wire(diagram, VOCABULARY), equilibrium)
    assert (compiled.violations, compiled.warnings) == examine(diagram, equilibrium=equilibrium)
    assert compiled.structure_hash == ibrid.structure_hash(diagram, equilibrium=equilibrium)
    assert compiled.canonical_order == canonical_order(diagram, equilibrium=equilibrium)
    assert (compiled.parameter_table.free, compiled.parameter_table.bound) == (
        table.free,
        table.bound,
    )


def test_nothing_added_later_changes_a_compiled_diagram():
    diagram = ibrid.textbook("gfl_exact")
    compiled = compile_diagram(diagram)
    before = ibrid.structure_hash(diagram)
    diagram.add("Gain_dq", "later")
    assert compiled.structure_hash == before != ibrid.structure_hash(diagram)
    with pytest.raises(FrozenInstanceError):
        compiled.equilibrium = "paper"  # type: ignore[misc]


def test_an_unknown_kind_is_a_violation_and_has_no_wiring():
    diagram = ibrid.textbook("gfl_exact")
    diagram.add("Gian_dq", "misspelt")
    compiled = compile_diagram(diagram)
    assert [one.reason for one in compiled.violations if one.reason == "unknown_kind"]
    assert compiled.warnings == ()
    with pytest.raises(DiagramError, match="Gian_dq"):
        _ = compiled.wiring


def test_a_vocabulary_and_an_equilibrium_that_do_not_exist_are_refused():
    with pytest.raises(DiagramError, match="did you mean exact"):
        compile_diagram(ibrid.textbook("gfl_exact"), equilibrium="exakt")
    with pytest.raises(DiagramError, match="did you mean paper"):
        compile_diagram(ibrid.textbook("gfl_exact"), "papre")


def test_what_travels_is_what_was_given():
    compiled = compile_diagram(ibrid.textbook("gfl_exact"), PAPER_VOCABULARY)
    assert compiled.violations is compiled.violations
    there = pickle.loads(pickle.dumps(compiled))
    assert vars(there).keys() == {"diagram", "vocabulary", "equilibrium"}
    assert there.violations == compiled.violations


def test_labels_that_are_doubted_are_parameters_of_another_value(small: Sweep):
    compiled = Study(small).compiled(ibrid.textbook("gfl_exact"))
    doubting = compiled.behind(Outside(labels=("power_scale",)))
    assert compiled.behind(compiled.diagram.outside) is compiled
    assert isinstance(doubting, CompiledDiagram)
    assert doubting.parameter_table.names == (*compiled.parameter_table.names, "label.power_scale")
    assert doubting.structure_hash == compiled.structure_hash
