"""MATLAB's files: variables ``t``, ``q`` (T, n), ``tau``, …, also as fields of structures.

Versions 5 to 7 are read here, for SciPy's reader crashes on damaged ones; version 7.3, which is
HDF5, by h5py (extra ``mat``). A matrix with a joint in each row is turned. Objects (``timeseries``)
hold no plain numbers. Source: MathWorks, MAT-File Format (R2023a).
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.measured.logs.formats.base import (
    MOST_BYTES,
    MOST_VALUES,
    Arrays,
    ColumnFile,
    check_bytes,
    damaged,
)

HDF5 = b"\x89HDF\r\n\x1a\n"
"""How HDF5 begins, behind MATLAB's own 512 bytes. Source: its specification."""
MOST_JOINTS = 100  # shorter sides of matrices are joints; assumed
_COMPRESSED, _MATRIX, _STRUCT = 15, 14, 2
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4"}
_NUMBERS |= {9: "f8", 12: "i8", 13: "u8"}
"""Kinds of elements with numbers."""
_CLASSES = range(6, 16)
"""Classes of matrices of numbers."""
Matrix = np.ndarray[Any, Any]


class MatFile(ColumnFile):
    """File that MATLAB's ``save`` writes."""

    ends: ClassVar = (".mat",)

    def columns(self, where: str) -> Arrays:
        """Read the variables that hold numbers."""
        expected = "damaged or no MATLAB file: expected what MATLAB's save writes"
        with damaged(f"{where}: {expected}"):
            with open(where, "rb") as file:
                start = file.read(512 + len(HDF5))
            read = _hdf5 if HDF5 in (start[: len(HDF5)], start[512:]) else _version_5
            found = {}
            for name, x in read(where):
                upright = x.T if x.shape[0] < min(x.shape[1], MOST_JOINTS) else x
                found[name] = x.reshape(-1) if 1 in x.shape else upright
        if not found:
            raise StictionError(
                f"{where}: no matrices of numbers: expected t, q, tau; no objects (timeseries)"
            )
        if len({name.partition(".")[0] for name in found}) == 1:
            # one structure around all says nothing
            found = {name.partition(".")[2] or name: x for name, x in found.items()}
        return found


def _version_5(where: str) -> Iterator[tuple[str, Matrix]]:
    check_bytes(where, Path(where).stat().st_size, MOST_BYTES)
    data = Path(where).read_bytes()
    order = {b"IM": "<", b"MI": ">"}[data[126:128]]
    for kind, element in _elements(data[128:], order):
        if kind == _COMPRESSED:
            most = 8 * MOST_VALUES
            element = zlib.decompressobj().decompress(element, most)
            check_bytes(where, len(element) + 1, most)
            ((kind, element),) = _elements(element, order)
        if kind == _MATRIX:
            yield from _matrices("", element, order)


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each element, which begins at a multiple of 8 bytes."""
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start = at + 8
        if kind >> 16:  # a small one, within its tag
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        if start + size > len(data):
            raise ValueError("an element beyond the end")
        yield kind, data[start : start + size]
        at = start + size
        at += -at % 8 if kind != _COMPRESSED else 0


def _matrices(name: str, data: bytes, order: str) -> Iterator[tuple[str, Matrix]]:
    """Yield the matrices of numbers in a variable, those of its fields by their path."""
    parts = _elements(data, order)
    kind = next(parts)[1][0 if order == "<" else 3]
    if kind not in (_STRUCT, *_CLASSES):
        return
    shape = np.frombuffer(next(parts)[1], f"{order}i4")
    own = next(parts)[1].decode()
    name = f"{name}.{own}" if name and own else name or own
    if kind == _STRUCT:
        length = int(np.frombuffer(next(parts)[1], f"{order}i4")[0])
        names = next(parts)[1]
        fields = [names[i : i + length].partition(b"\0")[0] for i in range(0, len(names), length)]
        for field, (_, inner) in zip(fields, parts, strict=shape.prod() == 1):
            yield from _matrices(f"{name}.{field.decode()}", inner, order)
    elif len(shape) == 2:
        number, values = next(parts)
        yield name, np.frombuffer(values, order + _NUMBERS[number]).reshape(shape, order="F")


def _hdf5(where: str) -> Iterator[tuple[str, Matrix]]:
    try:
        import h5py  # here: an extra
    except ImportError:
        raise missing_extra(f"{where}: reading .mat of version 7.3", "h5py", "mat") from None
    found: dict[str, Any] = {}

    def note(name: str, item: Any) -> None:
        # what cells refer to is kept under #refs#; text is numbers of letters
        is_matrix = isinstance(item, h5py.Dataset) and item.ndim == 2 and item.dtype.kind in "fiu"
        if is_matrix and name[0] != "#" and item.attrs.get("MATLAB_class") != b"char":
            found[name.replace("/", ".")] = item

    with h5py.File(where, "r") as file:
        file.visititems(note)
        check_bytes(where, sum(int(item.nbytes) for item in found.values()), MOST_BYTES)
        yield from ((name, item[()].T) for name, item in found.items())
