"""Print the figures of the core: speed, success, cost by size, memory. One core, medians,
everything in one run.
"""

import numpy as np
from ibrid_bench.fit.devices import devices, wrong_candidates
from ibrid_bench.fit.process import command_cost
from ibrid_bench.fit.speed import cost_by_size, evaluation_seconds, reference_seconds
from ibrid_bench.fit.success import noisy, solved, wrong
from ibrid_bench.fit.unmeasured import inverters, predicted
from ibrid_bench.fit.weak_grid import critical_ratios

from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.read import read_sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.library import textbook


def main() -> None:
    """Run all parts; a quarter of an hour."""
    _speed()
    _paper()
    _known_structure()
    _wrong_structure()
    _elsewhere()
    _critical()
    _cost()
    _processes()


def _title(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}", flush=True)


def _speed() -> None:
    _title(
        "A whole evaluation: 13-state GFL, two operating points, 16 frequencies, program to record"
    )
    sweep = read_sweep(benchmarks()["paper_like"])
    diagram = textbook("gfl_pll_filter_exact")
    ours, error = evaluation_seconds(diagram, sweep, 20)
    print(
        f"ibrid, all starts             {ours:8.3f} s   worst NRMSE of 20 seeds {error:.1e}   "
        "(target 0.15 s)",
        flush=True,
    )
    for title, by_interconnect in (("our matrices", False), ("interconnect", True)):
        theirs, other, responses = reference_seconds(
            diagram, sweep, by_interconnect=by_interconnect
        )
        print(
            f"least_squares, {title}   {theirs:8.2f} s   best NRMSE of 6 starts  {other:.1e}   "
            f"{responses} responses   {theirs / ours:.0f} x   (target 100 x)",
            flush=True,
        )


def _paper() -> None:
    _title("The paper's setting on paper_like: per-point fits, fitted equilibrium")
    sweep = read_sweep(benchmarks()["paper_like"])
    for name, published in (
        ("naive", "paper, its own device: 0.470"),
        ("gfl_pll_filter", "paper: 0.047"),
    ):
        record = evaluate(
            textbook(name), sweep, parameters="per-op", equilibrium="paper", vocabulary="paper"
        )
        print(f"{name:38s} NRMSE {record.nrmse:.4f}   {record.seconds:.2f} s   ({published})")


def _known_structure() -> None:
    _title("Known structure from default starts: right minimum found (4 seeds x 25 devices each)")
    for population in ("textbook", "wide"):
        found = devices(25, population)
        clean = solved(found, 4)
        right = int((clean.errors <= 1e-5).sum())
        print(
            f"{population:9s} clean: {right:3d} of {clean.errors.size}   median "
            f"{clean.median_seconds:.3f} s",
            flush=True,
        )
        for decibel in (60, 40):
            answer = noisy(found, 4, decibel)
            print(
                f"{population:9s} {decibel} dB: within 1 % of the best known "
                f"{(answer.ratios <= 1.01).mean():6.1%}, "
                f"within 5 % {(answer.ratios <= 1.05).mean():6.1%}, worst "
                f"{answer.ratios.max():.2f}   "
                f"median {answer.median_seconds:.3f} s",
                flush=True,
            )


def _wrong_structure() -> None:
    _title("Wrong structures: NRMSE over the best known (4 seeds x 6 devices)")
    found = devices(6, "textbook", seed=0)
    for name, candidate in wrong_candidates().items():
        answer = wrong(found, 4, candidate)
        by_device = np.median(answer.ratios, axis=1)
        print(
            f"{name:18s} best known {np.median(answer.best):.3f} (median)   ratio: median "
            f"{np.median(answer.ratios):.3f}, "
            f"worst device's median {by_device.max():.3f}, worst {answer.ratios.max():.2f}   "
            f"{answer.median_seconds:.2f} s",
            flush=True,
        )


def _elsewhere() -> None:
    seeds = 20
    _title(
        "An operating point that was not measured, true structure from two others (11 inverters, "
        f"{seeds} noise seeds)"
    )
    for objective in ("nrmse", "sigma"):
        found = predicted(inverters(), 40, seeds, objective)
        noisy, coverage = (
            np.array([one.noisy for one in found]),
            np.array([one.coverage for one in found]),
        )
        print(
            f"{objective:6s} clean: worst NRMSE {max(one.clean for one in found):.0e} (target "
            "1e-3)   40 dB: median "
            f"{np.median(noisy):.4f}, worst {noisy.max():.4f} (target 0.02)   95 % bands hold "
            f"{coverage.mean():.1%}, "
            f"by inverter {coverage.mean(axis=1).min():.1%} to {coverage.mean(axis=1).max():.1%} "
            "(target 93 to 97 %)",
            flush=True,
        )


def _critical() -> None:
    _title(
        "Critical short-circuit ratios of identified models (11 inverters, two points each, X/R 10)"
    )
    found = list(critical_ratios(inverters()))
    apart = [abs(one.nyquist / one.poles - 1.0) for one in found if one.nyquist is not None]
    simulated = [abs(one.simulated / one.poles - 1.0) for one in found if one.simulated is not None]
    print(
        f"{len(found)} crossings   poles and Nyquist count apart by {max(apart):.0e} at most, "
        f"{len(apart)} compared (target "
        f"1e-2)   poles and nonlinear simulation by {max(simulated):.1e}, {len(simulated)} "
        "compared (target 5e-2)",
        flush=True,
    )


def _cost() -> None:
    orders, counts = (6, 13, 20, 30), (16, 60, 200)
    _title("Residual, gradient and J'J per start at two operating points, microseconds")
    table = cost_by_size(orders, counts)
    print("states \\ frequencies " + "".join(f"{count:>9d}" for count in counts))
    for order in orders:
        print(f"{order:20d} " + "".join(f"{1e6 * table[order, count]:9.0f}" for count in counts))


def _processes() -> None:
    _title("Commands")
    for arguments, target in (
        (["--help"], "0.5 s"),
        (["evaluate", "gfl_pll_filter_exact", "paper_like"], "5 s, 500 MB"),
    ):
        seconds, megabytes = min(command_cost(arguments) for _ in range(3))
        print(
            f"ibrid {' '.join(arguments):42s} {seconds:6.2f} s   {megabytes:4.0f} MB   (target "
            f"{target})"
        )


if __name__ == "__main__":
    main()
