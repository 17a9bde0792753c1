"""What holds for every test: examples that are the same in every run, and shared results that
nobody changes.

Two markers say what a test costs, all its cases together: `slow` beyond 0.3 s of a processor, left
out by `make quick`; `nightly` beyond 5 s, left out by `make test`, too.
"""

from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import settings
from sharing import asked_for, changed_results

#: Examples that hypothesis draws are the same in every run; `--hypothesis-profile random` draws
#: others each time (nightly).
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("random", deadline=None, print_blob=True)
settings.load_profile("repeatable")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--reversed",
        action="store_true",
        help="the last test first: none may need what another left behind",
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.option.reversed:
        items.reverse()


def pytest_runtest_setup() -> None:
    asked_for.clear()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None, Any, Any]:
    """What tests share stays as it was made, so that none depends on the order in which they
    run.
    """
    try:
        return (yield)
    finally:
        changed = changed_results()
        assert not changed, (
            f"the test changed what others share: {', '.join(changed)}; change a copy of it"
        )
