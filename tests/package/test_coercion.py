"""Public functions take what the command line takes: names, paths, tables and responses."""

import inspect
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from fitted import benchmark, evaluated

import ibrid
from ibrid import cli
from ibrid.errors import AT_THE_PROMPT, IbridError, SweepError, in_python, where_it_is_said
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.importing.told import base_of

SHIPPED = ibrid.benchmarks()["paper_like"]


def test_a_name_a_path_and_a_table_are_the_same_sweep():
    given = ("paper_like", str(SHIPPED), SHIPPED, benchmark().to_dataframe())
    looks = [ibrid.inspect(one).to_json() for one in given]
    assert all(look["points"] == looks[0]["points"] for look in looks)


def test_names_stand_for_diagrams():
    by_name = ibrid.compare("gfl", "gfl_exact")
    assert by_name == ibrid.compare(ibrid.textbook("gfl"), ibrid.textbook("gfl_exact"))


def test_a_file_of_a_record_stands_for_the_record(tmp_path: Path):
    record = evaluated("gfl_exact")
    record.save(tmp_path / "fit.json")
    loaded = ibrid.load(tmp_path / "fit.json")
    assert loaded.to_json() == record.to_json()
    from_file = ibrid.stability(str(tmp_path / "fit.json"), [2.0])
    assert from_file.sentences == ibrid.stability(record, [2.0]).sentences


def test_a_sweep_that_was_saved_is_loaded(tmp_path: Path):
    benchmark().save(tmp_path / "sweep.csv")
    loaded = ibrid.load(tmp_path / "sweep.csv")
    assert np.array_equal(loaded.points[0].admittance, benchmark().points[0].admittance)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: ibrid.inspect("paper_lik"), "did you mean paper_like?"),
        (lambda: ibrid.compare("gfl", "gf"), "did you mean gfl?"),
        (lambda: ibrid.compare("def f(g):\n    pass", "gfl"), "ibrid.parse_program(TEXT)"),
        (lambda: ibrid.stability("gfl", [2.0]), 'ibrid.evaluate("gfl", sweep)'),
        (lambda: ibrid.inspect(control.tf([1], [1, 1])), "ibrid.from_system(system, p=0.8, q=0.1)"),
    ],
)
def test_what_cannot_be_taken_is_a_sentence_with_the_next_step(call, sentence):
    with pytest.raises(IbridError) as caught:
        call()
    assert sentence in str(caught.value)


def test_a_signature_shows_the_options_of_a_study_with_their_defaults():
    shown = inspect.signature(evaluate).parameters
    assert (shown["seed"].default, shown["holdout_op"].default) == (0, ())
    assert "network" in shown
    assert "options" not in shown
    for function in (ibrid.evaluate, ibrid.find_gap, ibrid.search, ibrid.evaluate_events):
        assert "<class" not in str(inspect.signature(function))


def test_a_band_of_a_sweep_has_the_frequencies_within():
    sweep = benchmark()
    band = sweep["10-500Hz"].points[0]
    inside = (sweep.points[0].frequency >= 10) & (sweep.points[0].frequency <= 500)
    assert np.array_equal(band.frequency, sweep.points[0].frequency[inside])
    assert np.array_equal(sweep["0.01-0.5kHz"].points[0].frequency, band.frequency)
    assert np.array_equal(sweep["10Hz-0.5kHz"].points[0].frequency, band.frequency)
    assert sweep[sweep.names[0]] == sweep.point(sweep.names[0])
    with pytest.raises(IbridError, match="it has 5 to 5000 Hz"):
        sweep["6000-7000Hz"]
    with pytest.raises(IbridError):  # no number
        sweep["1.2.3-4kHz"]


def test_impedance_magnitude_phase_and_sequences_follow_from_the_admittance():
    point = benchmark().points[0]
    assert np.allclose(point.Z @ point.Y, np.eye(2))
    phase = np.radians(point.deg)
    assert np.allclose(10 ** (point.db / 20) * np.exp(1j * phase), point.Y)
    # what treats both axes alike, a I + b J, has no coupling of sequences: a -+ jb on the diagonal
    even = ibrid.measurement.PointSweep(
        point.op, np.array([50.0]), np.array([[[2.0, -3.0], [3.0, 2.0]]], dtype=complex)
    )
    assert np.allclose(even.pn[0], np.diag([2 + 3j, 2 - 3j]))


