"""The attacks, each a function of a folder and the moment until which it may go on, and what came
of it: a row.
"""

import contextlib
import ctypes
import io
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from ibrid_bench.attack.binaries import binaries_tried
from ibrid_bench.attack.costs import costs
from ibrid_bench.attack.kills import killed_runs
from ibrid_bench.attack.limits import attempts
from ibrid_bench.attack.names import payloads
from ibrid_bench.attack.programs import EVIL
from ibrid_bench.attack.reading import events_tried, plain, records_tried, runs_tried

from ibrid import cli
from ibrid.analysis.models.linear_model import linear_model
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.export.c_source import c_source
from ibrid.measurement.read import read_sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.library import textbook, textbook_text
from ibrid.structure.diagrams.program import parse_program

DATA = str(benchmarks()["paper_like"])
OP = "p=1,q=0.3"
OPTIONS = (
    "--proposer",
    "random",
    "--start",
    "naive",
    "--budget",
    "4",
    "--workers",
    "1",
    "--seed",
    "3",
)


@dataclass
class Row:
    """An attack: how often it was tried, what went wrong, and what was stored and lost by it."""

    attack: str
    tried: int
    failed: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    @property
    def cells(self) -> str:
        """The row of a Markdown table."""
        return f"| {self.attack} | {self.tried:,} | {len(self.failed)} | {len(self.lost)} |"


def programs(folder: Path, until: float) -> Row:
    """Textbook programs with code, and with code cut into them; whatever ran would leave a file."""
    marker = folder / "RAN"
    code = (
        f"__import__('pathlib').Path({str(marker)!r}).touch()",
        f"open({str(marker)!r}, 'w')",
        f"exec(\"open({str(marker)!r}, 'w')\")",
        f"import os; os.system('touch {marker}')",
    )
    import random

    rng, row = random.Random(1), Row("programs that hold code", 0)
    lines = textbook_text("gfl").splitlines()
    for _ in range(20_000):
        text, evil = list(lines), rng.choice(code)
        place = rng.randrange(len(text))
        at = rng.randrange(len(text[place]) + 1)
        text[place] = rng.choice(
            (
                text[place][:at] + evil + text[place][at:],
                "    " + evil,
                evil,
                f"    g.add({evil}, 'x')",
            )
        )
        row.tried += 1
        try:
            parse_program("\n".join(text))
        except IbridError:
            pass
        except Exception as error:
            row.failed.append(f"{type(error).__name__}: {error}")
        if time.monotonic() > until:
            break
    row.failed += ["code ran"] if marker.exists() else []
    return row


def names(folder: Path, until: float) -> Row:
    """Names of points, states and parameters in C that is compiled and loaded; the suite tries
    every other exporter.
    """
    from dataclasses import replace

    row, compiler = (
        Row("names that try to run, through C, compiled and loaded", 0),
        shutil.which("cc"),
    )
    model = linear_model(evaluate(textbook("naive"), read_sweep(DATA), restarts=0), OP)
    for number, name in enumerate(payloads(str(folder / "RAN"), seed=9) if compiler else ()):
        (folder / "model.c").write_bytes(
            c_source(replace(model, name=name, op=name, parameters={name: 1.0}))
        )
        library = folder / f"model{number}.so"
        done = subprocess.run(
            [
                str(compiler),
                "-std=c99",
                "-trigraphs",
                "-w",
                "-fPIC",
                "-shared",
                "model.c",
                "-o",
                library.name,
                "-lm",
            ],
            cwd=folder,
            capture_output=True,
        )
        row.tried += 1
        if done.returncode:
            row.failed.append(f"{name!r} is no C")
            continue
        ctypes.CDLL(str(library))
        if (folder / "RAN").exists():
            row.failed.append(f"code ran: {name!r}")
            (folder / "RAN").unlink()
        if time.monotonic() > until:
            break
    return row


def records(folder: Path, until: float) -> Row:
    """Damaged records, each shown in a notebook, as text, and by one further command."""
    sweep = read_sweep(DATA)
    made = [
        evaluate(textbook(name), sweep, restarts=0) for name in ("gfl_delay", "gfl_exact", "naive")
    ]
    made.append(evaluate(textbook("gfl_exact"), sweep, restarts=0, holdout_op=OP))
    made.append(evaluate(textbook("gfl_exact"), sweep, vocabulary="paper"))
    return _tried(
        "damaged records, read in every way",
        2000,
        until,
        lambda n, seed: records_tried([plain(one) for one in made], folder, n, seed, commands=1),
    )


def archives(folder: Path, until: float) -> Row:
    """Damaged archives and run folders, shown and gone on with."""
    run = folder / "whole"
    cli.main(["search", DATA, "--out", str(run), *OPTIONS])
    return _tried(
        "damaged runs, shown and resumed",
        300,
        until,
        lambda n, seed: runs_tried(run, DATA, folder, n, seed, OPTIONS),
    )


