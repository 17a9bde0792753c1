"""The border of the package: what a public function is given is of the kind that its annotations
say, or a sentence says so.

Annotations leave much open, the entries of a sequence or a mapping, for instance. What fails of
that in the midst of the function, or of what it calls, leaves the package as an `UnforeseenError`
with the error itself as its cause.
"""

import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields
from functools import cache, wraps
from inspect import Parameter, Signature, isfunction, signature
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    Unpack,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

from ibrid.errors import AT_THE_PROMPT, IbridError, UnforeseenError, in_python, near
from ibrid.showing import made_above

P = ParamSpec("P")
T = TypeVar("T")

OWN_PACKAGES = ("ibrid", "ibrid_search", "ibrid_policy")
#: Characters of an unforeseen error that are told.
LONGEST = 200
#: Whether a public function is at work, which another calls.
_INSIDE: ContextVar[bool] = ContextVar("inside", default=False)

#: Classes that an argument of another kind is made into, by `ibrid.arguments.coercion`.
COERCED = ("Sweep", "Events", "Diagram", "Record")
#: Keywords that functions pass on -> their defaults, which whoever declares them adds here.
DEFAULTS: dict[Any, Mapping[str, Any]] = {}
#: How what somebody needs is made, by the name of its class.
_MADE_BY = {
    "Sweep": "ibrid.read_sweep(FILE)",
    "Events": "ibrid.read_events(FILE)",
    "Diagram": "ibrid.textbook(NAME) or ibrid.parse_program(TEXT)",
    "Record": "ibrid.evaluate(diagram, sweep) or ibrid.read_record(FILE)",
    "Study": "ibrid.Study(sweep)",
    "Generator": "numpy.random.default_rng(SEED)",
    "FitSettings": "ibrid.FitSettings()",
}
#: What a kind is called that is no class of a package.
_WORDS: Mapping[type, str] = {
    NoneType: "None",
    str: "text",
    PathLike: "a path",
    Real: "a number",
    Integral: "a whole number",
    Mapping: "a mapping",
    Iterable: "a sequence",
    Callable: "a function",  # type: ignore[dict-item]
}
#: What stands for what in an annotation.
_STANDS_FOR: Mapping[Any, type] = {
    float: Real,
    int: Integral,
    Path: PathLike,
    bool: object,
    Any: object,
}


def takes_kinds(function: Callable[P, T]) -> Callable[P, T]:
    """Let a public function refuse an argument of another kind than its annotation says.

    Sequences may be any iterable but text, and arrays of numbers any sequence or number. What an
    annotation leaves open, and further keywords, are up to the function.

    Raises IbridError that says what the argument must be, what it was and how it is made.
    """
    names = tuple(signature(function).parameters)
    unnamed = {
        one.name
        for one in signature(function).parameters.values()
        if one.kind is one.POSITIONAL_ONLY
    }
    called = function.__qualname__.rpartition("<locals>.")[2]
    passes_on = any(get_origin(hint) is Unpack for hint in function.__annotations__.values())
    required, takes_any = _required(function), _takes_any_keyword(function)

    @cache
    def kinds() -> dict[str, tuple[tuple[type, ...], type]]:
        hints = _hints(function)
        hints |= _options(hints)
        names = tuple(hints)
        known = {
            name: (_accepted(hints[name]), _element(hints[name])) for name in names if name in hints
        }
        return {
            name: (accepted, element)
            for name, (accepted, element) in known.items()
            if object not in accepted
        }

    @cache
    def options() -> tuple[str, ...]:
        return (*names, *_options(_hints(function)))

    @cache
    def accepted_at() -> tuple[tuple[type, ...], ...]:
        known = kinds()
        return tuple(known[name][0] if name in known else (object, str) for name in names)

    @wraps(function)
    def checked(*args: P.args, **keywords: P.kwargs) -> T:
        # in inner loops it is enough that arguments are of their kinds, whatever their entries are
        inside = _INSIDE.get() and len(required) <= len(args) and (takes_any or not keywords)
        if inside and all(_is_one(*one, object) for one in zip(args, accepted_at(), strict=False)):
            return function(*args, **keywords)
        known = kinds()
        if not takes_any and (strange := [name for name in keywords if name not in options()]):
            raise IbridError(
                f"{called}: has no option {strange[0]!r}; {near(strange[0], options())}"
            )
        if missing := [name for name in required[len(args) :] if name not in keywords]:
            raise IbridError(f"{called}: needs {' and '.join(missing)} too; see help({called})")
        said = {name: keywords.pop(name) for name in [*keywords] if takes_any and name not in names}
        with _border_of(called):
            given = list(args)
            for place, (name, value) in enumerate(zip(names, args, strict=False)):
                given[place] = _taken(called, name, value, known, said)
            named = {
                name: value if name in unnamed else _taken(called, name, value, known, said)
                for name, value in keywords.items()
            }
            return function(*given, **named, **said)  # type: ignore[arg-type]

    if passes_on:
        checked.__signature__ = _with_options(function)  # type: ignore[attr-defined]
    return checked


