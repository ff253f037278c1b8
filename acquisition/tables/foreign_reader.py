"""A script that reads spreadsheets, .mat, NetCDF and Parquet files with other libraries, in a limited process.

These libraries have no limits of memory: a sheet with one cell in its last corner makes calamine reserve the whole
grid, a few bytes of .mat or HDF5 declare arrays of any size. The script limits itself, reads, and writes the
pickled result to stdout. It imports nothing of Seatrial, to start quickly.
"""

from __future__ import annotations

import errno
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

DAMAGED = "it is damaged, cut short, or of another kind than its name says"
CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
"""The calendars of CF-1.11, 4.4.1, that are ours."""
_EXIT_REFUSED = 3
_MAX_DEPTH = 32  # of nested groups: one that contains itself has no end


class RefusedError(ValueError):
    """The reason why a file is not read, in words for its user."""


class CellBudget:
    """The number of cells that a file may still have."""

    def __init__(self, allowance: int) -> None:
        self.remaining = allowance

    def count_cells(self, count: int) -> None:
        """Count cells. Raises RefusedError when there are too many."""
        self.remaining -= count
        if self.remaining < 0:
            raise RefusedError("it holds more cells than its budget; SEATRIAL_BUDGET=10 raises that tenfold")


def read_sheets(path: str, cells: CellBudget) -> dict[str, list[list[Any]]]:
    """The rows of all sheets by name."""
    import python_calamine

    book, rows = python_calamine.CalamineWorkbook.from_path(path), {}
    for name in book.sheet_names:
        sheet = book.get_sheet_by_name(name)
        cells.count_cells(sheet.total_height * sheet.total_width)
        rows[name] = sheet.to_python()
    return rows


def read_parquet(path: str, cells: CellBudget) -> Any:
    """The table, as Arrow has it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:  # pq.read_table imports pandas, which takes half a second
        metadata = file.metadata
        cells.count_cells(max(metadata.num_rows, 1) * max(metadata.num_columns, 1))
        table = file.read()
    for number, field in enumerate(table.schema):
        if pa.types.is_dictionary(
            field.type
        ):  # a long text of many rows would take its memory later, without limits
            decoded = field.with_type(field.type.value_type)
            table = table.set_column(number, decoded, table.column(number).cast(decoded.type))
        elif pa.types.is_decimal(field.type):  # a database's numbers
            number_type = field.with_type(pa.float64())
            table = table.set_column(number, number_type, table.column(number).cast(number_type.type))
    return table


def read_mat(path: str, cells: CellBudget) -> dict[str, Any]:
    """The variables of a MATLAB file of any version, as :func:`scipy.io.loadmat` returns them."""
    from scipy.io import loadmat

    try:
        variables: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        import h5py
        import numpy as np

        def value_of(item: Any, depth: int = 0) -> Any:
            if depth > _MAX_DEPTH:
                raise RefusedError("its groups hold each other")
            if isinstance(item, h5py.Group):
                return {name: value_of(member, depth + 1) for name, member in members_of_group(item)}
            values = dataset_values(item)
            if item.dtype == h5py.ref_dtype:
                members = [value_of(file[reference], depth + 1) for reference in np.ravel(values)]
                return members[0] if len(members) == 1 else np.array(members, dtype=object)
            if item.attrs.get("MATLAB_empty", 0):
                return ""
            values = np.squeeze(values.T)
            return "".join(map(chr, values.ravel())) if item.attrs.get("MATLAB_class") == b"char" else values

        with h5py.File(path) as file:
            variables = {name: value_of(item) for name, item in members_of_group(file)}
    _count_cells(variables, cells)
    return variables


def _count_cells(value: Any, cells: CellBudget) -> None:
    if isinstance(value, dict):
        for item in value.values():
            _count_cells(item, cells)
    else:
        cells.count_cells(int(getattr(value, "size", 1)))


def members_of_group(group: Any) -> Iterator[tuple[str, Any]]:
    """The members of a group. Raises RefusedError for a link to another file."""
    import h5py

    for name in group:
        if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
            raise RefusedError(f"its {name!r} is in another file; copy it into this one")
        yield name, group[name]


def dataset_values(dataset: Any) -> Any:
    """The values of a dataset. Raises RefusedError if they are in another file."""
    if dataset.is_virtual or dataset.external:
        raise RefusedError(f"the values of its {dataset.name!r} are in another file; copy them into this one")
    return dataset[()]


_DEFAULT_FILLS: dict[str, float] = {
    "f4": 9.969209968386869e36, "f8": 9.969209968386869e36, "i2": -32767, "i4": -2147483647, "u2": 65535,
    "u4": 4294967295, "i8": -9223372036854775806, "u8": 18446744073709551614,
}  # fmt: skip
"""What NetCDF's library fills in where nothing was written, by the type (netcdf.h); bytes have none."""


