"""What is given to a public function is of the right kind, or a sentence says which is; what is
frozen cannot be changed.
"""

import copy
import inspect
import json
import pickle
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_search import Goal, Limits, Proposers, SearchSettings, Workers

import ibrid
from ibrid import analysis, export, measurement, modules, parts, plants, structure
from ibrid.border import takes_kinds
from ibrid.errors import IbridError, UnforeseenError
from ibrid.frozen import Frozen, FrozenDict, frozen
from ibrid.measurement.recordings.events import EventRecord

#: What is given in place of anything.
ODD = (None, "x", 3, object(), ["x"])


def public_functions() -> Iterator[Callable]:
    for package in (ibrid, measurement, analysis, export, modules, parts, plants, structure):
        for name in package.__all__:
            if inspect.isfunction(function := getattr(package, name)):
                yield function


def breaks_off(function: Callable, **given: object) -> str:
    """How a call ends that is neither an answer nor one of our sentences."""
    try:
        function(**given)
    except IbridError as error:
        return "" if str(error) else "an error without a word"
    except Exception as error:
        return f"{function.__name__}({given}) broke off with {type(error).__name__}: {error}"
    return ""


@pytest.mark.slow
def test_every_public_function_refuses_what_is_of_another_kind_in_a_sentence(
    tmp_path: Path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    complaints = []
    for function in public_functions():
        known = inspect.signature(function).parameters.values()
        named = [one for one in known if one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)]
        required = [one.name for one in named if one.default is one.empty]
        for parameter in named:
            for odd in ODD:
                given = {**dict.fromkeys(required, odd), parameter.name: odd}
                complaints.append(breaks_off(function, **given))
    assert not list(filter(None, complaints))
    assert len(complaints) > 300


def public_values() -> Iterator[object]:
    """One of each public class that has methods or is made by hand."""
    record, measured = evaluated("gfl_exact"), benchmark()
    yield from (record, record.diagram, measured, measured.points[0], measured.points[0].op)
    yield from (ibrid.Study(measured), ibrid.FitSettings(), ibrid.textbook("gfl"))
    kind = ibrid.VOCABULARY[3]
    yield from (
        kind,
        next(iter(kind.parameters.values())),
        next(filter(None, (one.large_signal for one in ibrid.VOCABULARY))),
    )
    yield from (Goal(), Limits(), Proposers(), SearchSettings(), Workers())
    yield ibrid.stability(record, [2.0])
    yield ibrid.power_jacobian(record, measured.points[0].op.name, [7.0])
    yield ibrid.predict(record, measured.points[0].op, np.array([5.0, 50.0]))
    t = np.arange(400) / 5000
    v = np.stack([np.where(t < 0.04, 1.0, 0.6), 0 * t], axis=1)
    yield from (
        moved := EventRecord(measurement.OperatingPoint("dip", 1.0, 0.0), t, v, v, 0.04),
        ibrid.Events((moved,)),
    )


def own_methods(value: object) -> Iterator[Callable]:
    for name, member in inspect.getmembers(type(value), inspect.isfunction):
        if (name == "__getitem__" or not name.startswith("_")) and member.__module__.startswith(
            "ibrid"
        ):
            yield getattr(value, name)


def named_arguments(function: Callable) -> list[inspect.Parameter]:
    known = inspect.signature(function).parameters.values()
    return [one for one in known if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]


def test_every_method_of_a_public_value_refuses_what_is_of_another_kind_in_a_sentence(
    tmp_path: Path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    complaints = []
    for value in public_values():
        for method in own_methods(value):
            if (
                arguments := named_arguments(method)
            ) and method.__name__ != "add":  # of which two have no names
                required = [one.name for one in arguments if one.default is one.empty]
                for odd in (*ODD, np.zeros(2), 10**400):
                    for argument in arguments:
                        complaints.append(
                            breaks_off(
                                method, **{**dict.fromkeys(required, odd), argument.name: odd}
                            )
                        )
    assert not list(filter(None, complaints))
    assert len(complaints) > 300


def test_no_public_value_can_be_made_with_a_field_of_another_kind_without_a_sentence():
    complaints = []
    for value in public_values():
        given = {
            name: getattr(value, name)
            for one in named_arguments(type(value))
            if hasattr(value, name := one.name)
        }
        for name in given:
            for odd in (*ODD, np.zeros(2), 10**400):
                complaints.append(breaks_off(type(value), **{**given, name: odd}))
    assert not list(filter(None, complaints))
    assert len(complaints) > 300


@pytest.mark.slow
@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: ibrid.inspect(3),
            "sweep must be a Sweep or an Events, found 3; make one with ibrid.read_sweep(FILE)",
        ),
        (
            lambda: ibrid.compare(None, None),
            "first must be a Diagram, found None; make one with ibrid.textbook(NAME)",
        ),
        (
            lambda: ibrid.find_gap(None, benchmark()),
            "diagram must be a Diagram or a Record, found None",
        ),
        (
            lambda: ibrid.evaluate(ibrid.textbook("gfl"), benchmark(), sede=1),
            "evaluate: has no option 'sede'; did you mean seed",
        ),
        (
            lambda: ibrid.stability(evaluated("gfl_exact"), src=2),
            "stability: has no option 'src'; did you mean scr",
        ),
        (lambda: ibrid.compare("naive"), "compare: needs second too; see help(compare)"),
        (lambda: measurement.merge("x"), "sweeps must be a sequence of Sweep, found 'x'"),
        (lambda: measurement.merge([1]), "sweeps must be a sequence of Sweep, found a list"),
        (
            lambda: ibrid.predict(evaluated("gfl_exact"), 1, np.ones(3)),
            "op must be text or an OperatingPoint, found 1",
        ),
    ],
)
def test_the_sentence_says_what_is_taken_what_was_given_and_how_it_is_made(call, sentence):
    with pytest.raises(IbridError) as caught:
        call()
    assert sentence in str(caught.value)


