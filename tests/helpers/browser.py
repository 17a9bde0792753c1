"""Opens pages in headless Chromium, in frames as narrow as a telephone, and asks what became of
them.
"""

import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from html import escape, unescape
from pathlib import Path

import pytest

NARROW = 390
_NAMES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--window-size=1200,900",
)
_PAGE = """<!DOCTYPE html><meta charset="utf-8"><title>frames</title><pre id="answers"></pre>
<script>
const answers = {};
function ask(name, frame) {
  const document = frame.contentDocument, window = frame.contentWindow;
  answers[name] = (() => { %s })();
  window.top.document.getElementById("answers").textContent = JSON.stringify(answers);
}
</script>
"""


def asked(pages: Sequence[str], question: str, folder: Path) -> tuple[list, list[str]]:
    """Answers to a question, JavaScript that returns something, in each page; and what stood on the
    console.

    The question sees `document` and `window` of a page. Skips where no Chromium is installed.
    """
    browser = next(filter(None, map(shutil.which, _NAMES)), None)
    if browser is None:
        pytest.skip(
            "chromium is not installed, so no page is opened in it; apt-get install chromium"
        )
    frames = "".join(
        f'<iframe width="{NARROW}" height="800" onload="ask({number}, this)" '
        f'srcdoc="{escape(page)}"></iframe>'
        for number, page in enumerate(pages)
    )
    source = folder / "frames.html"
    source.write_text(_PAGE % question + frames, encoding="utf-8")
    command = [
        browser,
        *_OPTIONS,
        f"--user-data-dir={folder / 'profile'}",
        "--dump-dom",
        source.as_uri(),
    ]
    run = subprocess.run(command, check=True, timeout=600, capture_output=True, text=True)
    found = re.search(r'<pre id="answers">(.*?)</pre>', run.stdout, re.DOTALL)
    assert found is not None
    answers = json.loads(unescape(found[1]))
    return [answers[str(number)] for number in range(len(pages))], re.findall(
        r"CONSOLE.*", run.stderr
    )
