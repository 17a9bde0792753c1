"""The live page of a run: how far it is, every candidate with its parent, one candidate in full.

Its server is on the loopback address alone, for hosts named so alone; it writes nothing into the
run.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, parse_qs, urlsplit

from ibrid.errors import IbridError
from ibrid.foreign_text import show_controls_within
from ibrid.interrupts import forget_interrupt
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.playback_page import facts_of_record
from ibrid.report.pages.template import page
from ibrid.streams import complain
from ibrid.structure.comparison.compare import difference
from ibrid.writing import inside, plain
from ibrid_search.report.run_data import measured, settings_of, whole_number
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.run.trajectory import trajectory
from ibrid_search.step import line

ADDRESS = "127.0.0.1"
#: Names that a browser may call this machine; anything else was led here by somebody's DNS.
HOSTS = ("127.0.0.1", "localhost", "[::1]")
#: Letters of the name of a dropped file that are kept, the last ones (a file system takes 255
#: bytes), and its bytes.
LONGEST_NAME = 60
LARGEST = 50_000_000
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; img-src data:; connect-src "
    "'self'; frame-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_FRAMED = "frame-ancestors 'self'"  # pages of candidates bring a policy of their own


class WatchServer(ThreadingHTTPServer):
    """Serves one run.

    folder : of the run. port : 0 for any free one. kinds : its vocabulary, where it is not a
    shipped one.
    """

    daemon_threads = True

    def __init__(
        self, folder: Path, port: int = 0, kinds: Sequence[ModuleKind] = VOCABULARY
    ) -> None:
        run_state(folder)  # refuses what is no run before anything is served
        self.folder, self.kinds = folder, tuple(kinds)
        self.dropped = tempfile.TemporaryDirectory(prefix="ibrid-watch-")
        self.looking = threading.Lock()
        self.looked = 0
        self.look: subprocess.Popen[str] | None = None  # the one under way
        try:
            super().__init__((ADDRESS, port), _Answers)
        except OSError as error:
            self.dropped.cleanup()
            raise IbridError(
                f"port {port} cannot be served ({error.strerror}); give another with --port"
            ) from None

    @property
    def url(self) -> str:
        """Where it is."""
        return f"http://{ADDRESS}:{self.server_address[1]}/"

    def handle_error(self, request: object, client_address: object) -> None:
        """Say in a sentence what broke off; a browser that leaves is no error."""
        error = sys.exception()
        if not isinstance(error, ConnectionError):
            complain(
                f"an answer broke off with {type(error).__name__}: {error}; load the page again"
            )

    def server_close(self) -> None:
        """Stop, and drop what was dropped."""
        super().server_close()
        if self.look is not None:
            self.look.kill()
            self.look.wait()
        self.dropped.cleanup()


def watch(
    folder: Path,
    port: int = 0,
    kinds: Sequence[ModuleKind] = VOCABULARY,
    tell: Callable[[str], None] = print,
) -> None:
    """Serve a run until Ctrl-C. tell : is given the address.

    Raises IbridError where there is no run or the port is taken.
    """
    server = WatchServer(folder, port, kinds)
    try:
        tell(server.url)
        server.serve_forever(poll_interval=0.2)
    except KeyboardInterrupt:
        forget_interrupt()
    finally:
        server.server_close()


class _Refused(Exception):
    """An answer that is no page: status and sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class _Answers(BaseHTTPRequestHandler):
    server: WatchServer
    server_version, sys_version = "ibrid", ""
    timeout = 60

    def do_GET(self) -> None:
        self._answer(self._page)

    def do_POST(self) -> None:
        self._answer(self._dropped)

    def _answer(self, give: Callable[[], None]) -> None:
        try:
            self._require_this_machine()
            give()
        except _Refused as refused:
            self._send_json({"error": str(refused)}, refused.status)
        except IbridError as error:
            self._send_json({"error": str(error)}, 404)

    def _require_this_machine(self) -> None:
        """Only what a browser on this machine sends: a host of the loopback, and no page of another
        origin.
        """
        host = self.headers.get("Host", "")
        if re.sub(r":\d+$", "", host).lower() not in HOSTS:
            raise _Refused(
                403, "this page is served to this machine alone, as 127.0.0.1 or localhost"
            )
        origin = self.headers.get("Origin")
        if origin is not None and _split(origin).netloc != host:
            raise _Refused(403, "another page may not ask")

    def _page(self) -> None:
        path = _split(self.path).path
        if path == "/":
            self._send(page("watch.html", {}, "ibrid_search"), "text/html", policy=_POLICY)
        elif path == "/watch.js":
            self._send(
                (files("ibrid_search") / "templates" / "watch.js").read_text(encoding="utf-8"),
                "text/javascript",
            )
        elif path == "/state":
            self._send_json(run_state(self.server.folder))
        elif match := re.fullmatch(r"/step/(\d{1,9})", path):
            self._send(
                step_page(self.server.folder, int(match[1]), self.server.kinds),
                "text/html",
                policy=_FRAMED,
            )
        elif match := re.fullmatch(r"/started/(\d{1,9})", path):
            report = Path(self.server.dropped.name) / match[1] / ".start" / "report.html"
            if not report.is_file():
                raise _Refused(404, "there is no such first answer")
            self._send(report.read_text(encoding="utf-8"), "text/html", policy=_FRAMED)
        else:
            raise _Refused(404, "there is nothing here")

    def _dropped(self) -> None:
        """A file of the user's: what `ibrid start` says about it."""
        asked = _split(self.path)
        if asked.path != "/start":
            raise _Refused(404, "there is nothing here")
        length = self.headers.get("Content-Length", "")
        if not re.fullmatch(r"[0-9]{1,12}", length) or not 0 < int(length) <= LARGEST:
            raise _Refused(413, f"a file of at most {LARGEST // 1_000_000} MB can be looked at")
        name = Path(parse_qs(asked.query).get("name", ["sweep.csv"])[0]).name
        content = self.rfile.read(int(length))
        if len(content) < int(length):
            raise _Refused(400, "the file ended before all of it was here; send it again")
        if not self.server.looking.acquire(blocking=False):
            raise _Refused(409, "one file is looked at at a time; wait for the other one")
        try:
            self._send_json(
                self._first_answer(re.sub(r"[^\w.-]", "_", name)[-LONGEST_NAME:], content)
            )
        finally:
            self.server.looking.release()

    def _first_answer(self, name: str, content: bytes) -> dict[str, Any]:
        self.server.looked += 1
        folder = Path(self.server.dropped.name) / str(self.server.looked)
        folder.mkdir()
        file = folder / (name.lstrip(".-") or "sweep.csv")
        file.write_bytes(content)
        command = [sys.executable, "-P", "-m", "ibrid", "start", file.name, "--out", ".start"]
        # a dropped json.py is no module: neither -m nor an empty entry of PYTHONPATH may find one
        # in the folder
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(os.path.abspath, filter(None, sys.path))),
        }
        pipe = subprocess.PIPE
        with subprocess.Popen(
            command, cwd=folder, env=environment, text=True, stdout=pipe, stderr=pipe
        ) as self.server.look:
            answer, complaint = self.server.look.communicate()
        if self.server.look.returncode != 0:
            said = complaint.strip().splitlines()
            raise _Refused(422, said[-1] if said else "the file cannot be read")
        return {"sentence": answer.splitlines()[0], "page": f"/started/{self.server.looked}"}

    def _send_json(self, content: Any, status: int = 200) -> None:
        self._send(
            json.dumps(show_controls_within(plain(content)), allow_nan=False, default=str),
            "application/json",
            status,
        )

    def _send(
        self, text: str, kind: str, status: int = 200, policy: str = "default-src 'none'"
    ) -> None:
        content = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Silent: the terminal belongs to the user."""


#: Candidates that a page draws; of more, the best and their ancestors.
DRAWN = 400


def _split(address: str) -> SplitResult:
    try:
        return urlsplit(address)
    except ValueError:
        raise _Refused(400, "this is no address") from None


def run_state(folder: Path) -> dict[str, Any]:
    """How a run stands: `name`, `ending` ("" while it runs), `budget`, `best` (a step or None),
    `points` (evaluation, NRMSE, best NRMSE) and `nodes`, the evaluated candidates with their
    parents.

    Raises IbridError where there is no run.
    """
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        meta = dict(store.meta)
        steps = {step.number: step for step in store.steps()}
    points = trajectory(steps.values())
    known = {one.number for one in steps.values() if one.nrmse is not None}
    ranked = sorted(known, key=lambda number: steps[number].nrmse or 0.0)[:DRAWN]
    shown = dict.fromkeys(ranked)
    for number in ranked:
        shown |= {one.number: None for one in line(steps, number) if one.number in known}
    best = whole_number(meta.get("best", ""))
    leading = next((number for number in ranked if steps[number].stable), None)
    return {
        "name": folder.resolve().name,
        "started": meta.get("started", ""),
        "ending": meta.get("ending", ""),
        "budget": settings_of(meta.get("settings", "")).get("budget"),
        "proposals": len(steps),
        "best": best if best in known else leading,
        "points": [[one.evaluation, one.nrmse, one.best, one.step] for one in points],
        "nodes": [
            {
                "step": number,
                "parent": steps[number].edited if steps[number].edited in known else None,
                "nrmse": steps[number].nrmse,
                "stable": steps[number].stable,
                "note": steps[number].note[:200],
                "proposer": steps[number].proposer,
            }
            for number in sorted(shown)
        ],
    }


def step_page(folder: Path, number: int, kinds: Sequence[ModuleKind] = VOCABULARY) -> str:
    """A candidate as the page of a record, after what differs from its parent.

    Raises IbridError where there is no such step, or no fit of it.
    """
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        step = store.step(number)
        record = store.record(number, kinds)
        sweep, _ = measured(store.meta.get("data", ""), read_sweep)
        events, _ = measured(store.meta.get("events", ""), read_events)
        try:
            parent = None if step.edited is None else store.step(step.edited)
        except IbridError:
            parent = None
    changed = () if parent is None else difference(parent.program, step.program)
    facts = record_facts(record, sweep, "bode", title=f"Step {number}")
    facts |= {"events": facts_of_record(record, events), "step": step, "changed": changed}
    return page("watched.html", facts, "ibrid_search")
