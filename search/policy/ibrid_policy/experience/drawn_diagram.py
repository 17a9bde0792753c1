"""The block diagram of a choice of parts; a part has the same names in every diagram, so that two
can be compared.

Written without the moves of the other proposers: what the policy learns does not come from them.
"""

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid_policy.experience.choices import Choices


def drawn_diagram(choices: Choices, kinds: Vocabulary) -> Diagram:
    """The diagram of consistent choices, with kinds of this vocabulary: the naive start when there
    is no choice.
    """
    return _Drawing(choices, kinds).diagram()


class _Drawing:
    """Puts the parts together, from the plant outwards."""

    def __init__(self, choices: Choices, kinds: Vocabulary) -> None:
        self.choices, self.draft = choices, Draft(Diagram("build"), kinds)
        self.extended = any(kind.extended for kind in kinds)
        self.plant = choices.get("filter", "LFilter")
        self.lcl = self.plant.startswith("LCL")
        self.frequency = ""  # the port that carries it, once there is a frame
        self.draft.add(self.plant, "plant")

    def diagram(self) -> Diagram:
        self._command_path()
        self._current_loop()
        self._voltage_loop()
        self._outer_loops()
        self._frame()
        self._additions()
        if not self.regulated:
            self.draft.add("Gain_dq", "gain")
            self.draft.chain(self.terminal, "gain.in_", "gain.out", self.command)
        if "p" in self.choices and self.choices["p"] == "dc link":
            for source in self.draft.sources("plant.u_r"):
                self.draft.connect(source, "dc_link.u")
        return self.draft.diagram()

    @property
    def regulated(self) -> bool:
        """True when something but a gain of the terminal voltage drives the command."""
        return bool({"current", "voltage", "p", "q"} & set(self.choices))

    @property
    def terminal(self) -> str:
        return "park_v.v_dq" if "frame" in self.choices else "v_DQ"

    @property
    def measured(self) -> str:
        """The current that the controller measures."""
        return "plant.i_ti" if self.lcl and self.choices.get("current") != "grid" else "plant.i_g"

    @property
    def reference(self) -> str:
        return "current.in_" if "current" in self.choices else self.command

    def _path(self, source: str, kind: str, name: str) -> str:
        """The output of a new block behind a source."""
        self.draft.add(kind, name)
        self.draft.connect(source, f"{name}.in_")
        return f"{name}.out"

    def _command_path(self) -> None:
        self.command = "plant.u_r"
        if "delay" in self.choices:
            self.draft.add("Delay" if self.extended else "Pade1_dq", "delay")
            self.draft.connect("delay.out", "plant.u_r")
            self.command = "delay.in_"

    def _current_loop(self) -> None:
        self.looped = self.used = self.measured
        if "current" not in self.choices:
            return
        if "current filter" in self.choices:
            self.looped = self._path(self.measured, "LPF1_dq", "current_filter")
            self.used = self.looped if self.choices["current filter"] == "both" else self.measured
        kind = "Gain_dq" if self.choices["current"] == "proportional" else "PI_dq"
        self.draft.add(kind, "current")
        self.draft.connect(self._path(self.looped, "Negate_dq", "minus_i"), "current.in_")
        self.draft.connect("current.out", self.command)

    def _voltage_loop(self) -> None:
        if "voltage" not in self.choices:
            return
        self.draft.add("PI_dq", "voltage")
        self.draft.connect(self._path("plant.e", "Negate_dq", "minus_e"), "voltage.in_")
        self.draft.connect("voltage.out", "current.in_")

    def _power(self) -> None:
        if "power" not in self.draft.instances:
            self.draft.add("PQ_calc", "power")
            self.draft.chain("plant.e", "power.e", "plant.i_g", "power.i")

    def _filtered(self, name: str) -> str:
        """p or q as the loops see it."""
        self._power()
        source = f"power.{name}"
        return (
            self._path(source, "LPF1", f"{name}_filter")
            if "power filter" in self.choices
            else source
        )

    def _outer_loops(self) -> None:
        p, q = self.choices.get("p"), self.choices.get("q")
        if p is None and q is None:
            return
        axes: dict[str, str] = {}
        if p == "power":
            axes["in_d"] = self._path(
                self._path(self._filtered("p"), "Negate", "minus_p"), "PI", "p_loop"
            )
        elif p == "dc link":
            self.draft.add("DC_link", "dc_link")
            self.draft.connect(self.measured, "dc_link.i")
            axes["in_d"] = self._path("dc_link.v_dc", "PI", "dc_loop")
        if q == "power":
            axes["in_q"] = self._path(self._filtered("q"), "PI", "q_loop")
        elif q == "magnitude":
            size = self._path("plant.e", "Magnitude" if self.extended else "SliceD", "e_size")
            axes["in_q"] = self._path(size, "PI", "ac_loop")
        elif q is not None:
            self._power()
            source = (
                self._path("power.q", "LPF1", "q_filter") if q == "filtered droop" else "power.q"
            )
            axes.setdefault("in_d", self._path(source, "Gain", "q_droop"))
            if p is not None:  # both act on the d axis
                self.draft.add("PackDQ", "e_ref")
                self.draft.chain(
                    "q_droop.out",
                    "e_ref.in_d",
                    self._zero("no_e_q"),
                    "e_ref.in_q",
                    "e_ref.out",
                    self._outer,
                )
        pack = "reference"
        self.draft.add("PackDQ", pack)
        for axis in ("in_d", "in_q"):
            self.draft.connect(axes.get(axis) or self._zero("zero"), f"{pack}.{axis}")
        self.draft.connect(
            f"{pack}.out", self._outer if q and "droop" in q and p is None else self.reference
        )
        if "same gains" in self.choices:
            self.draft.bind("q_loop", kP="p_loop.kP", kI="p_loop.kI")
        if "same corners" in self.choices:
            self.draft.bind("q_filter", omega_c="p_filter.omega_c")

    @property
    def _outer(self) -> str:
        return "voltage.in_" if "voltage" in self.choices else self.reference

    def _zero(self, name: str) -> str:
        return f"{self.draft.add('ConstZero', name)}.out"

    def _frame(self) -> None:
        draft, frame = self.draft, self.choices.get("frame")
        if frame is None:
            draft.chain(
                "v_DQ",
                "plant.v_in",
                self._zero("no_frequency"),
                "plant.delta_omega",
                "plant.i_g",
                "i_DQ",
            )
            return
        self.frequency, angle = getattr(self, f"_by_{frame.split()[-1]}")()
        if not angle:
            angle = self._path(self.frequency, "Integrator", "angle")
        draft.add("Rot_v", "park_v")
        draft.add("Rot_i", "park_i")
        draft.chain("v_DQ", "park_v.v_DQ", angle, "park_v.delta", "park_v.v_dq", "plant.v_in")
        draft.chain("plant.i_g", "park_i.i_dq", angle, "park_i.delta", "park_i.i_DQ", "i_DQ")
        draft.connect(self.frequency, "plant.delta_omega")

    def _angle_error(self) -> str:
        kinds = {"low-pass": "LPF1", "notch": "Notch"}
        wanted = self.choices.get("pll filter")
        return (
            "plant.e_q" if wanted is None else self._path("plant.e_q", kinds[wanted], "pll_filter")
        )

    def _by_pll(self) -> tuple[str, str]:
        source = self._angle_error()
        self.draft.add("SRF_PLL", "pll")
        self.draft.connect(source, "pll.e_q")
        return "pll.delta_omega", "pll.delta"

    def _by_droop(self) -> tuple[str, str]:
        self._power()
        source = "power.p"
        if self.choices["frame"] == "filtered droop":
            source = self._path(source, "LPF1", "droop_corner")
        return self._path(source, "Gain", "p_droop"), ""

    def _by_machine(self) -> tuple[str, str]:
        self._power()
        frequency = self._path(self._path("power.p", "Gain", "p_gain"), "LPF1", "inertia")
        self.draft.add("PLL_frequency", "pll")
        self.draft.chain("plant.e", "pll.v", frequency, "pll.delta_omega")
        self.draft.connect(self._path("pll.delta_omega_pll", "Gain", "pll_damping"), "inertia.in_")
        return frequency, ""

    def _by_hybrid(self) -> tuple[str, str]:
        """A PLL and a droop add up."""
        by_droop, _ = self._by_droop()
        by_pll = self._path(self._angle_error(), "PI", "pll")
        self.draft.add("Integrator", "angle")
        for source in (by_droop, by_pll):
            self.draft.connect(source, "angle.in_")
            self.draft.connect(source, "plant.delta_omega")
        return by_pll, "angle.out"

    def _by_oscillator(self) -> tuple[str, str]:
        self.draft.add("dVOC", "oscillator")
        self.draft.chain("plant.e", "oscillator.v", "plant.i_g", "oscillator.i")
        return "oscillator.delta_omega", ""

    def _additions(self) -> None:
        draft, chosen = self.draft, self.choices
        if "feedforward" in chosen:
            kind = {"scaled": "Gain_dq", "filtered": "LPF1_dq"}.get(chosen["feedforward"])
            source = "plant.e" if kind is None else self._path("plant.e", kind, "feedforward")
            draft.connect(source, self.command)
        for part, source, name, target in (
            ("decoupling", self.used, "decoupling", self.command),
            ("voltage decoupling", "plant.e", "e_decoupling", "current.in_"),
        ):
            if part in chosen:
                draft.connect(self._coupling(chosen[part], source, name), target)
        if "damping" in chosen:
            self._damping(chosen["damping"])
        if "virtual impedance" in chosen:
            self._virtual_impedance(chosen["virtual impedance"])
        if "frequency droop" in chosen:
            source = "pll.delta_omega"
            if chosen["frequency droop"] == "filtered":
                source = self._path(source, "LPF1", "frequency_filter")
            draft.connect(self._path(source, "Gain", "frequency_droop"), "p_loop.in_")
        if "shunt" in chosen:
            draft.add("Shunt_RC", "shunt")
            draft.chain("v_DQ", "shunt.v", "shunt.i", "i_DQ")

    def _coupling(self, variant: str, source: str, name: str) -> str:
        measured = variant == "measured"
        found = self._path(source, "JMul_omega" if measured else "JMul", name)
        if measured:
            for port in self.draft.sources("plant.delta_omega"):
                self.draft.connect(port, f"{name}.delta_omega")
        return found

    def _damping(self, variant: str) -> None:
        source = "plant.i_C"
        if variant == "fast voltage":
            source = "plant.e"
            slow = self._path(
                self._path(source, "LPF1_dq", "damping_filter"), "Negate_dq", "minus_slow"
            )
        self.draft.connect(self._path(source, "Gain_dq", "damping"), self.command)
        if variant == "fast voltage":
            self.draft.connect(slow, "damping.in_")

    def _virtual_impedance(self, variant: str) -> None:
        drop = self._path("plant.i_g", "Negate_dq", "minus_i_g")
        target = self.command if variant == "command" else self._outer
        if variant != "reactance":
            self.draft.connect(self._path(drop, "Gain_dq", "virtual_resistance"), target)
        self.draft.connect(self._path(drop, "JMul", "virtual_reactance"), target)
