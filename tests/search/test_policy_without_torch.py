"""Without torch the policy is one sentence, and everything else works."""

import subprocess
import sys

import pytest
from ibrid_search.proposers.choose import Proposers

from ibrid.errors import IbridError

WITHOUT_TORCH = """
import sys
from importlib.abc import MetaPathFinder


class Missing(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ImportError(name)


sys.meta_path.insert(0, Missing())
from ibrid.cli import main
sys.exit(main(["search", "paper_like", "--out", sys.argv[1], "--proposer", "policy"]))
"""


def test_the_policy_without_torch_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(IbridError, match=r"pip install 'ibrid\[local-llm\]'"):
        Proposers("policy").weighted()
    assert Proposers("rules:0.5,random:0.5").weighted()


@pytest.mark.slow
def test_a_search_that_cannot_run_leaves_nothing_behind(tmp_path):
    folder = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH, str(folder)], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "ibrid[local-llm]" in done.stderr
    assert "Traceback" not in done.stderr
    assert not folder.exists()
