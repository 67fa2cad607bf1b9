"""Tables as CSV files: rows of frozen dataclasses, learning curves, and the setting beside them."""

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

RowT = TypeVar("RowT", bound="DataclassInstance")
FLOAT_FORMAT = ".6g"
CURVE = "progress.csv"  # a run's learning curve, in its folder
_READ: dict[type, Callable[[str], Any]] = {bool: lambda cell: bool(int(cell))}


class EvaluationError(PaError):
    """A table, a study or a cluster that cannot be used."""

    code = "evaluation.table"


def write_rows(path: Path, rows: Sequence[RowT]) -> None:
    """Write rows of one class under their fields' names; the file is whole or absent.

    Booleans are written as 0 and 1, floats to 6 digits.
    """
    names = [field.name for field in fields(rows[0])]
    write_cells(path, names, [astuple(row) for row in rows])


def write_cells(path: Path, names: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a table; the file is whole or absent."""
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([_cell(value) for value in row] for row in rows)
    write_whole(path, file.getvalue())


def read_rows(path: Path, kind: type[RowT]) -> list[RowT]:
    """Read what `write_rows` wrote. Raises EvaluationError for other columns or cells."""
    hints = get_type_hints(kind)
    columns = [(field.name, hints[field.name]) for field in fields(kind)]
    try:
        with path.open(newline="") as file:
            reader = csv.DictReader(file)
            names = [name for name, _ in columns]
            if reader.fieldnames != names:
                raise EvaluationError(f"{path}: expected columns {names}, got {reader.fieldnames}")
            return [
                kind(**{name: _READ.get(hint, hint)(cells[name]) for name, hint in columns})
                for cells in reader
            ]
    except (OSError, ValueError, TypeError) as error:
        raise EvaluationError(f"{path}: {error!r}") from error


def read_curve(path: Path) -> list[dict[str, float]]:
    """Rows of a learning curve, of one run or of several with a column `seed`.

    Raises EvaluationError for a file that is no learning curve.
    """
    try:
        with path.open(newline="") as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise EvaluationError(f"{path}: {error!r}", code="evaluation.curve") from error
    if rows and not {"frames", "train_greedy.normalized"} <= rows[0].keys():
        raise EvaluationError(
            f"{path}: expected columns frames and train_greedy.normalized, got {list(rows[0])}",
            code="evaluation.curve",
        )
    return rows


def read_curves(table: Path) -> dict[int, list[dict[str, float]]]:
    """The learning curves of a table by seed. Raises EvaluationError for a table without seeds."""
    by_seed: dict[int, list[dict[str, float]]] = {}
    for row in read_curve(table):
        by_seed.setdefault(int(row.get("seed", -1)), []).append(row)
    if not by_seed or -1 in by_seed:
        raise EvaluationError(f"{table}: expected learning curves with a column seed")
    return by_seed


def frames_done(curve: Path) -> float:
    """Frames that a run's learning curve has reached; 0 if there is no curve."""
    rows = read_curve(curve) if curve.exists() else []
    return rows[-1]["frames"] if rows else 0.0


def read_setting(table: Path, *needed: str) -> dict[str, Any]:
    """How a table was made, from the JSON file beside it.

    Raises EvaluationError unless it says all that is `needed`.
    """
    path = table.with_suffix(".json")
    try:
        setting = read_json(path.read_text())
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{path}: {error!r}") from error
    if isinstance(setting, dict) and "protocol" in setting:  # in older tables
        setting["recipe"] = setting.pop("protocol")
    if not isinstance(setting, dict) or not setting.keys() >= set(needed):
        got = sorted(setting) if isinstance(setting, dict) else type(setting).__name__
        raise EvaluationError(f"{path}: expected JSON with {sorted(needed)}, got {got}")
    return setting


def write_setting(table: Path, setting: Mapping[str, Any]) -> None:
    """Write how a table was made, as JSON beside it."""
    write_whole(table.with_suffix(".json"), json.dumps(setting, indent=1) + "\n")


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return format(value, FLOAT_FORMAT) if isinstance(value, float) else str(value)
