"""Settings: strict, frozen, and refusals that say where, what was expected and what came."""

from typing import Annotated, ClassVar, Literal

import pytest
from pydantic import Field, ValidationError

from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import OF_YOUR_OWN, Registry
from pa_ros.core.settings import OneOf, Settings


class Part(Settings):
    share: float = Field(0.5, ge=0, lt=1, description="of it, s")
    kind: Literal["a", "b"] = "a"
    pair: tuple[float, float] = (1.0, 2.0)


class Whole(Settings):
    SECTION: ClassVar[str] = "whole"
    part: Part = Part(share=0.25)
    name: Annotated[str, OneOf(lambda: ("x", "y"))] = "x"
    steps: int = Field(1, ge=1, le=9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"part.share": 1.5}, "whole.part.share: expected a number in [0, 1), got 1.5"),
        ({"part.share": True}, "whole.part.share: expected a number in [0, 1), got True"),
        ({"part.share": "0.5"}, "whole.part.share: expected a number in [0, 1), got '0.5'"),
        ({"part.kind": "c"}, "whole.part.kind: expected one of ['a', 'b'], got 'c'"),
        ({"part.pair": [1, 2, 3]}, "whole.part.pair: expected 2 numbers, got (1, 2, 3)"),
        ({"name": "z"}, "whole.name: expected one of ['x', 'y'], got 'z'"),
        ({"steps": 10}, "whole.steps: expected an integer in [1, 9], got 10"),
        ({"part": 3}, "whole.part: expected the settings of this part, got 3"),
        ({"qqq": 1}, "whole.qqq: unknown setting"),
        ({"part.kidn": 1}, "whole.part.kidn: unknown setting; did you mean 'whole.part.kind'?"),
        ({"share": 0.1}, "whole.share: unknown setting; did you mean 'whole.part.share'?"),
    ],
)
def test_a_refusal_names_the_path(changes, message) -> None:
    with pytest.raises(ConfigError) as refusal:
        Whole().changed(**changes)
    assert str(refusal.value) == message


def test_a_refusal_says_how_to_write_a_list_and_where_names_of_your_own_come_from() -> None:
    known: Registry[int] = Registry("arm")
    known.register("jaco", 1)

    class Chosen(Settings):
        several: tuple[Annotated[str, OneOf(lambda: known)], ...] = ()
        one: Annotated[str, OneOf(lambda: known)] = "jaco"

    for change, said in (
        ({"several": "jaco"}, "several: expected some of ['jaco'], got 'jaco', which is no list: "
         "write [jaco]"),
        ({"one": "ur5e"}, f"one: expected one of ['jaco'], got 'ur5e'{OF_YOUR_OWN}"),
        ({"one": "jack"}, "one: expected one of ['jaco'], got 'jack'; did you mean 'jaco'?"),
    ):  # fmt: skip
        with pytest.raises(ConfigError) as refusal:
            Chosen().changed(**change)
        assert str(refusal.value) == said


def test_an_int_passes_for_a_float_and_a_list_for_a_tuple() -> None:
    part = Part(share=0, pair=[3, 4])  # type: ignore[arg-type]
    assert (part.share, part.pair) == (0.0, (3.0, 4.0)) and isinstance(part.share, float)


def test_changed_leaves_the_rest_and_the_original() -> None:
    whole = Whole()
    other = whole.changed(**{"part.kind": "b", "steps": 2})
    assert (other.part.share, other.part.kind, other.steps) == (0.25, "b", 2)
    assert whole == Whole() and hash(whole) == hash(Whole()) and whole != other
    with pytest.raises(ValidationError):
        whole.steps = 3  # type: ignore[misc]


def test_leaves_tell_defaults_as_the_owner_has_them() -> None:
    leaves = {leaf.path: leaf for leaf in Whole.leaves()}
    assert list(leaves) == ["part.share", "part.kind", "part.pair", "name", "steps"]
    assert leaves["part.share"].default == 0.25
    assert leaves["part.share"].description == "of it, s"


def test_json_and_back() -> None:
    whole = Whole(steps=4)
    assert Whole.from_json(whole.to_json()) == whole
    assert Whole.from_json("{}") == Whole()
    for text in ("{", "3", '{"speed": 1}', '{"steps": NaN}'):
        with pytest.raises(ConfigError):
            Whole.from_json(text)


class Seeded(Settings):
    """With a number that has no bound of its own."""

    SECTION: ClassVar[str] = "seeded"
    seed: int = Field(0, ge=0, description="of anything")


def test_an_integer_is_one_that_messages_and_parameters_hold() -> None:
    assert Seeded(seed=2**63 - 1).seed == 2**63 - 1
    with pytest.raises(ConfigError, match="seed: expected an integer of 64 bits, got 18446744073"):
        Seeded(seed=2**64)
