"""Settings of other packages in the working folder, perhaps somebody else's, decide nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import ibrid

HOSTILE = {
    "ipopt.opt": "output_file {outside}\nobj_scaling_factor 1e-9\n",
    "ipopt.opt of another format": "no option of Ipopt\n",
    "matplotlibrc": "text.usetex: True\nfont.size: 40\n",
    "matplotlibrc that is no text": "\udcff\udcfe",
    ".numba_config.yaml": "fastmath: 1\ndisable_jit: 1\ncache_dir: {outside}\n",
    ".numba_config.yaml that is no YAML": "x: [",
}


def _ibrid(folder: Path, *words: str) -> str:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-P", "-m", "ibrid", *words]
    process = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return f"{process.returncode} {process.stdout} {process.stderr}"


def _fit(folder: Path) -> dict[str, str | bytes]:
    """What a fit and its page are in a folder, and what the command said."""
    folder.mkdir(exist_ok=True)
    (folder / "sweep.csv").write_bytes(ibrid.benchmarks()["gfl_l_filter"].read_bytes())
    options = ("--effort", "low", "--json", "fit.json", "--report", "fit.html")
    said = _ibrid(folder, "evaluate", "gfl_l_filter", "sweep.csv", *options)
    files = {name: folder / name for name in ("fit.json", "fit.html")}
    return {"said": said, **{k: f.read_bytes() if f.exists() else "" for k, f in files.items()}}


@pytest.mark.slow
def test_settings_in_the_working_folder_change_nothing(tmp_path: Path):
    plain = _fit(tmp_path / "plain")
    outside = tmp_path / "outside"
    changed = []
    for number, (name, text) in enumerate(HOSTILE.items()):
        folder = tmp_path / f"hostile{number}"
        folder.mkdir()
        content = text.format(outside=outside).encode("utf-8", "surrogateescape")
        (folder / name.split(" ")[0]).write_bytes(content)
        if _fit(folder) != plain:
            changed.append(name)
    assert changed == []
    assert not outside.exists()
    assert plain["fit.html"]


def test_a_page_does_not_depend_on_the_readers_own_figures():
    from matplotlib import rc_context

    from ibrid.report.look.figure import inline_svg

    def line(axes):
        axes[0].plot([1, 2], [1, 2])

    usual = inline_svg(line, name="line", label="a line", size=(3, 2))
    with rc_context({"font.size": 40, "lines.linewidth": 9, "axes.grid": True}):
        assert inline_svg(line, name="line", label="a line", size=(3, 2)) == usual
