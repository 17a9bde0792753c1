"""FMU 2.0 for co-simulation and model exchange: compiled code, its sources and a description, in one zip."""

import hashlib
import io
import uuid
import zipfile
from importlib.resources import files

from ibrid.analysis.linear_model import LinearModel
from ibrid.export.c_source import c_source
from ibrid.export.compiling import shared_library
from ibrid.export.model_description import IDENTIFIER, model_description

#: The earliest date a zip can hold; with today's, equal models would differ.
_DATE = (1980, 1, 1, 0, 0, 0)
_MAIN = "fmi2.c"


def fmu(model: LinearModel) -> bytes:
    """The file's content. Inputs v_D, v_Q and outputs i_D, i_Q are deviations; each state is a local variable.

    Co-simulation steps are exact for inputs that are held, or interpolated linearly; any communication step is allowed.
    Directional derivatives give A, B, C, D.

    Raises IbridError without a C compiler, or on a platform that FMI 2.0 has no name for.
    """
    inverter = c_source(model)
    wrapper = (files("ibrid.export") / "sources" / _MAIN).read_bytes()
    guid = str(uuid.UUID(bytes=hashlib.sha256(inverter + wrapper).digest()[:16]))
    sources = {"inverter.c": inverter, _MAIN: f'#define INVERTER_GUID "{guid}"\n'.encode() + wrapper}
    library = shared_library(sources, _MAIN)
    members = {
        "modelDescription.xml": model_description(model, guid, (_MAIN,)),
        f"binaries/{library.folder}/{IDENTIFIER}{library.suffix}": library.content,
        **{f"sources/{name}": content for name, content in sources.items()},
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, content)
    return stream.getvalue()
