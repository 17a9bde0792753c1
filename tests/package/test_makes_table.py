"""The table of makes that are read names tests that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_every_make_that_is_read_names_a_test_that_exists():
    page = (ROOT / "docs" / "own_data.md").read_text(encoding="utf-8")
    _, _, behind = page.partition("| make | test that holds it |\n")
    rows = behind.partition("\n\n")[0].splitlines()[1:]
    written = "".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "tests" / "measurement").glob("*.py")
    )
    wrong = []
    for row in rows:
        names = re.findall(r"`(test_\w+)`", row)
        wrong += [row] if not names else []
        wrong += [name for name in names if f"def {name}(" not in written]
    assert len(rows) > 15
    assert wrong == []
