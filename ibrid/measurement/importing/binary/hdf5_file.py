"""Arrays of an HDF5 file by their path: those of MATLAB 7.3 among them, and numbers as netCDF packs
them.
"""

import io
import re
from collections.abc import Iterator, Mapping
from posixpath import basename, dirname, join, normpath
from typing import Any

import numpy as np

from ibrid.measurement.importing.binary.foreign_binary import (
    is_unit,
    leaves,
    package,
    plain_text,
    with_unit,
)
from ibrid.measurement.importing.binary.hdf5_axes import in_rows_and_columns

#: How deep groups may lie in each other.
DEEPEST = 32
#: What netCDF says of packed numbers: they are value * scale_factor + add_offset, and missing where
#: the value is a mark.
_PACKED, _MISSING = ("scale_factor", "add_offset"), ("_FillValue", "missing_value")
#: How others call a factor of an array, or what is added to it, in small letters alone; and the
#: value with which each changes nothing.
_PERHAPS_PACKED: dict[str, float] = {
    **dict.fromkeys(("scale", "scaling", "scalefactor", "gain", "factor", "multiplier"), 1.0),
    **dict.fromkeys(("offset", "addoffset"), 0.0),
}
#: Bounds beyond which numbers are missing, by the count of them; and what says that whole numbers
#: have no sign.
_VALID, _UNSIGNED = {"valid_range": 2, "valid_min": 1, "valid_max": 1}, "_Unsigned"
#: Attributes of the formats themselves, which say nothing of the measurement.
_FORMATS = (
    *("MATLAB", "CLASS", "NAME", "DIMENSION_LABELS", "_Net", "_NC", "_nc3"),
    *(*_PACKED, *_MISSING, *_VALID, _UNSIGNED),
)
#: How the name of a dimension without numbers begins.
_DIMENSION = "This is a netCDF dimension but not a netCDF variable"
#: How MATLAB says that an array is the shape of an empty one, or the number under which it keeps an
#: object.
_NO_ARRAYS = {"MATLAB_empty", "MATLAB_object_decode"}
#: How the files of Julia begin, which has arrays with the first index running fastest.
_JULIA = (b"HDF5-based Julia Data Format", b"Julia data file (HDF5)")
#: How programs call the two parts of a complex number.
_PARTS = (("real", "imag"), ("re", "im"), ("r", "i"))