def test_a_call_is_told_arguments_where_a_command_is_told_options(capsys):
    fault = str(ibrid.examples()["fault.csv"])
    for call in (ibrid.read_events, ibrid.inspect):
        with pytest.raises(IbridError, match='add base="S_VA,V_LL"') as caught:
            call(fault)
        assert "--" not in str(caught.value)
    assert cli.main(["inspect", fault]) == 2
    assert "add --base S_VA,V_LL" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "argument"),
    [
        ("add --unit pu or --f0-hz 50.", 'add unit="pu" or f0_hz=50.'),
        ("add --op NAME:p=..,q=.., twice", 'add op="NAME:p=..,q=..", twice'),
        ('(--map "Ydd=a b[S]")', '(map="Ydd=a b[S]")'),
        ("leave out --ratio; --base is 3", "leave out ratio; base is 3"),
        ("see --from, --to 3", "see begin, end=3"),
        ("run ibrid evaluate --labels exact", "run ibrid evaluate --labels exact"),
    ],
)
def test_options_are_said_as_arguments_and_commands_stay(option, argument):
    assert in_python(option) == argument


def test_remarks_that_are_kept_with_data_name_arguments_in_python_and_options_at_the_prompt():
    said = "v taken as 1 (else --v); filter beside it (--port): see --power-node capacitor"
    assert where_it_is_said(said) == (
        'v taken as 1 (else v); filter beside it (network): see power_node="capacitor"'
    )
    token = AT_THE_PROMPT.set(True)
    try:
        assert where_it_is_said(said) == said
    finally:
        AT_THE_PROMPT.reset(token)


def test_notes_of_a_foreign_table_name_no_option_in_python(tmp_path):
    rows = [f"{f},0.1,0.2,-0.2,0.1,0.3,0.1,-0.1,0.3" for f in (10, 20, 40, 80, 160, 320)]
    names = "f,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im"
    (tmp_path / "scan.csv").write_text("\n".join([names, *rows]))
    keys = {"unit": "pu", "f0_hz": 50, "current": "out", "q_axis": "leads", "p": 0.5, "q": 0.1}
    notes = ibrid.read_sweep(tmp_path / "scan.csv", **keys).notes
    assert any("else power_node" in note for note in notes)
    assert not [note for note in notes if "--" in note]


