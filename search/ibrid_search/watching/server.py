"""The server of the live page about runs.

It is on the loopback address alone, for hosts named so alone. It writes nothing into a run but the
request to stop, and that only for the page that it served itself.
"""

import hmac
import json
import os
import re
import secrets
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
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.pages.template import page
from ibrid.streams import complain
from ibrid.writing import plain
from ibrid_search.run.stop_request import request_stop
from ibrid_search.watching.run_state import (
    run_names,
    run_state,
    run_summary,
    step_page,
)
from ibrid_search.watching.trials import Trials

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
#: Scripts of the page, each a file of that name.
SCRIPTS = ("/watch.js", "/watch_table.js")
_FRAMED = "frame-ancestors 'self'"  # pages of candidates bring a policy of their own


class WatchServer(ThreadingHTTPServer):
    """Serves one run, or several that are compared.

    folders : of the runs, the one to show first in front. port : 0 for any free one. kinds : their
    vocabulary, where it is not a shipped one.
    """

    daemon_threads = True

    def __init__(
        self,
        folders: Path | Sequence[Path],
        port: int = 0,
        kinds: Sequence[ModuleKind] = VOCABULARY,
    ) -> None:
        self.folders = (folders,) if isinstance(folders, Path) else tuple(folders)
        for folder in self.folders:
            run_state(folder)  # refuses what is no run before anything is served
        self.names = run_names(self.folders)
        self.kinds = tuple(kinds)
        self.trials = tuple(Trials(folder, self.kinds) for folder in self.folders)
        #: Known to the page alone; without it nothing is changed.
        self.token = secrets.token_urlsafe(32)
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
    folders: Path | Sequence[Path],
    port: int = 0,
    kinds: Sequence[ModuleKind] = VOCABULARY,
    tell: Callable[[str], None] = print,
) -> None:
    """Serve a run, or several, until Ctrl-C. tell : is given the address.

    Raises IbridError where there is no run or the port is taken.
    """
    server = WatchServer(folders, port, kinds)
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
        self._answer(self._posted)

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

    @property
    def _run(self) -> int:
        """Which of the runs is asked about, the first where the address does not say it."""
        asked = parse_qs(_split(self.path).query).get("run", ["0"])[-1]
        if not re.fullmatch(r"[0-9]{1,4}", asked) or int(asked) >= len(self.server.folders):
            raise _Refused(404, "there is no such run here")
        return int(asked)

    def _page(self) -> None:
        path = _split(self.path).path
        folders = self.server.folders
        if path == "/":
            facts = {"token": self.server.token, "several": len(folders) > 1}
            self._send(page("watch.html", facts, "ibrid_search"), "text/html", policy=_POLICY)
        elif path in SCRIPTS:
            self._send(
                (files("ibrid_search") / "templates" / path[1:]).read_text(encoding="utf-8"),
                "text/javascript",
            )
        elif path == "/state":
            named = {"name": self.server.names[self._run]}
            self._send_json(run_state(folders[self._run]) | named)
        elif path == "/runs":
            self._send_json(
                [
                    run_summary(folder) | {"name": name}
                    for folder, name in zip(folders, self.server.names, strict=True)
                ]
            )
        elif path == "/trials":
            self._send_json(self.server.trials[self._run].table())
        elif match := re.fullmatch(r"/step/(\d{1,9})", path):
            self._send(
                step_page(folders[self._run], int(match[1]), self.server.kinds),
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

    def _posted(self) -> None:
        path = _split(self.path).path
        if path == "/start":
            self._dropped()
        elif path == "/stop":
            self._require_own_page()
            try:
                request_stop(self.server.folders[self._run])
            except IbridError as error:
                raise _Refused(409, str(error)) from None
            self._send_json({"sentence": "The search ends after what is under way."})
        else:
            raise _Refused(404, "there is nothing here")

    def _require_own_page(self) -> None:
        """Only what the page that this server sent asks for: its origin and its token."""
        given = self.headers.get("X-Ibrid-Token", "").encode("latin-1", "replace")
        if self.headers.get("Origin") is None or not hmac.compare_digest(
            given, self.server.token.encode()
        ):
            raise _Refused(403, "only the page that was opened here may ask that; load it again")

    def _dropped(self) -> None:
        """A file of the user's: what `ibrid start` says about it."""
        asked = _split(self.path)
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


def _split(address: str) -> SplitResult:
    try:
        return urlsplit(address)
    except ValueError:
        raise _Refused(400, "this is no address") from None
