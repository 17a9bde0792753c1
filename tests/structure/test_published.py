"""The published controls that ship: legal, at rest where they are asked, stable at typical values,
written anew the same.
"""

import numpy as np
import pytest
from collecting import collecting

from ibrid.assembly.equilibrium import equilibria
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numeric import closed_loop
from ibrid.modules import VOCABULARY
from ibrid.structure import (
    parameter_table,
    parse_program,
    program_text,
    published_names,
    published_values,
    structure_hash,
    textbook,
    textbook_names,
    textbook_text,
    violations,
    warnings,
    wire,
)
from ibrid.structure.reading.parameters import parameters_at

OMEGA_0 = 2 * np.pi * 60
POINTS = ((0.8, 0.1, 1.0), (0.5, -0.2, 1.0))
J = np.array([[0.0, -1.0], [1.0, 0.0]])


def values_of(name: str) -> dict[str, float]:
    table = parameter_table(wire(textbook(name), VOCABULARY), "exact")
    typical = {one.name: one.typical for one in table.free}
    assert published_values(name).keys() <= typical.keys()
    return typical | dict(published_values(name))


def poles_behind(name: str, point: tuple[float, float, float], ratio: float) -> np.ndarray:
    """Poles (n,) rad/s behind a grid of a short-circuit ratio, X/R = 10: v = (R + L s/omega_0 + L
    J) i, of i = C x.
    """
    wiring = wire(textbook(name), VOCABULARY)
    table = parameter_table(wiring, "exact")
    orders = {one: 3 for one, kind in wiring.kinds.items() if kind.delay}
    matrices = module_matrices(
        wiring,
        parameters_at(wiring, table, values_of(name)),
        point,
        equilibrium="exact",
        power_node="capacitor",
        omega_0=OMEGA_0,
        pade_orders=orders,
    )
    system = closed_loop(wiring, matrices)
    a, b, c = (np.asarray(one) for one in (system.A, system.B, system.C))
    assert not np.asarray(system.D).any()
    x = 1 / ratio / np.hypot(1, 0.1)
    v = np.linalg.solve(
        np.eye(2) - x / OMEGA_0 * c @ b, (0.1 * x * np.eye(2) + x * J) @ c + x / OMEGA_0 * c @ a
    )
    return np.linalg.eigvals(a + b @ v)


def test_about_twenty_controls_are_published_each_another_structure_with_its_source():
    names = (*textbook_names(), *published_names())
    assert len(published_names()) >= 20
    assert len({structure_hash(textbook(name)) for name in names}) == len(names)
    for name in published_names():
        doc = textbook_text(name).splitlines()[1]
        assert doc.strip().startswith('"""'), name


def test_published_controls_are_legal_without_a_warning_and_written_anew_the_same():
    with collecting() as failures:
        for name in published_names():
            with failures.case(name):
                diagram = textbook(name)
                assert violations(diagram) == ()
                assert warnings(diagram) == ()
                assert structure_hash(parse_program(program_text(diagram))) == structure_hash(
                    diagram
                )


@pytest.mark.slow
def test_published_controls_rest_at_their_operating_points_and_are_stable_behind_a_usual_grid():
    with collecting() as failures:
        for name in published_names():
            for point in POINTS:
                with failures.case(f"{name} at {point}"):
                    wiring = wire(textbook(name), VOCABULARY)
                    parameters = parameters_at(
                        wiring, parameter_table(wiring, "exact"), values_of(name)
                    )
                    frame, _ = equilibria(wiring, parameters, point, "capacitor", OMEGA_0)
                    assert abs(np.hypot(*frame) - 1) < 1e-12  # rounding
                    assert poles_behind(name, point, 5.0).real.max() < 0