@pytest.mark.parametrize("name", ["gfl_l_filter", "published_touti_19kva"])
def test_an_empty_folder_does_not_hide_what_ships_under_its_name(name, tmp_path, monkeypatch):
    shipped = ibrid.load(name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir()
    assert type(ibrid.load(name)) is type(shipped)
    read = ibrid.as_diagram if isinstance(shipped, ibrid.Diagram) else ibrid.as_sweep
    assert type(read(name)) is type(shipped)
    (tmp_path / "mine").mkdir()
    with pytest.raises(IbridError, match="found neither in it"):
        ibrid.load("mine")


def test_an_inspection_takes_what_reading_takes():
    fault = ibrid.examples()["fault.csv"]
    look = ibrid.inspect(fault, base="50kVA,690V", f0_hz=60.0)
    read = ibrid.inspect(ibrid.read_events(fault, base="50kVA,690V", f0_hz=60.0))
    assert look.to_json() == read.to_json()
    assert ibrid.inspect("paper_like", f0_hz=50.0).f0_hz == 50
    with pytest.raises(IbridError, match="f0_hz is no argument for what was read"):
        ibrid.inspect(benchmark(), f0_hz=50.0)


def test_sweeps_are_added_subtracted_and_multiplied_entry_by_entry():
    first = ibrid.add_noise(benchmark(), 40.0, rng=np.random.default_rng(1), repeats=3)
    second = ibrid.add_noise(benchmark(), 40.0, rng=np.random.default_rng(2), repeats=3)
    name = first.names[0]
    apart = first - second
    assert np.array_equal(apart.Y[name], first.Y[name] - second.Y[name])
    assert np.allclose(apart[name].sigma, np.hypot(first[name].sigma, second[name].sigma))
    assert np.allclose((apart + second).Y[name], first.Y[name])
    assert np.array_equal((2 * first).Y[name], (first * 2).Y[name])
    assert np.allclose((2 * first)[name].sigma, 2 * first[name].sigma)
    assert not (first - first).Y[name].any()
    with pytest.raises(IbridError, match="bring one to those of the other with resample"):
        _ = first - second["10-500Hz"]
    with pytest.raises(IbridError, match="the same operating points"):
        _ = first - second.only(name)
    with pytest.raises(TypeError):
        _ = first + 1


def test_a_sweep_is_resampled_between_its_frequencies_and_not_beyond():
    sweep = benchmark()
    name, own = sweep.names[0], sweep.points[0].frequency
    assert np.allclose(sweep.resample(own).Y[name], sweep.Y[name])
    between = sweep.resample([np.sqrt(own[3] * own[4])]).Y[name][0]  # halfway in log f
    assert np.allclose(between, (sweep.Y[name][3] + sweep.Y[name][4]) / 2)
    with pytest.raises(IbridError, match="nothing is extrapolated"):
        sweep.resample([1.0, 100.0])


def test_several_events_are_drawn_over_each_other_with_their_numbers():
    fault = ibrid.read_events(ibrid.examples()["fault.csv"], base="50kVA,690V", f0_hz=60.0)
    figure = ibrid.plot(fault, fault)
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert [label for label in labels if "v_d" in str(label)] == ["1: fault v_d", "2: fault v_d"]
    with pytest.raises(IbridError, match="or events in one"):
        ibrid.plot(fault, "paper_like")


def test_answers_that_were_saved_are_loaded_and_folders_give_their_record(tmp_path: Path):
    record = evaluated("gfl_exact")
    study = ibrid.stability(record, [2.0])
    study.save(tmp_path / "study.json")
    saved = ibrid.load(tmp_path / "study.json")
    assert isinstance(saved, dict)
    assert saved["sentences"] == list(study.sentences)
    with pytest.raises(IbridError, match=r"a folder with best\.json or model\.json"):
        ibrid.load(tmp_path)
    record.save(tmp_path / "best.json")
    loaded = ibrid.load(tmp_path)
    assert isinstance(loaded, ibrid.Record)
    assert loaded.to_json() == record.to_json()


def test_data_are_saved_as_text_and_no_ending_says_otherwise(tmp_path: Path):
    with pytest.raises(IbridError, match=r"must end with \.csv"):
        benchmark().save(tmp_path / "sweep.json")


def test_sums_of_sweeps_of_other_bases_or_rests_are_refused():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    based = replace(sweep, s_base_va=1e4, v_base_v=400.0)
    other = replace(sweep, s_base_va=2e4, v_base_v=400.0)
    with pytest.raises(SweepError, match="the same s_base_va"):
        _ = based + other
    point = sweep.points[0]
    moved = replace(point, op=replace(point.op, p=point.op.p / 2))
    with pytest.raises(SweepError, match="the same p, q, v"):
        _ = sweep - replace(sweep, points=(moved, *sweep.points[1:]))
    halves = sweep / 2 + sweep / 2 - sweep
    assert all(not np.any(one) for one in halves.Y.values())
    assert all(np.all(one == -sweep.Y[name]) for name, one in (-sweep).Y.items())


def test_a_sweep_is_resampled_to_its_own_ends_as_rounding_writes_them():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    first, last = sweep.points[0].frequency[[0, -1]]
    wanted = np.logspace(np.log10(first), np.log10(last) + 1e-15, 30)
    assert len(sweep.resample(wanted).points[0].frequency) == 30


def test_options_in_a_sentence_are_arguments_in_python_and_names_of_files_stay():
    said = "add --unit pu or --unit S --base S_VA,V_LL; --op p=1 --op p=2; --p P --q Q; --decimal ,"
    assert in_python(said) == (
        'add unit="pu" or unit="S", base="S_VA,V_LL"; op=["p=1", "p=2"]; p=P, q=Q; decimal=","'
    )
    stays = "scan--from.csv and run--op 3.csv; ibrid import F --unit pu"
    assert in_python(stays) == stays


def test_a_base_is_two_numbers_or_text():
    assert base_of((50e3, 400), "base") == base_of("50kVA,400V", "base") == (50e3, 400.0)
    with pytest.raises(SweepError, match="like 10kVA,400V"):
        base_of((50e3,), "base")


def test_sweeps_times_no_number_and_at_no_frequency_are_refused():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    for refused in (
        lambda: sweep * 10**400,
        lambda: sweep * float("nan"),
        lambda: sweep * 1e308 * 10,
        lambda: sweep * 1e-320,
        lambda: sweep / 0,
        lambda: sweep / np.float64(0),
        lambda: sweep.resample([]),
        lambda: ibrid.inspect(0 * sweep),
    ):
        with pytest.raises(SweepError, match="must"):
            refused()


@pytest.mark.parametrize("number", ["9" * 6000, "1e999", "NaN"])
def test_an_answer_with_a_number_beyond_all_floats_is_not_loaded(tmp_path: Path, number: str):
    answer = tmp_path / "answer.json"
    answer.write_text(f'{{"schema": "ibrid.drift/1", "nrmse": [{number}]}}', encoding="utf-8")
    with pytest.raises(IbridError, match="must hold finite numbers"):
        ibrid.load(answer)
