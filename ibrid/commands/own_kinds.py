"""`--kinds FILE.py`: kinds of one's own on the command line. The file is the user's own Python and
is executed, which is said.
"""

import importlib.util
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ibrid.errors import IbridError
from ibrid.streams import complain

if TYPE_CHECKING:
    from types import ModuleType

    from ibrid.modules.kind import ModuleKind
    from ibrid.modules.vocabulary import Vocabulary


def with_own_kinds(vocabulary: "Vocabulary", files: Sequence[str]) -> "Vocabulary":
    """A vocabulary and the kinds in some files, each executed once.

    Raises IbridError, one sentence, for a file that is not there, fails, brings no kind, one that
    breaks the contract of kinds, or one whose name is taken.
    """
    from ibrid.modules.contract import complaints_about

    for file in files:
        own = _kinds_in(file)
        taken = {kind.name for kind in vocabulary}
        for kind in own:
            if kind.name in taken:
                raise IbridError(
                    f"--kinds {file}: there is a kind {kind.name} already; give yours another name"
                )
            if complaints := complaints_about(kind):
                raise IbridError(f"--kinds {file}: {complaints[0]}")
        complain(f"executed {file}, which brings {', '.join(kind.name for kind in own)}")
        vocabulary = (*vocabulary, *own)
    return vocabulary


def _kinds_in(file: str) -> "tuple[ModuleKind, ...]":
    from ibrid.modules.kind import ModuleKind
    from ibrid.modules.vocabulary import VOCABULARY

    module = _executed(Path(file))
    kinds: list[ModuleKind] = []
    for value in vars(module).values():
        for kind in value if isinstance(value, list | tuple) else (value,):
            if not isinstance(kind, ModuleKind) or kind in kinds:
                continue
            if kind not in VOCABULARY or kind.state_space.__module__ == module.__name__:
                kinds.append(kind)  # no kind that ships, such as one that the file imports
    if not kinds:
        raise IbridError(
            f"--kinds {file}: no ModuleKind is made in it; assign one to a name, as in the page on "
            "own modules"
        )
    return tuple(kinds)


def _executed(path: Path) -> "ModuleType":
    """The file as a module that other processes of this run can import by its name."""
    if path.suffix != ".py" or not path.is_file():
        raise IbridError(f"--kinds {path} must be a Python file, FILE.py; found none there")
    name = path.stem
    if name in sys.modules and getattr(sys.modules[name], "__file__", None) != str(path.resolve()):
        raise IbridError(
            f"--kinds {path}: a module is called {name} already; give the file another name"
        )
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise IbridError(f"--kinds {path} cannot be read as Python; give a FILE.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.append(str(path.resolve().parent))
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # the user's own code: anything may go wrong in it
        del sys.modules[name]
        innermost_first = reversed(traceback.extract_tb(error.__traceback__))
        line = next(
            (
                f", line {one.lineno}"
                for one in innermost_first
                if one.filename == str(path.resolve())
            ),
            "",
        )
        raise IbridError(
            f"--kinds {path}{line}: it failed with {type(error).__name__}: "
            f"{' '.join(str(error).split())[:300]}; "
            f"mend it until `python {path}` runs"
        ) from error
    return module
