"""run.toml: what it says is read back alike, and a run goes on with its own options only."""

import math
import tomllib
from types import MappingProxyType

import pytest
from collecting import each_of
from hypothesis import given
from hypothesis import strategies as st
from ibrid_search.run.run_folder import FREE, open_run, read_run_toml, require_same, run_toml
from ibrid_search.settings import SearchSettings

from ibrid.errors import IbridError
from ibrid.own_files import writing_as

OPTIONS = {
    "seed": 3,
    "budget": 500,
    "target": None,
    "proposer": "rules:0.7,random:0.3",
    "models": ["a@http://127.0.0.1:1/v1", "folder with spaces"],
    "holdout_op": [],
    "require": "",
    "workers": 2,
    "ray": "",
    "data": "data/paper_like.csv",
    "data_sha256": "00ff",
    "settings": vars(SearchSettings(islands=10)),
    "server": {"timeout": 60.0},
}


def read(options) -> dict:
    return read_run_toml(run_toml(options), "run.toml")


def refused(**changes) -> str:
    with pytest.raises(IbridError) as caught:
        require_same(read(OPTIONS), {**OPTIONS, **changes}, "run.toml")
    return str(caught.value)


def test_options_are_read_as_they_were_written():
    found = read(OPTIONS)
    for name in ("seed", "budget", "proposer", "models", "holdout_op", "require", "data"):
        assert found[name] == OPTIONS[name]
    assert "target" not in found  # TOML has no word for nothing


def test_every_setting_and_version_is_there():
    found = read(OPTIONS)
    assert found["settings"]["scales"] == dict(SearchSettings().scales)
    stated = {
        name for name, value in vars(SearchSettings()).items() if value is not None
    }  # TOML has no None
    assert set(found["settings"]) == stated
    assert {"python", "ibrid", "casadi", "numpy"} <= set(found["versions"])


texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
plain = st.one_of(
    texts, st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False)
)


@pytest.mark.slow
@given(texts, plain, st.lists(plain, max_size=3), st.dictionaries(st.sampled_from("abc"), plain))
def test_any_value_is_read_as_it_was_written(word, value, some, table):
    found = read(
        {"word": word, "value": value, "some": some, "table": table, "inner": {"nested": table}}
    )
    assert (found["word"], found["value"], found["some"], found["table"]) == (
        word,
        value,
        some,
        table,
    )
    assert found["inner"]["nested"] == table


def test_infinity_and_nan_are_read_as_such():
    found = read({"a": math.inf, "b": -math.inf, "c": math.nan})
    assert (found["a"], found["b"]) == (math.inf, -math.inf)
    assert math.isnan(found["c"])


@each_of(
    "name",
    ["line\nbreak", 'quote"', "back\\slash", "\x00\x1b[31m", "\U000e0001", "\u2028", "é", "😀"],
)
def test_strange_characters_survive(name):
    assert read({"data": name})["data"] == name


def test_a_file_name_that_is_no_text_does_not_spoil_the_file():
    name = b"sweep\xff.csv".decode("utf-8", "surrogateescape")
    assert read({"data": name})["data"] == "sweep?.csv"
    require_same(read({"data": name}), {"data": name}, "run.toml")


def test_a_damaged_file_is_a_sentence():
    with pytest.raises(IbridError, match=r"run\.toml: must be TOML"):
        read_run_toml("seed = = 3", "run.toml")


def test_the_same_options_are_the_same():
    require_same(read(OPTIONS), OPTIONS, "run.toml")
    require_same(
        read(OPTIONS), {**OPTIONS, "settings": MappingProxyType(OPTIONS["settings"])}, "run.toml"
    )


def changed(name: str, value) -> dict:
    """The options with another value; "table.name" is one of a table."""
    table, _, inner = name.partition(".")
    return {**OPTIONS, table: {**OPTIONS[table], inner: value} if inner else value}


@pytest.mark.parametrize("name", FREE)
def test_what_does_not_shape_the_search_may_change(name):
    require_same(read(OPTIONS), changed(name, 7), "run.toml")


def test_a_target_may_come_or_go():
    require_same(read(OPTIONS), {**OPTIONS, "target": 0.1}, "run.toml")
    require_same(read({**OPTIONS, "target": 0.1}), OPTIONS, "run.toml")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"seed": 4}, "seed = 3, now it is 4"),
        ({"proposer": "random:1"}, "proposer = rules:0.7,random:0.3, now it is random:1"),
        ({"settings": {**OPTIONS["settings"], "islands": 5}}, "settings.islands = 10, now it is 5"),
        ({"data_sha256": "11"}, "data of other content"),
        (
            {"data": "other.csv", "data_sha256": "11"},
            "data = data/paper_like.csv, now it is other.csv",
        ),
        ({"new": 1}, "new = nothing, now it is 1"),
    ],
)
def test_what_shapes_the_search_may_not_change(change, told):
    message = refused(**change)
    assert told in message
    assert "\n" not in message
    assert len(message) < 400


def test_the_same_data_may_lie_elsewhere():
    require_same(read(OPTIONS), {**OPTIONS, "data": "/mnt/moved.csv"}, "run.toml")


def test_versions_may_change():
    before = read(OPTIONS)
    before["versions"]["numpy"] = "0.1"
    require_same(before, OPTIONS, "run.toml")


def test_the_file_is_toml_for_anyone():
    assert tomllib.loads(run_toml(OPTIONS))["versions"]


@each_of("text", ["seed = ", "seed = 4\n"])
def test_a_folder_whose_run_file_is_broken_or_of_another_run_stays_as_it_is(tmp_path, text):
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    with (
        writing_as("mcp"),
        pytest.raises(IbridError, match=r"run\.toml"),
        open_run(tmp_path, OPTIONS, {}, resume=True),
    ):
        pass
    assert [one.name for one in tmp_path.iterdir()] == ["run.toml"]
