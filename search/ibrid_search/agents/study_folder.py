"""The commands of ibrid as a tool over the files of one folder: a study from file to report.

A command runs in a process of its own, in the folder, and reads and writes nothing outside of it
(`ibrid.own_files`). What runs code of others is refused, unless the user allowed it when the server
was started. An answer comes after some seconds; asked again in the same words, it goes on.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ibrid.devices.isolation.descendants import end_with_descendants
from ibrid.errors import IbridError, near
from ibrid.own_files import ONLY_BELOW
from ibrid.writing import PlainData
from ibrid_search.agents.tool import Steps, Tool, tools_in

#: Commands of a study; searches and servers are the other tools' affair.
COMMANDS = (
    "inspect",
    "import",
    "compare",
    "check",
    "evaluate",
    "start",
    "gap",
    "playback",
    "record",
    "sweep",
    "predict",
    "nfp",
    "stability",
    "next",
    "drift",
    "generic",
    "export",
    "report",
)
#: Those that run model files of others.
DEVICES = ("measure", "open")
#: Options that execute Python files; and commands with options that ask a language model, at a
#: server that the agent would choose and with the user's key.
EXECUTING = ("--kinds",)
ASKING = {"gap": ("--suggest", "--model")}
#: What runs a command, behind Python's own options.
_RUN = "from ibrid_search.agents.study_command import run; run()"
#: Characters of output that an answer has, its end; and those of a file that is shown.
SHOWN, LONGEST_FILE = 3_000, 20_000
#: Files of the folder that are listed.
LISTED = 60


@dataclass
class _Running:
    """A command that was begun: its words, its process, and where its output goes."""

    words: tuple[str, ...]
    process: "subprocess.Popen[bytes]"
    scratch: "TemporaryDirectory[str]"

    def output(self, name: str) -> str:
        with (Path(self.scratch.name) / name).open("rb") as stream:
            stream.seek(max(0, stream.seek(0, os.SEEK_END) - 4 * SHOWN))
            text = stream.read(4 * SHOWN).decode("utf-8", "replace")
        return text[-SHOWN:]

    def end(self) -> None:
        if self.process.poll() is None:
            end_with_descendants(self.process.pid)
        self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.scratch.cleanup()


class StudyFolder:
    """The tools run_ibrid, list_files and save_step over a folder; use it in a `with`.

    allow_devices : whether `measure` and `open` may run model files. answer_within : seconds after
    which an answer comes; None for whole answers.
    """

    def __init__(
        self,
        folder: Path,
        steps: Steps,
        *,
        allow_devices: bool = False,
        answer_within: float | None = None,
    ) -> None:
        if not folder.is_dir():
            raise IbridError(f"--folder {folder}: must be a folder that is there; make it")
        self.folder = folder.resolve()
        self._steps = steps
        self._commands = (*COMMANDS, *(DEVICES if allow_devices else ()))
        self._answer_within = answer_within
        self._running: _Running | None = None

    def __enter__(self) -> "StudyFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    @property
    def tools(self) -> tuple[Tool, ...]:
        """What an agent is shown."""
        return tools_in("study_folder.toml", self, commands=list(self._commands))

    def run_ibrid(self, words: list[str], stop: bool = False) -> PlainData:
        """Run a command, or go on with it; what it printed, and the files that it wrote."""
        asked = tuple(words)
        if stop:
            self._stop()
            return {"stopped": True, "next": "run_ibrid with another command"}
        running = self._running
        if running is not None and running.words != asked:
            if running.process.poll() is None:
                raise IbridError(
                    f"{' '.join(running.words)[:200]} is still running; ask for it again in the "
                    "same words, or with stop=true"
                )
            self._stop()  # it ended, and its answer is not asked for any more
        if self._running is None:
            self._require_allowed(asked)
            self._running = self._begun(asked)
        return self._answer(self._running)

    def list_files(self, file: str | None = None) -> PlainData:
        """Names and sizes of the files below the folder; or the beginning of one."""
        if file is not None:
            path = self._inside(file)
            if not path.is_file():
                raise IbridError(f"there is no file {file[:100]!r}; list_files tells all")
            with path.open("rb") as stream:
                content = stream.read(LONGEST_FILE)
            return {"file": file, "begins": content.decode("utf-8", "replace")}
        files = sorted(
            path for path in self.folder.rglob("*") if path.is_file() and self._is_shown(path)
        )
        told = [
            {"file": str(path.relative_to(self.folder)), "bytes": path.stat().st_size}
            for path in files[:LISTED]
        ]
        rest = {"left_out": {"files": f"{len(files) - LISTED} more"}} if len(files) > LISTED else {}
        return {"files": told, **rest, "next": "run_ibrid with words such as inspect, FILE"}

    def save_step(self, step: int, file: str) -> PlainData:
        """Write the record of a step into the folder, for the commands that take a record."""
        path = self._inside(file)
        if path.suffix != ".json":
            raise IbridError(f"file must end with .json; found {file[:100]!r}")
        if path.exists():
            raise IbridError(f"{file[:100]} is there already; choose another name")
        self._steps.record(step).write(path)
        return {"file": file, "next": f"run_ibrid with stability, {file}, or report, {file}"}

    def _require_allowed(self, words: Sequence[str]) -> None:
        command = words[0] if words else ""
        if command in DEVICES and command not in self._commands:
            raise IbridError(
                f"{command} runs model files, which the user has not allowed; it needs a server "
                "that was started with --allow-devices"
            )
        if command not in self._commands:
            raise IbridError(
                f"there is no command {command[:60]!r}; {near(command, self._commands)}"
            )
        for word in words[1:]:
            option = word.split("=", 1)[0]
            if option in EXECUTING:
                raise IbridError(f"{word[:60]} executes a Python file, which no tool does")
            if option in ASKING.get(command, ()):
                raise IbridError(f"{word[:60]} asks a language model, which no tool does")

    def _begun(self, words: tuple[str, ...]) -> _Running:
        scratch = TemporaryDirectory(prefix="ibrid-study-", ignore_cleanup_errors=True)
        single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        path = os.pathsep.join(filter(None, sys.path))
        environment = {**os.environ, **single, "PYTHONPATH": path, ONLY_BELOW: str(self.folder)}
        try:
            with (
                (Path(scratch.name) / "stdout").open("wb") as stdout,
                (Path(scratch.name) / "stderr").open("wb") as stderr,
            ):
                process = subprocess.Popen(
                    [sys.executable, "-P", "-c", _RUN, *words],
                    cwd=self.folder,
                    env=environment,
                    stdin=subprocess.PIPE,  # of which the command sees only that it ends
                    stdout=stdout,
                    stderr=stderr,
                )
        except (OSError, ValueError) as error:  # ValueError: of words that no system can pass on
            scratch.cleanup()
            raise IbridError(f"the command cannot be begun ({error}); choose other words") from None
        return _Running(words, process, scratch)

    def _answer(self, running: _Running) -> PlainData:
        try:
            status = running.process.wait(timeout=self._answer_within)
        except subprocess.TimeoutExpired:
            return {
                "running": True,
                "told": running.output("stderr")[-1_000:],
                "next": "run_ibrid again in the same words goes on",
            }
        answer = {
            "status": status,
            "printed": running.output("stdout"),
            "told": running.output("stderr"),
            "next": "list_files",
        }
        self._stop()
        return answer

    def _stop(self) -> None:
        if self._running is not None:
            self._running.end()
            self._running = None

    def _is_shown(self, path: Path) -> bool:
        """Whether a file is none that is hidden, and no link out of the folder."""
        parts = path.relative_to(self.folder).parts
        hidden = any(part.startswith(".") for part in parts)
        return not hidden and path.resolve().is_relative_to(self.folder)

    def _inside(self, file: str) -> Path:
        try:
            path = (self.folder / file).resolve()
            path.is_file()
        except (OSError, ValueError) as error:
            raise IbridError(f"{file[:100]!r} can be no file ({error}); choose another") from None
        if not path.is_relative_to(self.folder) or path == self.folder:
            raise IbridError(f"{file[:100]!r} must be a file below the folder of the study")
        return path
