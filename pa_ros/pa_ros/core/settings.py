"""Settings: typed, bounded and described in one place, wherever they are shown or set.

A component's settings are a subclass of `Settings`; groups of settings are fields whose type is a
`Settings` too. Each setting (a leaf of this tree) has a default, a description with its unit, and
bounds:

    discount: float = Field(0.99, ge=0, lt=1, description="γ, per control step")

A setting has the same dotted name everywhere: `learner.updates.discount` is a nested ROS parameter,
an option of the command line (`--learner.updates.discount 0.95`), and a name in Python
(`settings.changed(**{"learner.updates.discount": 0.95})`).
"""

from __future__ import annotations

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
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails, core_schema
from pydantic_core import ValidationError as CoreError

from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import OF_YOUR_OWN, Registry
from pa_ros.core.text import did_you_mean

TYPE_NAMES: dict[Any, tuple[str, str]] = {  # one value, several values
    bool: ("true or false", "truth values"),
    int: ("an integer", "integers"),
    float: ("a number", "numbers"),
    str: ("text", "texts"),
    Path: ("a path", "paths"),
}


@dataclass(frozen=True)
class OneOf:
    """Metadata of a text field: the names it may have.

    `names` is called at each check, since extensions may register more names at any time.
    """

    names: Callable[[], Iterable[str]]
    or_empty: bool = False  # whether an empty text is accepted, too

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def _check(self, name: str) -> str:
        if name not in self.names() and (name or not self.or_empty):
            raise ValueError  # the message is made from the leaf's `expected`
        return name


@dataclass(frozen=True)
class Leaf:
    """One setting: its dotted path, its default and what is known of its values."""

    path: str
    field: FieldInfo
    default: Any  # `...` where a value must be given

    @property
    def type(self) -> Any:
        """bool, int, float, str, Path, or a tuple of these."""
        return str if get_origin(self.field.annotation) is Literal else self.field.annotation

    @property
    def is_list(self) -> bool:
        return get_origin(self.type) is tuple

    @property
    def description(self) -> str:
        return self.field.description or ""

    def bound(self, *kinds: str) -> float | None:
        """The bound of one of these kinds (ge, gt, le, lt); None if the setting has none."""
        found = (getattr(m, kind, None) for m in self.field.metadata for kind in kinds)
        return next((value for value in found if value is not None), None)

    @property
    def choices(self) -> tuple[str, ...]:
        """Names that a value, or each item of a list, may have; empty: any text."""
        if get_origin(self.field.annotation) is Literal:
            return get_args(self.field.annotation)
        metadata = [*self.field.metadata, *_item_metadata(self.field.annotation)]
        return tuple(name for m in metadata if isinstance(m, OneOf) for name in m.names())

    @property
    def expected(self) -> str:
        """The accepted values, in words."""
        if self.choices:
            return f"{'some' if self.is_list else 'one'} of {list(self.choices)}"
        if self.is_list:
            items = get_args(self.type)
            kind, *bounds = get_args(items[0]) or (items[0],)
            several = f"{'positive ' if bounds else ''}{TYPE_NAMES[kind][1]}"
            return f"a list of {several}" if ... in items else f"{len(items)} {several}"
        return self._bounded(TYPE_NAMES[self.type][0] if self.type in TYPE_NAMES else "a value")

    def _bounded(self, noun: str) -> str:
        low, high = self.bound("ge", "gt"), self.bound("le", "lt")
        if low is None:
            return noun if high is None else f"{noun} of at most {high:g}"
        above = self.bound("gt") is not None
        if high is not None:
            left, right = "(" if above else "[", ")" if self.bound("lt") is not None else "]"
            return f"{noun} in {left}{low:g}, {high:g}{right}"
        if above:
            return "a positive number" if low == 0 else f"{noun} above {low:g}"
        return f"{noun} of at least {low:g}"

    def read(self, text: str) -> Any:
        """The value that a text gives; ConfigError if the setting rejects it."""
        try:
            return self._adapter.validate_strings(text)
        except ValueError:
            raise ConfigError(f"{self.path}: {self.refusal(text, text or repr(text))}") from None

    def check(self, value: Any) -> None:
        """Raise ConfigError if the setting rejects a value."""
        try:
            self._adapter.validate_python(value, strict=True)
        except ValueError:
            raise ConfigError(f"{self.path}: {self.refusal(value, repr(value))}") from None

    @property
    def _adapter(self) -> TypeAdapter[Any]:
        # The bounds belong to the field and not to its type, so a bare type would accept any
        # number.
        checked: Any = Annotated[self.field.annotation, self.field]
        return TypeAdapter(checked, config=ConfigDict(allow_inf_nan=False))

    def refusal(self, given: Any, shown: str) -> str:
        """Why a value is rejected, in words."""
        hint = ""
        if isinstance(given, str) and self.is_list:
            hint = f", which is no list: write [{given}]"
        elif isinstance(given, str):
            hint = did_you_mean(given, self.choices) or self._of_your_own
        return f"expected {self.expected}, got {shown}{hint}"

    @property
    def _of_your_own(self) -> str:
        """What to do if the name is of an extension; empty if none can register names."""
        registered = (m.names() for m in self.field.metadata if isinstance(m, OneOf))
        return OF_YOUR_OWN if any(isinstance(names, Registry) for names in registered) else ""


