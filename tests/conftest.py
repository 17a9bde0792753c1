"""Tiers: which tests run follows from what they cost, as recorded in durations.json, and from the folder they are in.

    pytest --tier quick|test|all       all is the default; make quick, make test and make test-all pass the others
    pytest --record ...                writes what these tests cost into durations.json (make durations, for all of them)

Costs are processor seconds, with a part of the fixtures and results that tests of a file share, so that other work on the
machine hardly changes them and the sum of a tier says what it takes.
A test without a record counts as short.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from sharing import borrowed, changed_results, processor_seconds

HERE = Path(__file__).parent
RECORD = HERE / "durations.json"
#: Seconds that a test may cost, all its cases together, in each tier.
MOST = {"quick": 0.3, "test": 5.0, "all": float("inf")}
#: What is checked before a change of fit, gap, search or parts is done, and not at every merge.
ALL_ALONE = ("benchmarks", "blind", "learning")
#: Cases from here on have a record of their own; below it is left out.
LONG_CASE, SHORT = 5.0, 0.05
#: So many times what a tier lets a test cost is said, since machines differ.
FAR = 5.0

#: Examples that hypothesis draws are the same in every run; `--hypothesis-profile random` draws others each time (nightly).
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("random", deadline=None, print_blob=True)
settings.load_profile("repeatable")

COSTS: dict[str, float] = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("tiers")
    group.addoption("--tier", choices=tuple(MOST), default="all", help="which tests run, by what they cost")
    group.addoption(
        "--reversed", action="store_true", help="the last test first: none may need what another left behind"
    )
    group.addoption("--record", action="store_true", help="write what the tests cost into tests/durations.json")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Not even read, since reading costs time too."""
    return (
        True
        if config.option.tier != "all" and collection_path.parent == HERE and collection_path.name in ALL_ALONE
        else None
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In one process the order stays as it is; where several share the tests, the longest files begin."""
    kept = [item for item in items if cost(item) <= MOST[config.option.tier]]
    if len(kept) < len(items):
        config.hook.pytest_deselected(items=[item for item in items if cost(item) > MOST[config.option.tier]])
    if hasattr(config, "workerinput"):
        of_file: dict[Path, float] = defaultdict(float)
        for key in dict.fromkeys(map(recorded_as, kept)):  # each process sums in the same order
            of_file[HERE.parent / key.split("::")[0]] += COSTS.get(key, 0.0)
        kept.sort(key=lambda item: -of_file[item.path])
    if config.option.reversed:
        kept.reverse()
    items[:] = kept


def recorded_as(item: pytest.Item) -> str:
    """The key of a test in durations.json: its own where its case is long, else that of all its cases together."""
    return item.nodeid if item.nodeid in COSTS else item.nodeid.split("[")[0]


def cost(item: pytest.Item) -> float:
    return COSTS.get(recorded_as(item), 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# what tests cost

_fixtures: dict[Any, float] = {}
_began = 0.0


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
    began = processor_seconds()
    try:
        return (yield)
    finally:
        if fixturedef.scope != "function":
            _fixtures[fixturedef] = processor_seconds() - began


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """What was made before, and is used here, is charged here too."""
    global _began
    fixtures = getattr(item, "_fixtureinfo", None)
    used = [made for several in (fixtures.name2fixturedefs if fixtures else {}).values() for made in several]
    borrowed.clear()
    borrowed.update({fixture: _fixtures[fixture] for fixture in used if fixture in _fixtures})
    _began = processor_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None, Any, Any]:
    """What tests share stays as it was made, so that none depends on the order in which they run."""
    try:
        return (yield)
    finally:
        changed = changed_results()
        assert not changed, f"the test changed what others share: {', '.join(changed)}; change a copy of it"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    global _began
    report = yield
    now = processor_seconds()
    report.own = now - _began  # type: ignore[attr-defined]
    report.borrowed = sum(borrowed.values()) if report.when == "teardown" else 0.0  # type: ignore[attr-defined]
    _began = now
    return report


class Costs:
    """In the process that hears every report: what each test took, kept when all have ended, and said where it is too much."""

    def __init__(self) -> None:
        self.own: dict[str, float] = defaultdict(float)
        self.borrowed: dict[str, float] = defaultdict(float)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.own[report.nodeid] += getattr(report, "own", 0.0)
        self.borrowed[report.nodeid] += getattr(report, "borrowed", 0.0)

    def whole(self) -> dict[str, float]:
        """Key -> seconds; what tests of a file share counts once, each of them bears its part."""
        users = Counter((case.split("::")[0], round(seconds, 2)) for case, seconds in self.borrowed.items())
        whole: dict[str, float] = defaultdict(float)
        for case, own in self.own.items():
            shared = self.borrowed[case]
            seconds = own + shared / users[case.split("::")[0], round(shared, 2)]
            whole[case if seconds >= LONG_CASE else case.split("[")[0]] += seconds
        return whole

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if not session.config.option.record:
            return
        tests = {case.split("[")[0] for case in self.own}
        old = {key: seconds for key, seconds in COSTS.items() if key.split("[")[0] not in tests}
        whole = {key: round(seconds, 2) for key, seconds in (old | self.whole()).items() if seconds >= SHORT}
        there = {key: seconds for key, seconds in whole.items() if (HERE.parent / key.split("::")[0]).exists()}
        RECORD.write_text(json.dumps(dict(sorted(there.items())), indent=1) + "\n", encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: Any, config: pytest.Config) -> None:
        """A test without a record runs in every tier: it is named where it costs far more than the tier lets it."""
        over = {key: seconds for key, seconds in self.whole().items() if seconds > FAR * MOST[config.option.tier]}
        if over:
            terminalreporter.section(f"too long for make {config.option.tier}: make durations ARGS=FILE writes it down")
            for key, seconds in sorted(over.items(), key=lambda each: -each[1]):
                terminalreporter.write_line(f"{seconds:6.1f} s  {key}")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Costs(), "costs")