def test_what_an_annotation_leaves_open_passes():
    @takes_kinds
    def told(
        name: str, numbers: np.ndarray, where: str | Path | None = None, **further: object
    ) -> tuple:
        return name, numbers, where, further

    assert told("a", [1.0, 2.0], Path("x"), more=3) == ("a", [1.0, 2.0], Path("x"), {"more": 3})
    assert told(name="a", numbers=2.5) == ("a", 2.5, None, {})
    with pytest.raises(IbridError, match="needs numbers too"):
        told("a")


def test_what_fails_in_the_midst_is_one_of_our_errors_that_tells_its_cause():
    with pytest.raises(
        UnforeseenError, match=r"sweep: cannot be done with these arguments \(TypeError"
    ) as found:
        ibrid.sweep("paper_like", None, [5.0], overrides={"L_F": object()})
    assert isinstance(found.value.__cause__, TypeError)


def test_what_code_of_the_users_raises_is_theirs():
    @takes_kinds
    def asked(one: Callable[[], int]) -> int:
        return one()

    def mine() -> int:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        asked(mine)


@pytest.mark.parametrize(
    "call",
    [
        lambda record, sweep: ibrid.predict(record, "p=0.8,q=0", []),
        lambda record, sweep: ibrid.predict(record, "p=0.8,q=0", [-1.0, 5.0]),
        lambda record, sweep: ibrid.predict(record, "p=0.8,q=0", 10**400),
        lambda record, sweep: ibrid.stability(record, [10**400]),
        lambda record, sweep: ibrid.stability(record, [2.0], frequency=np.zeros((2, 2, 2, 2))),
        lambda record, sweep: ibrid.sweep("paper_like", None, [5.0], overrides={"plant.L_F": None}),
        lambda record, sweep: ibrid.inspect(sweep, sampling_hz=-1.0),
        lambda record, sweep: ibrid.add_noise(
            sweep, 40, rng=np.random.default_rng(0), repeats=10**400
        ),
        lambda record, sweep: ibrid.structure_hash(record.diagram, equilibrium="x"),
        lambda record, sweep: ibrid.Study(sweep, vocabulary=None),
        lambda record, sweep: ibrid.Study(sweep, devices="x"),
        lambda record, sweep: ibrid.Study(sweep, events=1),
        lambda record, sweep: record.point("nowhere"),
        lambda record, sweep: record.state_space(None),
        lambda record, sweep: record.state_space(
            record.settings["fitted_points"][0], cut="nothing"
        ),
        lambda record, sweep: record.write(None),
        lambda record, sweep: ibrid.read_program("a\0b"),
        lambda record, sweep: ibrid.read_events("x" * 5000),
    ],
)
def test_values_that_mean_nothing_are_our_errors(call):
    record = evaluated("gfl_exact")
    with pytest.raises(IbridError):
        call(record, benchmark())


def test_a_sequence_of_what_only_says_what_it_can_do_passes():
    class Asks(Protocol):
        def __call__(self) -> int: ...

    @takes_kinds
    def asked(those: Sequence[Asks]) -> int:
        return sum(one() for one in those)

    assert asked([lambda: 1, lambda: 2]) == 3


# --- what is frozen


@pytest.mark.slow
def test_no_number_of_a_record_can_be_changed():
    record = evaluated("gfl_exact")
    with pytest.raises(TypeError, match="frozen"):
        record.parameters["p=1,q=0.3"]["plant.L_F"] = 0.2  # type: ignore[index]
    with pytest.raises(TypeError, match="frozen"):
        record.settings.update(seed=1)  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="frozen"):
        record.poles["p=1,q=0.3"].append([0.0, 0.0])  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_frozen_record_travels_and_is_written_as_before():
    record = evaluated("gfl_exact")
    assert pickle.loads(pickle.dumps(record)) == copy.deepcopy(record) == record
    assert (
        ibrid.Record.from_json(json.loads(json.dumps(record.to_json()))).to_json()
        == record.to_json()
    )
    assert type(dict(record.parameters)) is dict


