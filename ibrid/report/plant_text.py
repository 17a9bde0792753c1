"""What `ibrid predict --port` prints of a plant, and the port file of the one device that stands for it."""

from ibrid.analysis.plant import Equivalent, PlantPrediction
from ibrid.report.numbers import number
from ibrid.report.text import listed, table


def format_plant(prediction: PlantPrediction) -> str:
    """Where each device works, and how far one device in place of all would be."""
    rows = []
    for name, rests in prediction.devices.items():
        for op, rest in rests.items():
            rows.append([name, op, *(number(one, 3) for one in (rest.p, rest.q, rest.v))])
    head = ["device", "at the plant's", "own p", "own q", "own v"]
    warned = ["", *listed("warnings", prediction.warnings)] if prediction.warnings else []
    return "\n".join([*table(head, rows, right=(2, 3, 4)), *warned, "", prediction.equivalent.sentence])


def equivalent_file(found: Equivalent) -> str:
    """TOML, per unit of the plant, as --port takes it."""
    lines = [f"# {found.sentence}", 'power_node = "outside"']
    for element in found.elements:
        numbers = [f"{name} = {value:.9g}" for name, value in element.values.items()]
        lines += ["", "[[element]]", f'kind = "{element.kind}"', *numbers, 'unit = "pu"']
    return "\n".join(lines) + "\n"
