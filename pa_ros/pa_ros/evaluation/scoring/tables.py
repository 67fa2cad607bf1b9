"""Tables: frozen dataclasses of numbers and text as CSV, and back."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from pa_ros.core.errors import PaError
from pa_ros.core.files import write_whole
from pa_ros.core.settings import read_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    RowT = TypeVar("RowT", bound=DataclassInstance)
else:
    RowT = TypeVar("RowT")

FLOAT_FORMAT = ".6g"
_READ: dict[type, Callable[[str], Any]] = {bool: lambda cell: bool(int(cell))}


class TableError(PaError):
    """A file that is not the table it should be."""

    code = "evaluation.table"


def write_rows(path: Path, rows: Sequence[RowT]) -> None:
    """Write rows of one class under their fields' names; the file is whole or absent.

    Booleans are written as 0 and 1, floats to 6 digits.
    """
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(field.name for field in fields(rows[0]))
    writer.writerows([_cell(value) for value in astuple(row)] for row in rows)
    write_whole(path, file.getvalue())


def read_rows(path: Path, kind: type[RowT]) -> list[RowT]:
    """Rows that `write_rows` wrote; TableError if the file's columns or cells are not `kind`'s."""
    hints = get_type_hints(kind)
    columns = [(field.name, hints[field.name]) for field in fields(kind)]
    try:
        with path.open(newline="") as file:
            reader = csv.DictReader(file)
            names = [name for name, _ in columns]
            if reader.fieldnames != names:
                raise TableError(f"{path}: expected columns {names}, got {reader.fieldnames}")
            return [
                kind(**{name: _READ.get(hint, hint)(cells[name]) for name, hint in columns})
                for cells in reader
            ]
    except (OSError, ValueError, TypeError) as error:
        raise TableError(f"{path}: {error!r}") from error


def read_setting(table: Path, *needed: str) -> dict[str, Any]:
    """What a table was made of, by the JSON beside it.

    TableError unless that says all that is `needed`.
    """
    path = table.with_suffix(".json")
    try:
        setting = read_json(path.read_text())
    except (OSError, ValueError) as error:
        raise TableError(f"{path}: {error!r}") from error
    if not isinstance(setting, dict) or not setting.keys() >= set(needed):
        got = sorted(setting) if isinstance(setting, dict) else type(setting).__name__
        raise TableError(f"{path}: expected JSON with {sorted(needed)}, got {got}")
    return setting


def write_setting(table: Path, setting: Mapping[str, Any]) -> None:
    """What a table was made of, as JSON beside it."""
    write_whole(table.with_suffix(".json"), json.dumps(setting, indent=1) + "\n")


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return format(value, FLOAT_FORMAT) if isinstance(value, float) else str(value)
