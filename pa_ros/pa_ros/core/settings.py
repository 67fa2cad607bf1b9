"""Settings stated once: typed, bounded, described; whatever shows or sets them reads them here.

A component's settings are a subclass of `Settings`, its parts are fields that are `Settings`
themselves. Each leaf has a default, a description with its unit, and bounds:

    discount: float = Field(0.99, ge=0, lt=1, description="γ, per control step")

`leaves` tells them to command lines, ROS parameters, YAML files and tables.
"""

from __future__ import annotations

import difflib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails, core_schema
from pydantic_core import ValidationError as CoreError

from pa_ros.core.errors import ConfigError

NAMES: dict[Any, tuple[str, str]] = {  # of a type: one, several
    bool: ("true or false", "truth values"),
    int: ("an integer", "integers"),
    float: ("a number", "numbers"),
    str: ("text", "texts"),
    Path: ("a path", "paths"),
}


@dataclass(frozen=True)
class OneOf:
    """Metadata of a text field: it is one of these names, asked for when they are needed."""

    names: Callable[[], Iterable[str]]

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._known, handler(source))

    def _known(self, name: str) -> str:
        if name not in self.names():
            raise ValueError  # its text is the leaf's `expected`
        return name


@dataclass(frozen=True)
class Leaf:
    """One setting. Bounds are None where there are none; `choices` is empty where any will do."""

    path: str  # dotted, from the settings asked
    type: Any  # bool, int, float, str, Path, or a tuple of these
    default: Any  # `...` where a value must be given
    description: str
    minimum: float | None
    maximum: float | None
    above: bool  # the minimum itself is out
    below: bool  # the maximum itself is out
    choices: tuple[str, ...]

    @property
    def expected(self) -> str:
        """What a value must be, in words."""
        if self.choices:
            some = "some" if get_origin(self.type) is tuple else "one"
            return f"{some} of {list(self.choices)}"
        if get_origin(self.type) is tuple:
            items = get_args(self.type)
            several = _several(items[0])
            return f"a list of {several}" if ... in items else f"{len(items)} {several}"
        return _bounded(NAMES.get(self.type, (str(self.type), ""))[0], self)


def _several(item: Any) -> str:
    """Plural of a list's items, which are positive if they are bounded at all."""
    kind, *bounds = get_args(item) or (item,)
    return f"positive {NAMES[kind][1]}" if bounds else NAMES[kind][1]


def _bounded(noun: str, leaf: Leaf) -> str:
    low, high = leaf.minimum, leaf.maximum
    if low is not None and high is not None:
        return (
            f"{noun} in {'(' if leaf.above else '['}{low:g}, {high:g}{')' if leaf.below else ']'}"
        )
    if low is not None:
        if leaf.above:
            return "a positive number" if low == 0 else f"{noun} above {low:g}"
        return f"{noun} of at least {low:g}"
    return noun if high is None else f"{noun} of at most {high:g}"


class Settings(BaseModel):
    """Frozen and checked when made; types are strict, but an int passes for a float, a list for
    a tuple. ConfigError says which setting, what was expected and what came.

    Checks across fields are `model_validator(mode="after")`; they raise ValueError("NAME: expected
    …, got …"), or a ConfigError of their own.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )
    SECTION: ClassVar[str] = ""  # begins the path in errors

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(self._refusal(error, values)) from None

    # pydantic then makes parts without it, so that their errors carry the whole path.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """As ROS parameters and messages do: an integer has 64 bits."""
        for name, value in self:
            if type(value) is int and not -(2**63) <= value < 2**63:
                raise ValueError(f"{name}: expected an integer of 64 bits, got {value}")
        return self

    @model_validator(mode="before")
    @classmethod
    def _tuples(cls, values: Any) -> Any:
        if not isinstance(values, Mapping):
            return values
        return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}

    @classmethod
    def leaves(cls) -> Iterator[Leaf]:
        """Every setting, parts in order, with the default that it has here."""
        yield from _leaves(cls, None, "")

    @classmethod
    def paths(cls) -> tuple[str, ...]:
        """Dotted paths of the leaves."""
        return tuple(leaf.path for leaf in cls.leaves())

    @classmethod
    def leaf(cls, path: str) -> Leaf:
        """What is known of one setting; KeyError for a path that is none."""
        return {leaf.path: leaf for leaf in cls.leaves()}[path]

    @classmethod
    def read(cls, path: str, text: str) -> Any:
        """One setting's value from text; ValueError if the setting refuses it."""
        *parts, name = path.split(".")
        kind: Any = cls
        for part in parts:
            kind = kind.model_fields[part].annotation
        field = kind.model_fields[name]
        checked: Any = Annotated[field.annotation, field]
        return TypeAdapter(checked, config=ConfigDict(allow_inf_nan=False)).validate_strings(text)

    def fields(self) -> dict[str, Any]:
        """Values by name, parts as they are."""
        return {name: getattr(self, name) for name in type(self).model_fields}

    def flat(self) -> dict[str, Any]:
        """Values by dotted path."""
        return {path: self.value(path) for path in self.paths()}

    def value(self, path: str) -> Any:
        """The value at a dotted path of `paths`."""
        value: Any = self
        for name in path.split("."):
            value = getattr(value, name)
        return value

    def changed(self, **values: Any) -> Self:
        """A copy with other values by name or, as `**{"part.name": 1}`, by dotted path.

        It is checked as a whole. Raises ConfigError, also for a path that is none.
        """
        return type(self)(**_merged(self, values))

    def to_json(self) -> str:
        """Canonical JSON: keys sorted, no spaces."""
        return canonical_json(self.model_dump(mode="json"))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The inverse of `to_json`; what is absent keeps its default. ConfigError if it isn't."""
        try:
            return cls(**read_json(text))
        except (ValueError, TypeError) as error:
            raise ConfigError(
                f"{cls.SECTION or cls.__name__}: expected the JSON of settings: {error}: "
                f"got {text[:200]!r}"
            ) from error

    @classmethod
    def _refusal(cls, error: ValidationError | CoreError, values: Mapping[str, Any]) -> str:
        leaves = {leaf.path: leaf for leaf in cls.leaves()}
        found: ErrorDetails = error.errors()[0]
        path = ".".join(name for name in found["loc"] if isinstance(name, str))
        where = ".".join(filter(None, (cls.SECTION, path)))
        reason = str(found.get("ctx", {}).get("error", ""))
        if reason:  # of a check across fields
            return ".".join(filter(None, (where, reason)))
        if found["type"] == "extra_forbidden":
            return f"{where}: expected {_alternatives(path, leaves)}, got {found['input']!r}"
        expected = leaves[path].expected if path in leaves else "the settings of this part"
        if found["type"] == "missing" and isinstance(found["loc"][-1], str):
            return f"{where}: expected {expected}, got nothing"
        got = _given(values, path, found["input"])
        return f"{where}: expected {expected}, got {got!r}"


