"""Which files come first where several processes share the tests: the long ones, so that all processes end together."""

from pathlib import Path

import pytest

#: Longest first; minutes each. All other files are shorter and keep their order.
LONG = ("test_gap_blind", "test_small_model", "test_notebooks")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In one process the order stays as it is: what is quick and basic fails first."""
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: _place(item.path))


def _place(path: Path) -> int:
    return LONG.index(path.stem) if path.stem in LONG else len(LONG)