def unpack_values(values: Any, attributes: Mapping[str, Any], *, is_netcdf: bool = False) -> Any:
    """Values by the attributes of NetCDF (CF-1.11, 2.5 and 8): fill values are NaN, packed numbers unpacked."""
    import numpy as np

    if values.dtype.kind not in "iuf":
        return values
    if str(attributes.get("_Unsigned", "")).lower() == "true" and values.dtype.kind == "i":
        values = values.view(values.dtype.str.replace("i", "u"))
    stated = {key: _numbers_of_attribute(attributes[key]) for key in _UNPACKING if key in attributes}
    fills = [*stated.get("_FillValue", ()), *stated.get("missing_value", ())]
    if is_netcdf and "_FillValue" not in stated and values.dtype.str[1:] in _DEFAULT_FILLS:
        fills.append(_DEFAULT_FILLS[values.dtype.str[1:]])
    is_missing = np.isin(values, [_as_stored(values.dtype, fill) for fill in fills])
    scale = next(iter(stated.get("scale_factor", ())), 1)
    offset = next(iter(stated.get("add_offset", ())), 0)
    if (scale, offset) != (1, 0):
        values = values * float(scale) + float(offset)
    return np.where(is_missing, np.nan, values) if is_missing.any() else values  # whole numbers stay whole


_UNPACKING = ("_FillValue", "missing_value", "scale_factor", "add_offset")


def _as_stored(dtype: Any, fill: Any) -> Any:
    """A fill value as numbers of a type hold it: -999.9 in single precision, -1 in bytes without a sign.

    One that they cannot hold is NaN, which equals none of them.
    """
    import numpy as np

    with np.errstate(over="ignore", invalid="ignore"):
        stored = np.asarray(fill).astype(dtype)
    is_same = dtype.kind == "f" or stored == fill or np.asarray(fill).dtype.str[2:] == dtype.str[2:]
    return stored if is_same else np.nan


def _numbers_of_attribute(value: Any) -> list[Any]:
    """The numbers of an attribute, also where they are text; empty for what is none."""
    import numpy as np

    with suppress(ValueError, TypeError):
        return list(np.ravel(float(value) if isinstance(value, str) else np.asarray(value) + 0))
    return []


Variables = dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]
GROUPS = "/"
"""The name of an attribute, which no file has, for the names of a file's groups."""


def read_netcdf(path: str, cells: CellBudget) -> tuple[Variables, dict[str, Any]]:
    """Each variable's dimensions, values and attributes, and the file's attributes."""
    from scipy.io import netcdf_file

    with netcdf_file(path, mmap=False) as file:
        variables: Variables = {}
        for name, item in file.variables.items():
            values = item.data
            cells.count_cells(values.size)
            values, about = values.astype(values.dtype.newbyteorder("=")), readable_attributes(item._attributes)
            variables[name] = tuple(item.dimensions), unpack_values(values, about, is_netcdf=True), about
        return variables, readable_attributes(file._attributes)


def read_netcdf_4(path: str, cells: CellBudget) -> tuple[Variables, dict[str, Any]]:
    """As :func:`read_netcdf`, of a NetCDF-4 file, which is HDF5."""
    import h5py

    with h5py.File(path) as file:
        variables: Variables = {}
        groups = [name for name, item in members_of_group(file) if isinstance(item, h5py.Group)]
        for name, item in members_of_group(file):
            if isinstance(item, h5py.Dataset) and item.ndim:
                cells.count_cells(item.size)
                scales = [list(dimension.values()) for dimension in item.dims]
                dimensions = tuple(scale[0].name if scale else item.name for scale in scales)
                about = readable_attributes(item.attrs)
                variables[name] = dimensions, unpack_values(dataset_values(item), about, is_netcdf=True), about
        return variables, {**readable_attributes(file.attrs), GROUPS: groups}


def readable_attributes(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The attributes without those that refer to other parts of the file."""
    return {
        name: value.decode(errors="replace") if isinstance(value, bytes) else value
        for name, value in attributes.items()
        if name not in ("DIMENSION_LIST", "REFERENCE_LIST")
    }


READERS: dict[str, Callable[[str, CellBudget], Any]] = {
    "sheets": read_sheets,
    "parquet": read_parquet,
    "mat": read_mat,
    "netcdf": read_netcdf,
    "netcdf_4": read_netcdf_4,
}


def main(readers: Mapping[str, Callable[[str, CellBudget], Any]]) -> int:
    """Read one file by one of the ``readers`` under limits and write its content to stdout.

    Where the system has no limits of memory and time the budget of cells bounds it alone.
    """
    reader, path, memory_bytes, cpu_seconds, cells = sys.argv[1:]
    with suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for kind, limit in (
            (resource.RLIMIT_DATA, int(memory_bytes)),
            (resource.RLIMIT_FSIZE, int(memory_bytes)),  # of what a library unpacks beside
            (resource.RLIMIT_CPU, int(cpu_seconds)),
        ):
            hard_limit = resource.getrlimit(kind)[1]
            soft_limit = limit if hard_limit == resource.RLIM_INFINITY else min(limit, hard_limit)
            with suppress(ValueError):  # macOS takes no limit of data
                resource.setrlimit(kind, (soft_limit, hard_limit))

    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no part of the result
        try:
            pickle.dump(readers[reader](path, CellBudget(int(cells))), output, protocol=5)
            output.flush()
        except Exception as error:  # a damaged file makes these libraries fail in every possible way
            if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.EFBIG:
                return 1
            reason = DAMAGED
            if isinstance(error, ModuleNotFoundError):
                reason = f"it needs the package {error.name}, which an extra of seatrial brings"
            elif isinstance(error, RefusedError):
                reason = str(error)
            sys.stderr.write(reason)
            return _EXIT_REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(READERS))
