"""Numerical tests on other processors: with the arithmetic that OpenBLAS, numba, NumPy and the
library of C choose there.

    python tests/helpers/kernels.py [ARGUMENTS OF PYTEST]       (make test-kernels)

One run of pytest for each kernel of OpenBLAS in `KERNELS` that this processor and this OpenBLAS
have, and one for a processor without vector and fused operations. What cannot run here is said and
left out.
"""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

#: Kernels of OpenBLAS, by the names that it reads in OPENBLAS_CORETYPE.
KERNELS = ("Haswell", "SkylakeX", "Zen", "Nehalem")
#: Linear algebra of numpy and of scipy, each of which has an OpenBLAS; it dies where the processor
#: lacks an instruction.
TRIAL = """
import numpy, scipy.linalg
for kind in (float, complex):
    matrix = numpy.random.default_rng(0).normal(size=(200, 200)).astype(kind)
    for library in (numpy.linalg, scipy.linalg):
        library.svd(matrix @ matrix), library.eig(matrix), library.solve(matrix, matrix), library.qr(matrix)
"""
#: What NumPy would choose on this processor beyond its baseline, and can be told to leave.
FEATURES = """
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
print(*[name for name in __cpu_dispatch__ if __cpu_features__.get(name)])
"""


@dataclass(frozen=True)
class Setting:
    """A processor to stand for. `environment` : what the libraries read when they are loaded."""

    name: str
    environment: Mapping[str, str]


def core_of(kernel: str) -> str | None:
    """The kernel that OpenBLAS takes when it is asked for one; "" when there is no OpenBLAS, None
    when it cannot run here.
    """
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_VERBOSE": "2"}
    trial = subprocess.run(
        [sys.executable, "-c", TRIAL], env=environment, capture_output=True, text=True, check=False
    )
    if trial.returncode:
        return None
    cores = re.findall(r"^Core: (\w+)", trial.stdout + trial.stderr, re.MULTILINE)
    return cores[-1] if cores else ""


def plain_processor() -> Setting:
    """One without vector and fused operations, as far as the libraries can be told."""
    asked = subprocess.run(
        [sys.executable, "-c", FEATURES], capture_output=True, text=True, check=False
    )
    environment = {
        "NUMBA_CPU_NAME": "generic",
        "NPY_DISABLE_CPU_FEATURES": asked.stdout.strip(),
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    }
    return Setting("generic", {name: value for name, value in environment.items() if value})


def settings(core: Callable[[str], str | None] = core_of) -> tuple[list[Setting], list[str]]:
    """What can be tested here, and a sentence for each kernel that is left out."""
    able: list[Setting] = []
    left_out: list[str] = []
    cores: dict[str, str] = {}
    for kernel in KERNELS:
        taken = core(kernel)
        if taken is None:
            left_out.append(f"{kernel}: left out, this processor cannot run it")
        elif not taken:
            left_out.append(
                f"{kernel}: left out, the linear algebra here is not of an OpenBLAS that has a "
                "choice"
            )
        elif taken in cores:
            left_out.append(
                f"{kernel}: left out, this OpenBLAS takes {taken} for it, tested as {cores[taken]}"
            )
        elif taken != kernel:
            left_out.append(f"{kernel}: left out, this OpenBLAS takes {taken} in its place")
        else:
            cores[taken] = kernel
            able.append(Setting(kernel, {"OPENBLAS_CORETYPE": kernel}))
    return [*able, plain_processor()], left_out


def main(arguments: Sequence[str]) -> int:
    """Run pytest under each setting; 1 where a test fails under one."""
    able, left_out = settings()
    results: list[str] = []
    for setting in able:
        print(
            f"\n{setting.name}: {' '.join('='.join(each) for each in setting.environment.items())}",
            flush=True,
        )
        command = [sys.executable, "-m", "pytest", *arguments]
        status = subprocess.run(
            command, env={**os.environ, **setting.environment}, check=False
        ).returncode
        results.append(f"{setting.name}: {'passed' if status == 0 else 'FAILED'}")
    print("", *results, *left_out, sep="\n")
    return int(any(result.endswith("FAILED") for result in results))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
