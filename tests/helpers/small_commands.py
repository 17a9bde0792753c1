"""Commands of ibrid that take seconds, on a few frequencies of the shipped benchmark."""

import sys
from pathlib import Path

import ibrid
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.program import program_text

#: The tools of agents, called as a client would, their answers printed.
TOOLS = """
import json, sys
import ibrid
from ibrid.fit.settings import fit_settings
from ibrid.study import Study
from ibrid_search.agents.logbook import Logbook
from ibrid_search.agents.tool import call_by_name
from ibrid_search.agents.workbench import Workbench

study = Study(ibrid.read_sweep(sys.argv[1]))
bench = Workbench(Logbook(study, fit=fit_settings("low")))
naive = ibrid.program_text(ibrid.textbook("naive"))
for name, arguments in (
    ("show_data", {}), ("list_diagrams", {}), ("evaluate_program", {"program": naive}), ("diagnose", {"step": 0}),
    ("try_programs", {"programs": [naive]}), ("check_grammar", {"program": naive}), ("show_residuals", {"step": 0}),
):
    print(json.dumps(call_by_name(bench.all, name, arguments)))
"""


def few_frequencies(folder: Path) -> Path:
    """A small sweep: what is asked is whether a clock matters, not how well anything fits."""
    lines = benchmarks()["paper_like"].read_text(encoding="utf-8").splitlines()
    heads = [line for line in lines if line.startswith(("#", "op,"))]
    rows = [line for line in lines if line not in heads]
    file = folder / "few.csv"
    file.write_text("\n".join(heads + rows[::3]) + "\n", encoding="utf-8")
    return file


def command(name: str, folder: Path) -> list[str]:
    """The command of that name on small data in the folder."""
    sweep = str(few_frequencies(folder))
    if name == "mcp":
        return [sys.executable, "-c", TOOLS, sweep]
    (folder / "devices").mkdir()
    (folder / "devices" / "one.csv").write_bytes(Path(sweep).read_bytes())
    (folder / "model.py").write_text(program_text(ibrid.textbook("gfl_exact")), encoding="utf-8")
    words = {
        "start": ["start", "few.csv", "--effort", "low", "--out", "out"],
        "gap": ["gap", "model.py", "few.csv", "--effort", "low", "--out", "out"],
        "search": [
            "search",
            "few.csv",
            "--workers",
            "1",
            "--budget",
            "4",
            "--effort",
            "low",
            "--out",
            "out",
        ],
        "evaluate": ["evaluate", "model.py", "few.csv", "--restarts", "0", "--json", "out.json"],
        "import": ["import", "few.csv", "--out", "out.csv"],
        "fleet": ["fleet", "devices", "--workers", "1", "--effort", "low", "--out", "out"],
    }
    return [sys.executable, "-m", "ibrid", *words[name]]