def hdf5_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Every array of numbers of an HDF5 file, MATLAB 7.3 among them, by its path; complex numbers
    as such, single texts.

    MATLAB and Julia keep arrays with the first index running fastest, so their arrays come
    transposed; text of MATLAB comes as codes. A unit among the attributes of an array goes into its
    name, other single attributes are arrays of their own. Numbers that netCDF packs are unpacked,
    missing ones NaN. Matrices have outputs before inputs, as the file calls their axes. A table is
    an array for each of its fields, also of text; cells and structures of MATLAB are as in
    `mat_arrays`.

    Raises ValueError for an array whose numbers lie in another file: this one would say what of the
    disk is read; and for one with a factor or an offset that is not netCDF's.
    """
    file = package("h5py").File(io.BytesIO(content), "r")
    items: dict[str, Any] = {"": file}

    def note(name: str, item: Any) -> None:
        if name.count("/") > DEEPEST:
            raise ValueError(f"its groups lie more than {DEEPEST} deep in each other")
        items[name] = item

    file.visititems(note)
    items |= _linked(file, items)
    arrays: dict[str, np.ndarray] = {}
    for name, item in items.items():
        if name.startswith("#"):
            continue
        path = name.replace("/", ".").strip(".")
        said = _single_attributes(item)
        if str(said.get("NAME", "")).startswith(_DIMENSION):
            continue
        unit = next((str(value) for key, value in said.items() if is_unit(key)), "")
        notes = {
            key: value
            for key, value in said.items()
            if not is_unit(key) and not key.startswith(_FORMATS)
        }
        arrays |= {f"{path}.{key}".strip("."): value for key, value in notes.items()}
        for element, value in _elements(path, item, content.startswith(_JULIA)):
            for field, column in _fields(element, value):
                arrays[with_unit(field, unit.replace(".", ""))] = column
    return arrays


def _elements(path: str, item: Any, of_julia: bool) -> Iterator[tuple[str, np.ndarray]]:
    """An array by its name, or as a field of each structure in an array of them; a group has
    none.
    """
    if not hasattr(item, "shape"):
        return
    value = _value(path, item)
    if value.dtype.kind == "O" and _in_matlab(item) and "MATLAB_class" not in item.attrs:
        structure, _, field = path.rpartition(".")
        yield from ((f"{structure}({k}).{field}", one) for k, one in enumerate(value.flat, 1))
    elif of_julia:
        yield path, value.T
    else:
        yield path, in_rows_and_columns(path, item, value)


def _in_matlab(item: Any) -> bool:
    """Whether MATLAB says of an array, or of the structure that it is a field of, what it is."""
    return "MATLAB_class" in item.attrs or "MATLAB_class" in item.parent.attrs


def _fields(path: str, value: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """The numbers and texts of an array by name: itself, or the fields of a table, of structures
    and of cells.
    """
    if value.dtype.names:
        for name in value.dtype.names:
            yield from _fields(f"{path}.{name}", _complex_numbers(value[name]))
    elif (
        value.dtype.kind in "SO"
        and value.size
        and all(isinstance(one, bytes) for one in value.flat)
    ):
        yield (
            path,
            np.array([one.decode(errors="replace") for one in value.flat], dtype=str).reshape(
                value.shape
            ),
        )
    else:
        yield from leaves({path: value})


def _linked(file: Any, items: Mapping[str, Any]) -> dict[str, Any]:
    """Arrays under the other names that soft links give them; ValueError for a link that leads out
    of the file, or nowhere.
    """
    h5py = package("h5py")
    links: dict[str, Any] = {}
    file.visititems_links(links.__setitem__)
    linked: dict[str, Any] = {}
    for name, link in links.items():
        if isinstance(link, h5py.ExternalLink):
            raise ValueError(
                f"{name} keeps its numbers in another file, which is not opened; write them into "
                "this one"
            )
        if isinstance(link, h5py.SoftLink):
            target = normpath(join("/", dirname(name), link.path)).strip("/")
            if target not in items:
                raise ValueError(
                    f"{name} is a link to {target}, which is not there; write its numbers in its "
                    "place"
                )
            if hasattr(items[target], "shape") and basename(name) != basename(target):
                linked[name] = items[target]
    return linked


def _single_attributes(item: Any) -> dict[str, np.ndarray]:
    """Attributes that are a single number or text, also in an array; not references, of which
    dimension scales are made.
    """
    single = {
        key: plain_text(np.ravel(value)[0])
        for key, value in item.attrs.items()
        if np.size(value) == 1
    }
    return {key: value for key, value in single.items() if value.dtype.kind in "biufcU"}


def _value(path: str, item: Any, depth: int = 0) -> np.ndarray:
    """The numbers or the text of a data set, or the cells of MATLAB, which lie `depth` deep in
    others; objects for others.
    """
    if item.is_virtual and all(source.file_name == "." for source in item.virtual_sources()):
        raise ValueError(
            f"{path} is put together of other arrays, which is not done here; write its own numbers"
        )
    if item.external or item.is_virtual:
        raise ValueError(
            f"{path} keeps its numbers in another file, which is not opened; write them into this "
            "one"
        )
    matlab = bytes(item.attrs.get("MATLAB_class", b""))
    if _NO_ARRAYS & item.attrs.keys():
        return np.zeros(0, object)
    value = _complex_numbers(np.asarray(item[()]))
    if _in_matlab(item) and package("h5py").check_ref_dtype(item.dtype):
        value = _referred(path, value, item.file, depth)
    if matlab:
        value = value.T
    if matlab == b"char":
        value = np.array("".join(chr(int(code)) for code in value.ravel(order="F")))
    if value.size == 1 and value.dtype.kind in "OS":
        value = plain_text(value.ravel()[0])
    _require_no_other_packing(path, value, item.attrs)
    return _unpacked(path, value, item.attrs)


def _complex_numbers(value: np.ndarray) -> np.ndarray:
    """Pairs of their parts as complex numbers; any other array as it is."""
    for real, imaginary in _PARTS:
        if {real, imaginary} == set(value.dtype.names or ()):
            return value[real] + 1j * value[imaginary]
    return value


def _referred(path: str, references: np.ndarray, file: Any, depth: int) -> np.ndarray:
    """What MATLAB keeps in cells, or in the elements of a field of its structures."""
    cells = np.empty(references.shape, dtype=object)
    for place, reference in np.ndenumerate(references):
        cells[place] = _held(path, file[reference], depth + 1)
    return cells


def _held(path: str, item: Any, depth: int) -> np.ndarray:
    """The array in a cell; a structure in it as SciPy has one, an element with its fields.

    ValueError where they lie too deep.
    """
    if depth > DEEPEST:
        raise ValueError(f"{path} has cells more than {DEEPEST} deep in each other")
    if hasattr(item, "shape"):
        return _value(path, item, depth)
    structure = np.empty(1, dtype=[(name, object) for name in item])
    for name, inner in item.items():
        structure[name][0] = _held(path, inner, depth + 1)
    return structure


def _unpacked(path: str, value: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray:
    """What packed numbers are; NaN where they are missing, marked so or beyond the bounds that the
    file gives.

    References
    ----------
    NetCDF Users Guide, appendix A, attribute conventions.
    """
    said = {
        key: np.ravel(attributes[key])
        for key in (*_PACKED, *_MISSING, *_VALID)
        if key in attributes
    }
    unsigned = value.dtype.kind == "i" and _says_true(attributes.get(_UNSIGNED, "false"))
    if value.dtype.kind not in "iufc" or not (said or unsigned):
        return value
    for key, count in {**dict.fromkeys(_PACKED, 1), **_VALID}.items():
        if key in said and (len(said[key]) != count or said[key].dtype.kind not in "iuf"):
            must = "a single number" if count == 1 else "two numbers"
            raise ValueError(f"{key} of {path} is not {must}; unpack it before")
    if unsigned:
        value = value.view(f"u{value.dtype.itemsize}")
        said = {
            key: held.astype(value.dtype) if held.dtype.kind == "i" else held
            for key, held in said.items()
        }
    factor, offset = (said.get(key, [plain])[0] for key, plain in zip(_PACKED, (1, 0), strict=True))
    numbers = value * factor + offset if said.keys() & {*_PACKED} else value
    missing = _beyond(path, value, numbers, said)
    for key in _MISSING:
        if key in said and said[key].dtype.kind in "iuf":
            marks = said[key].astype(value.dtype) if value.dtype.kind == "f" else said[key]
            missing |= np.isin(value, marks)
    return np.where(missing, np.nan, numbers) if missing.any() else numbers


def _require_no_other_packing(path: str, value: np.ndarray, attributes: Mapping[str, Any]) -> None:
    """Raise ValueError where an attribute of an array may be a factor of its numbers, or be added
    to them, but no convention says so.
    """
    if value.size < 2 or value.dtype.kind not in "iufcV":
        return
    for key in attributes:
        changes_nothing = _PERHAPS_PACKED.get(re.sub(r"[\W_]", "", key.lower()))
        if changes_nothing is None or key in _PACKED:
            continue
        held = np.ravel(attributes[key])
        if held.dtype.kind not in "iufc" or (held == changes_nothing).all():
            continue
        packed = _PACKED[0] if changes_nothing else _PACKED[1]
        raise ValueError(
            f"{path} has an attribute {key} = {held[0]:g}, which may still have to be applied to "
            f"its numbers; call it {packed}, as netCDF does, if so, or leave it out"
        )


def _says_true(said: Any) -> bool:
    return str(plain_text(np.ravel(said)[0])).lower() == "true"


def _beyond(
    path: str, value: np.ndarray, numbers: np.ndarray, said: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Where numbers are beyond their bounds: those of the packed ones, but for broken bounds of
    whole numbers.
    """
    beyond = np.zeros(value.shape, dtype=bool)
    for key in said.keys() & _VALID.keys():
        if value.dtype.kind == "c":
            raise ValueError(
                f"{key} of {path} bounds complex numbers, which have no order; leave it out"
            )
        bounded = numbers if value.dtype.kind != "f" and said[key].dtype.kind == "f" else value
        beyond |= bounded < (-np.inf if key == "valid_max" else said[key][0])
        beyond |= bounded > (np.inf if key == "valid_min" else said[key][-1])
    return beyond