def _required(function: Callable) -> tuple[str, ...]:
    """Positional arguments without a default, in their order."""
    return tuple(
        one.name
        for one in signature(function).parameters.values()
        if one.default is one.empty and one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)
    )


def _takes_any_keyword(function: Callable) -> bool:
    """Whether keywords of any name may be given, as what a file does not say about itself."""
    return any(
        one.kind is one.VAR_KEYWORD and get_origin(one.annotation) is not Unpack
        for one in signature(function).parameters.values()
    )


def _taken(
    called: str,
    name: str,
    value: Any,
    known: Mapping[str, tuple[tuple[type, ...], type]],
    said: dict[str, Any],
) -> Any:
    """An argument as a function takes it; what stands for a sweep, events, a diagram or a record
    is made one.

    said : further keywords, emptied once a file or a table was read with them.

    Raises IbridError where nothing makes it one.
    """
    if name not in known or _is_one(value, *known[name]):
        return value
    wanted = [kind.__name__ for kind in known[name][0] if kind.__name__ in COERCED]
    if wanted and value is not None:
        made = made_above(value, "ibrid.arguments.coercion", "as_any_of", wanted, {**said})
        if made is not None:
            said.clear()
            return made
    raise IbridError(_refusal(called, name, value, *known[name]))


def _with_options(function: Callable) -> Signature:
    """The signature with the keywords that are passed on, each with its kind and default."""
    whole = signature(function)
    own = [one for one in whole.parameters.values() if one.kind is not one.VAR_KEYWORD]
    (hint,) = (one for one in function.__annotations__.values() if get_origin(one) is Unpack)
    declared = get_args(hint)[0]
    defaults = DEFAULTS.get(declared, {})
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=defaults.get(name, ...), annotation=kind)
        for name, kind in get_type_hints(declared).items()
    ]
    return whole.replace(parameters=[*own, *options])


def methods_take_kinds(made: type[T]) -> type[T]:
    """Let the public methods of a class, and `[...]`, take kinds as functions do, and its making
    raise errors of ours alone.
    """
    for name, member in [*vars(made).items()]:
        if isfunction(member) and (name == "__getitem__" or not name.startswith("_")):
            setattr(made, name, takes_kinds(member))
    make = made.__init__

    @wraps(make)
    def checked(self: T, *args: Any, **keywords: Any) -> None:
        if _INSIDE.get():
            make(self, *args, **keywords)
        else:
            with _border_of(made.__name__):
                make(self, *args, **keywords)

    made.__init__ = checked  # type: ignore[method-assign]
    return made


def require_kinds(made: Any) -> None:
    """Raise IbridError unless every field of a dataclass is of the kind that its annotation says;
    for `__post_init__`.
    """
    for name, accepted, element in _fields_of(type(made)):
        if not _is_one(value := getattr(made, name), accepted, element):
            raise IbridError(_refusal(type(made).__name__, name, value, accepted, element))


@cache
def _fields_of(made: type) -> tuple[tuple[str, tuple[type, ...], type], ...]:
    """Fields of a dataclass that are given: name, accepted kinds, kind of its entries."""
    hints = get_type_hints(made)
    known = [
        (one.name, _accepted(hints[one.name]), _element(hints[one.name]))
        for one in fields(made)
        if one.init
    ]
    return tuple(entry for entry in known if object not in entry[1])


@contextmanager
def _border_of(function: str) -> Iterator[None]:
    """Turn an unforeseen error of the outermost function into a sentence, and name arguments in
    place of options outside a command.

    Errors of the user's own code, of a call without an argument and of contract tests pass.
    """
    token = _INSIDE.set(True) if not _INSIDE.get() else None
    try:
        yield
    except IbridError as error:
        if token is not None and error.args and not AT_THE_PROMPT.get():
            error.args = (in_python(str(error.args[0])), *error.args[1:])
        raise
    except Exception as error:
        in_the_call = all(
            frame.f_code.co_filename == __file__
            for frame, _ in traceback.walk_tb(error.__traceback__)
        )
        if (
            token is None
            or isinstance(error, Warning | AssertionError)
            or in_the_call
            or _is_of_the_users(error)
        ):
            raise
        said = f"{type(error).__name__}: {str(error) or 'no further word'}"[:LONGEST]
        raise UnforeseenError(
            f"{function}: cannot be done with these arguments ({said}); compare them with "
            f"help({function}), and where they are "
            "right report the error that this one is from"
        ) from error
    finally:
        if token is not None:
            _INSIDE.reset(token)