def read_json(text: str) -> Any:
    """What JSON says; ValueError if it isn't, is nested too deeply to be read, or has an integer
    that no float holds."""
    try:
        return json.loads(text, parse_int=_integer)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def _integer(text: str) -> int:
    value = int(text)
    if abs(value) > sys.float_info.max:
        raise ValueError(f"expected integers that a float holds, got {len(text)} digits")
    return value


def canonical_json(values: Any) -> str:
    """JSON with sorted keys and no spaces."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"))


def _leaves(kind: type[Settings], at: Settings | None, prefix: str) -> Iterator[Leaf]:
    for name, field in kind.model_fields.items():
        default = getattr(at, name) if at is not None else field.get_default()
        part = field.annotation
        if isinstance(part, type) and issubclass(part, Settings):
            inside = default if isinstance(default, part) else None
            yield from _leaves(part, inside, f"{prefix}{name}.")
            continue
        bound = {key: getattr(m, key) for m in field.metadata for key in ("ge", "gt", "le", "lt")
                 if getattr(m, key, None) is not None}  # fmt: skip
        told = [*field.metadata, *_of_items(part)]
        choices = [one for m in told if isinstance(m, OneOf) for one in m.names()]
        if get_origin(part) is Literal:
            choices, part = list(get_args(part)), str
        yield Leaf(
            prefix + name,
            part,
            ... if at is None and field.is_required() else default,
            field.description or "",
            bound.get("ge", bound.get("gt")),
            bound.get("le", bound.get("lt")),
            "gt" in bound,
            "lt" in bound,
            tuple(choices),
        )


def _of_items(part: Any) -> tuple[Any, ...]:
    """Metadata of a list's items."""
    items = get_args(part)[:1] if get_origin(part) is tuple else ()
    return tuple(m for item in items if get_origin(item) is Annotated for m in get_args(item)[1:])


def _merged(settings: Settings, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of `settings`, parts that change as dictionaries of the same kind."""
    values = settings.fields()
    parts: dict[str, dict[str, Any]] = {}
    for path, value in changes.items():
        name, dot, rest = path.partition(".")
        if dot:
            parts.setdefault(name, {})[rest] = value
        else:
            values[name] = value
    for name, part in parts.items():
        inside = values.get(name)
        values[name] = _merged(inside, part) if isinstance(inside, Settings) else part
    return values


def _given(values: Mapping[str, Any], path: str, otherwise: Any) -> Any:
    """What was given for a path; for an item of a list, the whole list."""
    value: Any = values
    for name in path.split("."):
        if isinstance(value, Settings):
            value = value.fields()
        if not isinstance(value, Mapping) or name not in value:
            return otherwise
        value = value[name]
    return value


def _alternatives(path: str, leaves: Mapping[str, Leaf]) -> str:
    """Known names near a path that is none, for an error."""
    name = path.rpartition(".")[2]
    same = [known for known in leaves if known.rpartition(".")[2] == name]
    near = same or difflib.get_close_matches(path, leaves, 3) or _beside(path, leaves)
    return f"a known name, such as {near[0]}" if len(near) == 1 else f"a known name of {near}"


def _beside(path: str, leaves: Mapping[str, Leaf]) -> list[str]:
    """All names of the part that a path leads to; the names of parts where it leads to none."""
    inside = path.rpartition(".")[0]
    while inside and not any(known.startswith(f"{inside}.") for known in leaves):
        inside = inside.rpartition(".")[0]
    depth = inside.count(".") + 1 if inside else 0
    near = [known.split(".") for known in leaves if not inside or known.startswith(f"{inside}.")]
    return sorted({".".join(names[: depth + 1]) for names in near})
