"""`python -m ibrid_bench.hidden`: write one case, the truth into a folder of its own."""

import argparse
import sys

from ibrid_bench.hidden.case import KINDS, Case, draw_case, write_case
from ibrid_bench.hidden.declaration import SEVERITIES
from ibrid_bench.hidden.nonlinear_case import NONLINEAR, draw_nonlinear_case

from ibrid.errors import IbridError


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0: both folders are written; 2: the words make no case."""
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.hidden", description="A device that hides an effect."
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument(
        "--kind",
        choices=(*KINDS, "nonlinear"),
        default="effect",
        help="nonlinear: swept in time at several amplitudes",
    )
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="ID[:CHANGE[:VARIANT]]",
        help=f"may be repeated; of a nonlinear case one of {', '.join(NONLINEAR)}",
    )
    parser.add_argument("--severity", choices=SEVERITIES, default="clear")
    parser.add_argument("--noise-db", type=float, metavar="DB", help="default: clean")
    parser.add_argument("--sigma", choices=("known", "none"), default="known")
    parser.add_argument("--frequencies", type=int, default=16, metavar="K")
    parser.add_argument("--points", type=int, default=2, metavar="M")
    parser.add_argument("--error", type=float, default=0.15, help="of the nominal values")
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="sweep.csv, model.py, nominal.json, holdout.csv"
    )
    parser.add_argument("--truth", required=True, metavar="DIR", help="truth.json")
    asked = parser.parse_args(arguments)
    try:
        case = (
            _nonlinear(asked)
            if asked.kind == "nonlinear"
            else draw_case(
                asked.kind,
                asked.seed,
                effects=asked.effect,
                severity=asked.severity,
                noise_db=asked.noise_db,
                sigma=asked.sigma,
                frequencies=asked.frequencies,
                points=asked.points,
                error=asked.error,
            )
        )
        write_case(case, asked.out, asked.truth)
    except IbridError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    return 0


def _nonlinear(asked: argparse.Namespace) -> Case:
    (kind,) = asked.effect if len(asked.effect) == 1 else ("nothing",)
    return draw_nonlinear_case(
        kind,
        asked.seed,
        noise_db=asked.noise_db,
        sigma=asked.sigma,
        grid=f"3:2000:{asked.frequencies}",
        points=asked.points,
        error=asked.error,
    )


if __name__ == "__main__":
    sys.exit(main())