def _is_of_the_users(error: Exception) -> bool:
    """Whether code that is neither of ours nor of a library took part, such as a device or a
    proposer of the user's.
    """
    for frame, _ in traceback.walk_tb(error.__traceback__):
        file, package = (
            frame.f_code.co_filename,
            frame.f_globals.get("__name__", "").partition(".")[0],
        )
        written = Path(file).is_absolute() or file.startswith(
            ("<ipython", "<stdin")
        )  # not compiled into a library
        if (
            written
            and package not in OWN_PACKAGES
            and not file.startswith((sys.prefix, sys.base_prefix))
        ):
            return True
    return False


def _hints(function: Any) -> dict[str, Any]:
    """Of the arguments alone: what a function returns may be of a package that is slow to
    import.
    """
    taken = {name: hint for name, hint in function.__annotations__.items() if name != "return"}
    return get_type_hints(type("Taken", (), {"__annotations__": taken}), function.__globals__)


def _accepted(annotation: Any) -> tuple[type, ...]:
    """The classes that satisfy an annotation; `object` among them where anything may."""
    origin = get_origin(annotation)
    if origin in (Union, UnionType):
        return tuple(kind for part in get_args(annotation) for kind in _accepted(part))
    if origin is Literal:
        return tuple({type(choice) for choice in get_args(annotation)})
    kind = _STANDS_FOR.get(annotation, origin or annotation)
    if not isinstance(kind, type) or is_typeddict(kind):
        return (object,)
    if kind in _WORDS:
        return (kind,)
    if _is_protocol(kind):
        return (object,)
    if kind.__module__ == "numpy":
        return (Iterable, Real)
    return (Iterable,) if kind.__module__ == "collections.abc" else (kind,)


def _element(annotation: Any) -> type:
    """The class of ours that a sequence is of; `object` where it is of anything else."""
    if get_origin(annotation) in (Union, UnionType):
        parts = [part for part in get_args(annotation) if part not in (str, NoneType)]
        return _element(parts[0]) if len(parts) == 1 else object
    inner = [
        part for part in get_args(annotation) if isinstance(part, type) and not _is_protocol(part)
    ]
    ours = inner[0].__module__.startswith("ibrid") if len(inner) == 1 else False
    return inner[0] if ours or inner == [str] else object


def _options(hints: Mapping[str, Any]) -> dict[str, Any]:
    """The annotations of the keywords that a function passes on (`**options: Unpack[...]`)."""
    declared = [get_args(hint)[0] for hint in hints.values() if get_origin(hint) is Unpack]
    return {name: hint for one in declared for name, hint in get_type_hints(one).items()}


def _is_protocol(kind: type) -> bool:
    """Whether it only says what something can do."""
    return getattr(kind, "_is_protocol", False)


def _is_one(value: Any, accepted: tuple[type, ...], element: type) -> bool:
    if isinstance(value, str):
        return str in accepted
    if not isinstance(value, accepted):
        return False
    return (
        element is object
        or not isinstance(value, list | tuple)
        or all(isinstance(one, element) for one in value)
    )


def _refusal(
    function: str, name: str, value: Any, accepted: tuple[type, ...], element: type
) -> str:
    words = dict.fromkeys(
        _WORDS.get(kind, f"{_article(kind.__name__)} {kind.__name__}") for kind in accepted
    )
    of = "" if element is object else f" of {element.__name__}"
    makers = [_MADE_BY[kind.__name__] for kind in (*accepted, element) if kind.__name__ in _MADE_BY]
    plain = isinstance(value, str | int | float | None)
    what = f"{value!r:.40}" if plain else f"{_article(type(value).__name__)} {type(value).__name__}"
    remedy = f"; make one with {makers[0]}" if makers else "; give one"
    return f"{function}: {name} must be {' or '.join(words)}{of}, found {what}{remedy}"


def _article(word: str) -> str:
    return "an" if word[0] in "AEIOaeio" else "a"