def test_a_sweep_that_was_pickled_or_copied_cannot_be_changed_either():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["gfl_l_filter"])
    for one in (pickle.loads(pickle.dumps(sweep)), copy.deepcopy(sweep)):
        with pytest.raises(ValueError, match="read-only"):
            one.points[0].admittance[0, 0, 0] = 99


@pytest.mark.parametrize(
    "options", [{"port": 3}, {"holdout_op": [1, 2]}, {"parameters": np.zeros(2)}]
)
def test_an_option_that_is_passed_on_is_of_its_kind(options):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["gfl_l_filter"])
    with pytest.raises(IbridError, match=f"{next(iter(options))} must be"):
        ibrid.evaluate(ibrid.textbook("gfl_l_filter"), sweep, **options)


@pytest.mark.slow
def test_arrays_of_what_is_frozen_are_read_only_also_after_a_travel():
    prediction = ibrid.predict(evaluated("gfl_exact"), "p=1,q=0.3", np.geomspace(5, 5000, 8))
    for one in (prediction, pickle.loads(pickle.dumps(prediction))):
        with pytest.raises(ValueError, match="read-only"):
            one.admittance[0, 0, 0] = 0.0


def test_the_owner_of_an_array_may_change_it_as_before():
    mine = np.zeros(2)
    assert not frozen(mine).flags.writeable
    mine[0] = 1.0
    assert frozen(mine)[0] == 1.0


def test_no_way_to_change_a_dictionary_is_left_open():
    given = FrozenDict(a=1)
    for name in (
        "clear",
        "pop",
        "popitem",
        "setdefault",
        "update",
        "__setitem__",
        "__delitem__",
        "__ior__",
    ):
        with pytest.raises(TypeError, match="a copy"):
            getattr(given, name)("a")
    assert given == {"a": 1}
    assert given | {"b": 2} == {"a": 1, "b": 2}


def test_public_values_with_mappings_or_arrays_are_frozen_throughout():
    for kind in (ibrid.Record, ibrid.ModuleKind):
        assert issubclass(kind, Frozen)
    with pytest.raises(TypeError):
        ibrid.VOCABULARY[0].parameters["x"] = None  # type: ignore[index]


MEASURED = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
MADE_WRONGLY: dict[str, Callable[[], object]] = {
    "a sweep of a name": lambda: ibrid.Sweep("a.csv"),  # type: ignore[arg-type]
    "a sweep of nothing": lambda: ibrid.Sweep(None),  # type: ignore[arg-type]
    "a frequency as text": lambda: ibrid.Sweep(MEASURED.points, f0_hz="50"),  # type: ignore[arg-type]
    "notes as text": lambda: ibrid.Sweep(MEASURED.points, notes="abc"),  # type: ignore[arg-type]
    "events of nothing": lambda: ibrid.Events(None),  # type: ignore[arg-type]
    "an operating point by number": lambda: MEASURED.point(0),  # type: ignore[arg-type]
    "one by index": lambda: MEASURED[0],  # type: ignore[index]
    "points by number": lambda: MEASURED.only(0),  # type: ignore[arg-type]
    "left out by number": lambda: MEASURED.without(0),  # type: ignore[arg-type]
    "a range of text": lambda: ibrid.Range("1", 2.0, 3.0, "pu", "x"),  # type: ignore[arg-type]
    "an objective that is an array": lambda: ibrid.FitSettings(objective=np.array(["a", "b"])),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("what", MADE_WRONGLY)
def test_public_values_of_wrong_kinds_are_refused_in_a_sentence(what: str):
    with pytest.raises(IbridError, match=r"must|is not in the sweep"):
        MADE_WRONGLY[what]()


def test_arrays_of_measured_data_are_not_opened_again():
    sweep = benchmark()
    for one in (sweep, pickle.loads(pickle.dumps(sweep)), copy.deepcopy(sweep)):
        for array in (one.points[0].frequency, one.points[0].admittance):
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)


@pytest.mark.parametrize("value", [0, None, "dq", 1.5])
def test_a_signal_that_does_not_exist_is_a_sentence(value):
    with pytest.raises(IbridError, match="must be the name of a kind of port"):
        ibrid.Signal(value)


@pytest.mark.parametrize("entry", ["zz", "", 0, None])
def test_an_entry_that_does_not_exist_is_a_sentence_where_all_four_are_drawn_too(entry):
    with pytest.raises(IbridError, match="entry must be"):
        ibrid.plot(benchmark(), entry=entry)