class Settings(BaseModel):
    """Frozen settings, checked when they are made.

    Types are strict, except that an int is accepted for a float and a list for a tuple. Values may
    be given by dotted path: `Whole(**{"part.steps": 3})`. ConfigError says which setting, what was
    expected and what was given. Checks across fields are `model_validator(mode="after")`; they
    raise ValueError("NAME: expected …, got …").
    """

    # Frozen, because agent, learner and checkpoint share one object and compare it. Strict, so that
    # neither true nor "3" passes for a number.
    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )
    SECTION: ClassVar[str] = ""  # the path in errors begins with it

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(self._explain(error, values)) from None

    # Pydantic then makes parts without this __init__, so that their errors carry the whole path.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="before")
    @classmethod
    def _by_path(cls, values: Any) -> Any:
        """Accept dotted paths for parts, and lists for tuples."""
        if not isinstance(values, Mapping):
            return values
        return {k: tuple(v) if isinstance(v, list) else v for k, v in nested(values).items()}

    @model_validator(mode="after")
    def _integers_fit(self) -> Self:
        """ROS parameters and messages hold integers of 64 bits."""
        for name, value in self:
            if type(value) is int and not -(2**63) <= value < 2**63:
                raise ValueError(f"{name}: expected an integer of 64 bits, got {value}")
        return self

    @classmethod
    def leaves(cls) -> Iterator[Leaf]:
        """Every setting of the class, parts in order, with its default."""
        yield from _leaves(cls, None, "")

    @classmethod
    def leaf(cls, path: str) -> Leaf:
        """The setting at a dotted path; KeyError if there is none."""
        return {leaf.path: leaf for leaf in cls.leaves()}[path]

    def own_leaves(self) -> Iterator[Leaf]:
        """Every setting of this object, with its value as the default.

        Parts may be of subclasses that have more settings than the class declares.
        """
        yield from _leaves(type(self), self, "")

    def flat(self) -> dict[str, Any]:
        """Values by dotted path."""
        return {leaf.path: leaf.default for leaf in self.own_leaves()}

    def fields(self) -> dict[str, Any]:
        """Values by name, parts as they are."""
        return {name: getattr(self, name) for name in type(self).model_fields}

    def changed(self, **values: Any) -> Self:
        """A copy with other values, by name or dotted path: `**{"part.steps": 3}`.

        The copy is checked as a whole. Raises ConfigError, also for an unknown name.
        """
        return type(self)(**_merged(self, values))

    def to_json(self) -> str:
        """Canonical JSON: keys sorted, no spaces."""
        return canonical_json(self.model_dump(mode="json"))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The inverse of `to_json`; absent settings have their defaults. Raises ConfigError."""
        try:
            return cls(**read_json(text))
        except (ValueError, TypeError) as error:
            raise ConfigError(
                f"{cls.SECTION or cls.__name__}: expected the JSON of settings: {error}: "
                f"got {text[:200]!r}"
            ) from error

    @classmethod
    def _explain(cls, error: ValidationError | CoreError, values: Mapping[str, Any]) -> str:
        """One line for the first error that pydantic found."""
        leaves = {leaf.path: leaf for leaf in cls.leaves()}
        # People correct one setting at a time, and a log shows one line.
        found: ErrorDetails = error.errors()[0]
        path = ".".join(name for name in found["loc"] if isinstance(name, str))
        where = ".".join(filter(None, (cls.SECTION, path)))
        reason = str(found.get("ctx", {}).get("error", ""))
        if reason:  # from a check across fields
            return ".".join(filter(None, (where, reason)))
        if found["type"] == "extra_forbidden":
            known = [".".join(filter(None, (cls.SECTION, leaf))) for leaf in leaves]
            return f"{where}: unknown setting{did_you_mean(where, known)}"
        given, shown = found["input"], repr(found["input"])
        if found["type"] == "missing" and isinstance(found["loc"][-1], str):
            given, shown = None, "nothing"
        elif isinstance(found["loc"][-1], int):  # one item is wrong: show the whole list
            shown = repr(_value_at(values, path))
        if path not in leaves:
            return f"{where}: expected the settings of this part, got {shown}"
        return f"{where}: {leaves[path].refusal(given, shown)}"


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by name, where `part.x` became `{"part": {"x": …}}`. Parts may be dotted in turn."""
    found: dict[str, Any] = {}
    for path, value in values.items():
        name, _, rest = path.partition(".")
        if not rest:
            found[name] = value
            continue
        part = found.get(name, {})
        inside = part.fields() if isinstance(part, Settings) else dict(part)
        found[name] = inside | {rest: value}
    return found


def read_json(text: str) -> Any:
    """The value of a JSON text.

    ValueError if it is not JSON, is nested too deeply, or has an integer that no float holds.
    """
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
        default = field.get_default() if at is None else getattr(at, name)
        part = type(default) if isinstance(default, Settings) else field.annotation
        if isinstance(part, type) and issubclass(part, Settings):
            inside = default if isinstance(default, part) else None
            yield from _leaves(part, inside, f"{prefix}{name}.")
        else:
            required = at is None and field.is_required()
            yield Leaf(prefix + name, field, ... if required else default)


def _item_metadata(annotation: Any) -> tuple[Any, ...]:
    """Metadata of the items of a list's type."""
    items = get_args(annotation)[:1] if get_origin(annotation) is tuple else ()
    return tuple(m for item in items if get_origin(item) is Annotated for m in get_args(item)[1:])


def _value_at(values: Mapping[str, Any], path: str) -> Any:
    """The value that was given for a path."""
    value: Any = values
    for name in path.split("."):
        value = getattr(value, name) if isinstance(value, Settings) else nested(value)[name]
    return value


def _merged(settings: Settings, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of `settings` with changes; parts that change become mappings."""
    values = settings.fields()
    for name, change in nested(changes).items():
        part = values.get(name)
        if isinstance(part, Settings) and isinstance(change, Mapping):
            change = _merged(part, change)
        values[name] = change
    return values
