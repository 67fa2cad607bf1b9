"""Fuzzing: messages with changed fields, wrong YAML, and the runner of hypothesis cases.

`make test` checks a small, fixed share of the cases; `make fuzz` checks all (PA_ROS_FUZZ=1).
"""

import array
import copy
import functools
import math
import os
import re
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

Path = tuple[str | int, ...]
BITS = {"octet": 8, "uint8": 8, "int32": 32, "uint32": 32, "int64": 64, "uint64": 64}
FLOATS = {"float": "f", "double": "d"}
ODD_FLOATS = (0.0, -0.0, 1.0, -1.0, 2.0, 3e38, 1e300, 1e-45, math.nan, math.inf, -math.inf)
ODD_TEXTS = ("", "x", "[" * 3000, "[" * 200_000, "{}", "null", "[1]", '{"a": 1e999}', "é" * 300,
             "NEAR(HAND, RED)", "-1", "\n", "NaN", "../..", "a" * 70_000)  # fmt: skip


def damaged(message: Any) -> st.SearchStrategy[Any]:
    """Copies of a message with one to three of its fields changed."""
    places = list(_places(message))
    edits = st.sampled_from(places).flatmap(
        lambda place: st.tuples(st.just(place[0]), _others(place[1], _at(message, place[0])))
    )
    return st.lists(edits, min_size=1, max_size=3).map(lambda made: _changed(message, made))


def _places(message: Any, within: Path = ()) -> Iterator[tuple[Path, str]]:
    """(path, type) of every field, including those of nested messages."""
    for name, kind in message.get_fields_and_field_types().items():
        path, value = (*within, name), getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            yield from _places(value, path)
            continue
        yield path, kind
        if isinstance(value, list) and value and hasattr(value[0], "get_fields_and_field_types"):
            for index, item in enumerate(value):
                yield from _places(item, (*path, index))


def _at(message: Any, path: Path) -> Any:
    return functools.reduce(
        lambda at, key: at[key] if isinstance(key, int) else getattr(at, key), path, message
    )


def _changed(message: Any, edits: list[tuple[Path, Any]]) -> Any:
    changed = copy.deepcopy(message)
    for (*path, name), value in edits:
        try:
            setattr(_at(changed, tuple(path)), str(name), copy.deepcopy(value))
        except IndexError:  # The previous edit removed this item.
            continue
    return changed


def _others(kind: str, value: Any) -> st.SearchStrategy[Any]:
    """Other values of a field's type."""
    if found := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>|(\w+)\[(\d+)\]", kind):
        inner, most = found[1] or found[3], int(found[2] or 1 << 30)
        if found[4]:
            return _filled(inner, int(found[4])).map(lambda x: np.array(x, dtype=value.dtype))
        return _sequences(inner, value).map(lambda x: x[:most])
    if kind == "boolean":
        return st.booleans()
    if kind == "octet":
        return st.binary(min_size=1, max_size=1)
    return _filled(kind, 1).map(lambda values: values[0])


def _filled(kind: str, count: int) -> st.SearchStrategy[list[Any]]:
    return st.lists(_scalars(kind), min_size=count, max_size=count)


def _scalars(kind: str) -> st.SearchStrategy[Any]:
    if kind in FLOATS:
        wide = kind == "double"
        odd = ODD_FLOATS if wide else tuple(x for x in ODD_FLOATS if x != 1e300)
        return st.sampled_from([float(np.float32(x)) if not wide else x for x in odd]) | st.floats(
            width=64 if wide else 32
        )
    if kind in BITS:
        low, high = (0, 2 ** BITS[kind] - 1)
        if kind.startswith("int"):
            low, high = -(2 ** (BITS[kind] - 1)), 2 ** (BITS[kind] - 1) - 1
        edges = [x for x in (0, 1, 2, 65, 10_001, high - 1, high, low) if x <= high]
        return st.sampled_from(edges) | st.integers(low, high)
    assert kind == "string", kind
    legal = st.characters(exclude_categories=["Cs"], exclude_characters="\0")
    return st.sampled_from(ODD_TEXTS) | st.text(legal, max_size=20)


def _sequences(inner: str, value: Any) -> st.SearchStrategy[Any]:
    """Shorter, longer, in another order, or with one item changed."""
    kept = list(value)
    shapes = [
        st.just([]),
        st.integers(0, max(len(kept) - 1, 0)).map(lambda n: kept[:n]),
        st.integers(1, 70).map(lambda n: (kept * n)[: len(kept) + n] if kept else kept),
        st.just(kept[::-1]),
    ]
    if "/" not in inner:
        poked = st.tuples(st.integers(0, max(len(kept) - 1, 0)), _scalars(inner))
        shapes.append(poked.map(lambda p: [*kept[: p[0]], p[1], *kept[p[0] + 1 :]]))
        shapes.append(st.lists(_scalars(inner), max_size=70))
    several = st.one_of(shapes)
    if isinstance(value, array.array):
        return several.map(lambda items: array.array(value.typecode, items))
    return several


SHARE = float(os.environ.get("PA_ROS_FUZZ", "0.001"))
FEWEST, PART = 50, 2_000
Case = TypeVar("Case")


def explore(cases: st.SearchStrategy[Case], check: Callable[[Case], object], whole: int) -> int:
    """Check our share of `whole` cases, in parts so that a million fit in memory; their number."""
    wanted, looked = max(FEWEST, round(whole * SHARE)), 0

    def look(case: Any) -> None:
        nonlocal looked
        looked += 1
        check(case)

    for number, size in enumerate(_parts(wanted)):
        within = settings(
            max_examples=size, deadline=None, database=None, suppress_health_check=list(HealthCheck)
        )
        seed(number)(within(given(cases)(look)))()
    assert looked >= min(wanted, FEWEST), "hypothesis found fewer cases than expected"
    return looked


def _parts(wanted: int) -> Iterator[int]:
    for begun in range(0, wanted, PART):
        yield min(PART, wanted - begun)


# YAML that is wrong in its syntax, in its values, or in its references.
WRONG_YAML = {
    "syntax": "a: [",
    "date": "seed: 2024-13-01",
    "nested": "[" * 3000,
    "digits": f"seed: {'1' * 5000}",
    "no integer": "a: !!int abc",
    "no truth": "a: !!bool maybe",
    "no number": "a: !!float abc",
    "no time": "a: !!timestamp x",
    "an object": "a: !!python/object:os.system {}",
    "no key": "? [a]\n: 1\n? {a: 1}\n: 2",
}
