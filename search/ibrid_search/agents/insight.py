"""The tools of an agent that look at the data: what was measured, what ships, what a step lacks,
what a program promises.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.errors import IbridError, ProgramError
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.sequence_view import sequence_view
from ibrid.measurement.sweeps.amplitudes import evenly
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep
from ibrid.structure.compiling.check import examine
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import shipped_names, textbook_text
from ibrid.structure.diagrams.program import LONGEST_PROGRAM, parse_program, program_text
from ibrid.study import Study
from ibrid.writing import PlainData
from ibrid_search.agents.tool import Steps, Tool, tools_in
from ibrid_search.language_models.physics_in_words import physics_in_words
from ibrid_search.language_models.record_view import polar, port_view
from ibrid_search.proposal import Evaluated
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.edit_screening import ScreeningFit
from ibrid_search.screening.time_slices import TimeSlice, TimeSliceOver

#: Frequencies that are shown of a view, edits that are ranked, programs that are looked at.
ROWS, RANKED, TRIED = 16, 8, 8
#: Shipped diagrams that are listed.
LISTED = 12
#: What the errors of a diagnosis are: where the noise is known, and where it is not.
_WEIGHTED = (
    "noise_leaves times the residual in sigma, so that accurate entries weigh more than in NRMSE"
)
_SCREENED = "those of edits come from a brief fit to part of the data: compare with step_screened"
#: Looks that are ranked for each that is told: different edits may lead to one structure.
TWICE = 2


class Insight:
    """What the data say to whoever asks; nothing is evaluated.

    `steps` : what was. `hand_in`, `answer_within` : as of `Tools`.
    """

    def __init__(
        self, study: Study, steps: Steps, hand_in: str, answer_within: float | None = None
    ) -> None:
        self.study, self.steps, self.hand_in, self.answer_within = (
            study,
            steps,
            hand_in,
            answer_within,
        )
        self._diagnosed: dict[int, list[ScreeningFit]] = {}

    @property
    def tools(self) -> tuple[Tool, ...]:
        """Data, shipped diagrams, diagnosis, looks at programs."""
        return tools_in(
            "insight.toml",
            self,
            longest_program=LONGEST_PROGRAM,
            rows=ROWS,
            ranked=RANKED,
            tried=TRIED,
            views=list(_VIEWS),
            diagrams=self.diagrams,
        )

    @property
    def diagrams(self) -> list[str]:
        """Names of the published controls that ship."""
        return list(shipped_names())

    def show_data(
        self, op: str | None = None, view: str = "Y", low: float = 0.0, high: float = float("inf")
    ) -> PlainData:
        """Rows of a view of one operating point; every left-out frequency is counted."""
        point = self.study.fitted.point(op) if op is not None else self.study.fitted.points[0]
        inside = np.flatnonzero((point.frequency >= low) & (point.frequency <= high))
        if not inside.size:
            raise IbridError(
                f"{point.op.name} was measured from {point.frequency[0]:.4g} to "
                f"{point.frequency[-1]:.4g} Hz, nothing lies "
                f"between {low:g} and {high:g} Hz; ask for a band inside"
            )
        shown = inside[evenly(inside.size, ROWS)]
        return {
            "op": point.op.name,
            "p_q_v": list(point.op.pqv),
            "operating_points": list(self.study.fitted.names),
            "view": view,
            "rows": list(_VIEWS[view](point, shown, self.study.fitted)),
            "left_out_between": int(inside.size - shown.size),
            "in_words": list(physics_in_words(self.study.fitted)),
            "warnings": list(inspect(self.study.fitted).warnings),
            "next": "list_diagrams",
        }

    def list_diagrams(self) -> PlainData:
        """Names of shipped diagrams with their first looks."""
        rankings = rankings_for(self.study)
        with rankings.screener.time_slice(self.answer_within) as part:
            try:
                looks = rankings.library_fits
            except TimeSliceOver:
                seen = sorted((one for one in part.fits if one.values), key=lambda look: look.score)
                return _so_far(part, [_named(look) for look in seen[:LISTED]], "list_diagrams")
        ranked = [_named(look) for look in looks]
        others = [
            name for name in shipped_names() if name not in {one["name"] for one in ranked[:LISTED]}
        ]
        then = "describe_vocabulary"
        if ranked and self.hand_in == "evaluate_program":
            then = f"evaluate_program with name={ranked[0]['name']}"
        elif ranked:
            then = f"read_diagram with name={ranked[0]['name']}, then {self.hand_in}"
        return {"ranked": ranked[:LISTED], "others": ", ".join(others), "next": then}

    def read_diagram(self, name: str | None = None, step: int | None = None) -> PlainData:
        """The text of a shipped diagram, with its comments, or of an evaluated step."""
        if (name is None) == (step is None):
            raise IbridError(
                "read_diagram takes the name of a shipped diagram or the number of a step; give one"
            )
        text = (
            textbook_text(name) if name is not None else self.steps.record(int(step or 0)).program
        )
        return {
            "program": text,
            "next": self.hand_in if name is not None else f"diagnose with step={step}",
        }

    def diagnose(
        self, step: int, count: int = RANKED, place: int = 1, ports: bool = False
    ) -> PlainData:
        """Edits of a step by what they explain; structures that were met before are left out."""
        record = self.steps.record(step)
        rankings = rankings_for(self.study)
        floor = rankings.screener.criterion.floor
        own = rankings.screener.screen_from_parent(
            CandidateEdit(record.diagram, "", "", {}),
            [record.parameters[name] for name in self.study.fitted.names],
            quick=True,
        )
        answer: PlainData = {
            "step": step,
            "step_error": floor.error_of(record),
            "step_screened": own.error,
            "noise_leaves": floor.level if floor.known else None,
            "errors_are": f"{_WEIGHTED if floor.known else 'NRMSE'}; {_SCREENED}",
        }
        with rankings.screener.time_slice(self.answer_within) as part:
            try:
                ranked = self.ranked(step, max(count, place))
            except TimeSliceOver:
                seen = sorted(
                    (one for one in part.fits if self._stands(one)), key=lambda look: look.score
                )
                return answer | _so_far(
                    part, [_told(one) for one in self._single(seen)[:count]], "diagnose"
                )
        if ports:
            answer["ports"] = [
                port_view(one)
                for one in rankings.locate_unknown_transfers(
                    Evaluated(step, record.diagram, record)
                )
            ]
        self._diagnosed[step] = ranked
        answer["ranked"] = [_told(look) for look in ranked[:count]]
        if not ranked:
            why = (
                "no edit that is new has a response near the values of this step; take another step"
            )
            return answer | {"why": why, "next": "list_best"}
        if own.error <= min(look.error for look in ranked):
            answer["nothing_gains"] = (
                "no edit leaves less than the step itself: what it misses is not among them"
            )
        program = (
            {"program": program_text(ranked[min(place, len(ranked)) - 1].edit.diagram)}
            if place
            else {}
        )
        use = (
            f"{self.hand_in} with the program, parent={step}"
            if place
            else "diagnose with a place, for its program"
        )
        return answer | program | {"next": f"{use}; or try_programs with ideas of your own"}

    def ranked(self, step: int, count: int) -> list[ScreeningFit]:
        """The first of the ranking of a step, each structure once.

        Raises TimeSliceOver in a slice that was not enough.
        """
        record = self.steps.record(step)
        parent = Evaluated(step, record.diagram, record)
        return self._single(rankings_for(self.study).best_edits(parent, self._new, TWICE * count))[
            :count
        ]

    def edit_at(self, step: int, place: int) -> CandidateEdit:
        """The edit at a place of the last diagnosis of a step, as that was told: what was evaluated
        since moves none.

        Raises IbridError where the step was not diagnosed to the end, or that has no such place.
        """
        ranked = self._diagnosed.get(step)
        if ranked is None:
            raise IbridError(
                f"step {step} is not diagnosed to the end; call diagnose with step={step} first"
            )
        if len(ranked) < place:
            raise IbridError(
                f"the diagnosis of step {step} ranks {len(ranked)} edits, found place {place}; "
                "take one of them, or diagnose "
                "with a larger count"
            )
        return ranked[place - 1].edit

    def _single(self, looks: Sequence[ScreeningFit]) -> list[ScreeningFit]:
        """The first look at each structure."""
        first: dict[str, ScreeningFit] = {}
        for look in looks:
            first.setdefault(self.study.hash_of(look.edit.diagram), look)
        return [*first.values()]

    def _stands(self, look: ScreeningFit) -> bool:
        return bool(look.values and look.edit.description) and self._new(look.edit.diagram)

    def try_programs(self, programs: Sequence[str], parent: int | None = None) -> PlainData:
        """A look at each; what is no legal program gets its reason instead."""
        if not 0 < len(programs) <= TRIED:
            raise IbridError(f"try_programs takes 1 to {TRIED} programs, found {len(programs)}")
        values = None
        if parent is not None:
            parameters = self.steps.record(parent).parameters
            values = [parameters[name] for name in self.study.fitted.names]
        screener, answers = rankings_for(self.study).screener, list[PlainData]()
        with screener.time_slice(self.answer_within) as part:
            for text in programs:
                try:
                    edit = CandidateEdit(self._legal(text), "", "", {})
                    look = (
                        screener.screen_from_scratch(edit)
                        if values is None
                        else screener.screen_from_parent(edit, values)
                    )
                except ProgramError as error:
                    answers.append({"refused": str(error)})
                    continue
                except TimeSliceOver:
                    part.begin_stage(programs[len(answers) :])
                    return _so_far(part, answers, "try_programs")
                answers.append({"name": edit.diagram.name} | _told(replace(look, edit=edit)))
        return {"looks": answers, "next": f"{self.hand_in} with the best"}

    def _legal(self, text: str) -> Diagram:
        diagram = parse_program(text)
        if found := examine(diagram, self.study.kinds, equilibrium=self.study.equilibrium)[0]:
            raise ProgramError(f"{found[0]}; check_grammar tells all of it")
        return diagram

    def _new(self, diagram: Diagram) -> bool:
        return (
            not self.study.examined(diagram, program_text(diagram)).violations
            and self.steps.met(diagram) is None
        )


def _entries(frequency: np.ndarray, matrix: np.ndarray) -> Iterator[PlainData]:
    for hertz, values in zip(frequency, matrix, strict=True):
        yield {"hz": float(hertz)} | {
            entry: polar(complex(values[place])) for entry, place in ENTRIES.items()
        }


def _sequences(point: PointSweep, chosen: np.ndarray, sweep: Sweep) -> Iterator[PlainData]:
    """Impedances by sequence; a negative frequency of the network is one of the other sequence."""
    seen = sequence_view(replace(sweep, points=(point,))).impedance[point.op.name]
    for k in chosen:
        above, below = sweep.f0_hz + point.frequency[k], sweep.f0_hz - point.frequency[k]
        yield {
            "hz": float(point.frequency[k]),
            f"positive, at {above:.4g} Hz": polar(complex(seen[k, 0])),
            f"negative, at {below:.4g} Hz": polar(complex(seen[k, 1])),
        }


#: What show_data shows: name -> rows.
_VIEWS: dict[str, Callable[[PointSweep, np.ndarray, Sweep], Iterator[PlainData]]] = {
    "Y": lambda point, chosen, _: _entries(point.frequency[chosen], point.admittance[chosen]),
    "Z": lambda point, chosen, _: _entries(
        point.frequency[chosen], -np.linalg.inv(point.admittance[chosen])
    ),
    "sequence": _sequences,
}


def _so_far(
    part: TimeSlice[ScreeningFit], looks: Sequence[Mapping[str, Any]], tool: str
) -> PlainData:
    """The answer of a slice that was not enough: no ranking yet, and how to go on."""
    return {
        "looks_so_far": list(looks),
        "not_yet_looked_at": f"{part.remaining} of the kind of edit under way"
        if tool == "diagnose"
        else str(part.remaining),
        "continue": f"{tool} again with the same arguments: it goes on from here, and ranks once "
        "all is looked at",
        "next": f"{tool} again with the same arguments",
    }


def _named(look: ScreeningFit) -> PlainData:
    """A look at a shipped diagram in plain data."""
    return {"name": look.edit.source, "error": look.error, "free": look.free}


def _told(look: ScreeningFit) -> PlainData:
    """A look in plain data; without a response it has no error."""
    told: PlainData = (
        {"edit": look.edit.description, "part": look.edit.source} if look.edit.description else {}
    )
    return told | {"error": look.error if look.values else None, "free": look.free}
