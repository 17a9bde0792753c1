"""Many cases in one test: each is checked, all that fail are told together.

`each_of` stands where pytest.mark.parametrize would, for cases that are many and quick: thousands
of items cost every process seconds to collect. Fixtures of the test are made once, for all cases.
"""

import inspect
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any

import pytest

SHOWN = 20  # failures in the message; the number of all is said


class Failures:
    """What failed, case by case."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.first: BaseException | None = None
        self.cases = self.skipped = 0

    @contextmanager
    def case(self, name: object) -> Iterator[None]:
        """One case; its failure is kept, and the next may begin."""
        self.cases += 1
        try:
            yield
        except pytest.skip.Exception:
            self.skipped += 1
        except (Exception, pytest.fail.Exception) as error:
            self.first = self.first or error
            place = traceback.extract_tb(error.__traceback__)[-1]
            self.told.append(
                f"{name}: {type(error).__name__} in line {place.lineno} of {place.name}: {error}"
            )


@contextmanager
def collecting() -> Iterator[Failures]:
    """`with collecting() as failures: for ...: with failures.case(name): assert ...`; raises one
    AssertionError at the end.
    """
    failures = Failures()
    yield failures
    if failures.told:
        told = "\n".join(failures.told[:SHOWN])
        raise AssertionError(
            f"{len(failures.told)} of {failures.cases} cases fail\n{told}"
        ) from failures.first
    if failures.cases and failures.skipped == failures.cases:
        pytest.skip("every case is skipped")


def each_of(
    names: str | Sequence[str],
    cases: Iterable[Any],
    ids: Callable[[Any], object] | Iterable[object] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """As pytest.mark.parametrize, in a single item; several may stand above one another."""
    of_case = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    rows = [_row(case, len(of_case)) for case in cases]
    if ids is not None and not callable(ids):
        rows = [(row, str(name)) for (row, _), name in zip(rows, ids, strict=True)]
    words = ids if callable(ids) else str

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        signature = inspect.signature(test)

        @wraps(test)
        def looped(*args: Any, **fixtures: Any) -> None:
            with collecting() as failures:
                for row, name in rows:
                    with failures.case(
                        name or ", ".join(str(words(value) or value)[:80] for value in row)
                    ):
                        test(*args, **fixtures, **dict(zip(of_case, row, strict=True)))

        rest = [
            parameter
            for parameter in signature.parameters.values()
            if parameter.name not in of_case
        ]
        looped.__signature__ = signature.replace(parameters=rest)  # type: ignore[attr-defined]
        return looped

    return decorate


def _row(case: Any, width: int) -> tuple[tuple[Any, ...], str | None]:
    """(values, name) of a plain case, or of a pytest.param."""
    if isinstance(case, type(pytest.param())):
        assert not case.marks, "a case with a mark of its own needs pytest.mark.parametrize"
        return tuple(case.values), None if case.id is None else str(case.id)
    return (tuple(case) if width > 1 else (case,)), None