def binaries(folder: Path, until: float) -> Row:
    """Foreign binary files."""
    return _tried(
        "damaged binary files (MAT, HDF5, xlsx, Parquet, COMTRADE)",
        300,
        until,
        lambda n, seed: binaries_tried(folder, n, seed),
    )


def events(folder: Path, until: float) -> Row:
    """Damaged records of events, inspected and played back."""
    whole = folder / "events.csv"
    told = ("--event", "dip:0.6,at=0.05,for=0.05", "--length", "0.15", "--rate", "2000")
    cli.main(["record", "paper_like", "--op", OP, *told, "--out", str(whole)])
    return _tried(
        "damaged records of events, inspected and played back",
        300,
        until,
        lambda n, seed: events_tried(whole, folder, n, seed),
    )


def links(folder: Path, until: float) -> Row:
    """Each file of a run's folder as a link to a precious one."""
    from ibrid_search.run.run_folder import _WRITTEN as WRITTEN
    from ibrid_search.run.run_folder import ARCHIVE, BESIDE_ARCHIVE, RUN_TOML

    row, precious, whole = (
        Row("run folders with links out of them", 0),
        folder / "precious",
        folder / "whole",
    )
    cli.main(["search", DATA, "--out", str(whole), *OPTIONS])
    for name in (ARCHIVE, RUN_TOML, *WRITTEN, *BESIDE_ARCHIVE):
        for words in (
            ["report", "RUN"],
            ["search", DATA, "--out", "RUN", "--resume", *OPTIONS, "--budget", "5"],
        ):
            run = folder / f"run{row.tried}"
            shutil.copytree(whole, run)
            precious.write_text("precious")
            (run / name).unlink(missing_ok=True)
            (run / name).symlink_to(precious)
            row.tried += 1
            cli.main([str(run) if word == "RUN" else word for word in words])
            if precious.read_text() != "precious":
                row.failed.append(f"{name}: {words[0]} wrote through it")
    return row


def evil(folder: Path, until: float) -> Row:
    """Legal programs that want all time and memory."""
    row = Row("evil legal programs against 5 s and 200 MB", 0)
    for attempt in islice(attempts(), len(EVIL)):
        row.tried += 1
        if not attempt.held:
            row.failed.append(
                f"{attempt.what}: {attempt.outcome}, {attempt.seconds:.1f} s, "
                f"{attempt.megabytes:.0f} MB"
            )
        if time.monotonic() > until:
            break
    return row


def refusals(folder: Path, until: float) -> Row:
    """What is refused, or is large, against the clock."""
    row = Row(
        "cost of refusing: illegal programs 1 s, a million rows 10 s, a line of 40 MB 1 s (of "
        "computation)",
        0,
    )
    for what, seconds, most in costs(folder):
        row.tried += 1
        if seconds > most:
            row.failed.append(f"{what}: {seconds:.1f} s")
    return row


def kills(folder: Path, until: float) -> list[Row]:
    """SIGKILL, alone and with workers of Ray."""
    now, rows = time.monotonic(), []
    for workers, number, later, share in ((1, 40, 0, 0.3), (2, 60, 60, 1.0)):
        end = now + share * (until - now)
        killed = killed_runs(
            DATA, folder, number, seed=workers, until=end, workers=workers, later=later
        )
        crew = "with workers of Ray" if workers > 1 else "in one process"
        attack = f"kill -9 {crew}, {killed.later} after the first stored result"
        rows.append(Row(attack, killed.kills, [], killed.lost))
    return rows


ATTACKS: dict[str, Callable[[Path, float], Row | list[Row]]] = {
    attack.__name__: attack
    for attack in (
        programs,
        names,
        links,
        evil,
        refusals,
        events,
        archives,
        binaries,
        records,
        kills,
    )
}


def _tried(
    attack: str,
    number: int,
    until: float,
    make: Callable[[int, int], Iterable[str]],
    part: int = 10,
) -> Row:
    """So many tries, or as many as there is time for."""
    row = Row(attack, 0)
    while row.tried < number and time.monotonic() < until:
        row.failed += make(part, 1000 + row.tried)
        row.tried += part
    return row


def rows_of(name: str, until: float) -> list[Row]:
    """The rows of one attack, in a folder of its own, until a moment (monotonic, s); what commands
    say is dropped.
    """
    quiet = io.StringIO()
    with (
        tempfile.TemporaryDirectory(prefix="ibrid-attack-") as folder,
        contextlib.redirect_stdout(quiet),
        contextlib.redirect_stderr(quiet),
    ):
        made = ATTACKS[name](Path(folder), until)
    return [made] if isinstance(made, Row) else made
