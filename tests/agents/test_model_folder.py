"""A model's folder of others is read as numbers and words: no code in it runs, and none is asked
for.
"""

import ast
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from ibrid_search.language_models.model_folder import pretrained
from ibrid_search.proposers.local_model import LocalModel

from ibrid.errors import IbridError

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("AutoModelForCausalLM", "LlamaForCausalLM", "AutoTokenizer", "LlamaConfig")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "llama"}))
    (tmp_path / "model.safetensors").write_bytes(b"numbers")
    return tmp_path


def test_every_class_of_transformers_is_told_to_trust_no_code(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    asked = {}
    fake = ModuleType("transformers")
    for kind in KINDS:
        reads = SimpleNamespace(
            from_pretrained=lambda folder, kind=kind, **options: asked.update({kind: options})
        )
        setattr(fake, kind, reads)
    monkeypatch.setitem(sys.modules, "transformers", fake)
    for kind in KINDS:
        pretrained(kind, folder)
    assert all(
        asked[kind]["trust_remote_code"] is False and asked[kind]["local_files_only"]
        for kind in KINDS
    )
    assert [kind for kind in KINDS if asked[kind].get("use_safetensors")] == list(KINDS[:2])


@pytest.mark.nightly
def test_code_reads_folders_of_others_in_one_place_only():
    calls = []
    for path in sorted([*(ROOT / "ibrid").rglob("*.py"), *(ROOT / "search").rglob("*.py")]):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "from_pretrained":
                told = {one.arg: ast.unparse(one.value) for one in node.keywords}
                assert told.get("trust_remote_code") == "False", f"{path} line {node.lineno}"
                calls.append(path.name)
            assert getattr(node, "attr", "") not in ("from_pretrained_adapter", "load_adapter"), (
                path
            )
    # the second reads the GGUF file of an installed package
    assert set(calls) == {"model_folder.py", "smollm2.py"}


@pytest.mark.parametrize("weights", ["pytorch_model.bin", "model.pt", "model.ckpt"])
def test_weights_that_can_run_code_are_refused_in_one_sentence(folder: Path, weights: str):
    (folder / "model.safetensors").rename(folder / weights)
    with pytest.raises(
        IbridError, match=r"its weights must be \*\.safetensors, since other formats can run code"
    ):
        LocalModel(folder)


def test_an_adapter_that_names_a_model_elsewhere_is_refused(folder: Path):
    (folder / "adapter_config.json").write_text("{}")
    with pytest.raises(IbridError, match="holds an adapter, which names a model elsewhere"):
        LocalModel(folder)


def test_a_kernel_from_the_network_is_refused(folder: Path):
    (folder / "config.json").write_text(json.dumps({"_attn_implementation": "somebody/kernel"}))
    with pytest.raises(IbridError, match="asks for a kernel from the network"):
        LocalModel(folder)
