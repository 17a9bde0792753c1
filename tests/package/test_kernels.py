"""Which processors `make test-kernels` stands for, and what it says of those that it cannot."""

import pytest
from kernels import KERNELS, settings

#: Kernel asked for -> kernel that OpenBLAS takes: None where the processor cannot run it, ""
#: without OpenBLAS.
CASES = {
    "a processor of today": (
        {"Haswell": "Haswell", "SkylakeX": "SkylakeX", "Zen": "Haswell", "Nehalem": "Nehalem"},
        ["Haswell", "SkylakeX", "Nehalem", "generic"],
        ["Zen: left out, this OpenBLAS takes Haswell for it, tested as Haswell"],
    ),
    "an older one": (
        {"Haswell": "Haswell", "SkylakeX": None, "Zen": "Zen", "Nehalem": "Nehalem"},
        ["Haswell", "Zen", "Nehalem", "generic"],
        ["SkylakeX: left out, this processor cannot run it"],
    ),
    "no OpenBLAS": (
        dict.fromkeys(KERNELS, ""),
        ["generic"],
        [
            f"{kernel}: left out, the linear algebra here is not of an OpenBLAS that has a choice"
            for kernel in KERNELS
        ],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_every_kernel_is_tested_once_or_left_out_with_a_reason(case: str):
    cores, names, sentences = CASES[case]
    able, left_out = settings(cores.get)
    assert [setting.name for setting in able] == names
    assert left_out == sentences
    assert able[-1].environment["NUMBA_CPU_NAME"] == "generic"
