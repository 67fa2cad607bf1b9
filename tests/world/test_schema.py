"""Object schemas and worlds: sizes, true words, JSON, limits."""

import numpy as np
import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.language import Vocabulary
from pa_ros.language.vocabulary import WordGroup
from pa_ros.world.schema import PAPER, ObjectSchema, PropertyGroup, Real, Seen
from pa_ros.world.world import World

SIZE = PropertyGroup(
    "size", ("SMALL", "LARGE", "D"), Real(("m",), {"SMALL": (0.04,), "LARGE": (0.08,)}, 0.01, 50.0)
)
SIZED = ObjectSchema((*PAPER.groups, SIZE))


def test_a_schema_can_have_a_group_of_numbers() -> None:
    assert PAPER.width == 16 and PAPER.slices == {"shape": slice(7, 11), "color": slice(11, 16)}
    assert SIZED.feature_names[16:] == ("size_m",) and SIZED.slices["size"] == slice(16, 17)
    row = SIZED.features({"shape": "CUBE", "color": "BLUE", "size": "LARGE"})
    assert row[16] == np.float32(0.08) and set(np.flatnonzero(row)) == {7, 13, 16}


def test_words_are_true_within_the_tolerance() -> None:
    row = SIZED.features({"shape": "CUBE", "color": "BLUE", "size": "SMALL"})
    scene = np.stack([row, row, np.zeros_like(row)])
    scene[:2, 16] = 0.049, 0.06  # within the tolerance of 0.01, and between the two sizes
    words = Vocabulary.of(shape=("CUBE", "C"), color=("RED", "BLUE"), size=("SMALL", "LARGE", "X"))
    truth = World(SIZED, words, joints=6).truth(scene[None])
    assert truth.shape == (1, 3, 7) and truth.dtype == np.float32
    named = [{w for w, true in zip(words.words, one, strict=True) if true} for one in truth[0]]
    assert named == [{"CUBE", "BLUE", "SMALL"}, {"CUBE", "BLUE"}, set()]
    shapes, _ = PAPER.has(np.eye(16)[7] / 2)  # half a cube is just near enough
    assert shapes.tolist() == [True, False, False, False]


def test_networks_get_numbers_times_their_scale_and_all_else_as_it_is() -> None:
    assert SIZED.scales.tolist() == [1.0] * 16 + [50.0]
    assert Real(("m",), {"SMALL": (0.04,)}, 0.01).scale == 1.0


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"shape": "CUBE", "color": "PINK"}, "group color: expected a value of .*, got 'PINK'"),
        ({"shape": "CUBE"}, "group color: expected a value of .*, got ''"),
        (
            {"weight": "HEAVY"},
            r"unknown property group: expected one of \['shape', 'color'\], got 'weight'",
        ),
    ],
)
def test_unknown_values_are_rejected(values: dict[str, str], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        PAPER.features(values)


def group(words: tuple[str, ...] = ("A",), name: str = "g", **changed: object) -> PropertyGroup:
    given = {"features": ("x",), "of": {"A": (0.0,), "B": (1.0,)}, "tolerance": 0.1} | changed
    return PropertyGroup(name, words, Real(**given))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"tolerance": 0.5}, "more than twice the tolerance 0.5 apart, got A .* and B"),
        ({"scale": float("inf")}, "positive tolerance and scale"),
        ({"of": {"A": (0.0, 1.0)}}, r"group g: A: expected 1 finite numbers, got \(0.0, 1.0\)"),
        ({"of": {}}, "at least one value"),
        ({"name": "Größe"}, "lower-case ASCII name"),
    ],
)
def test_a_group_with_impossible_numbers_is_rejected(changed: dict[str, object], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        group(**changed)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "groups",
    [
        (group(name="a_b"), group(name="a", features=("b_x",))),
        (group(features=("x", "x"), of={"A": (0.0, 0.0)}),),
    ],
)
def test_two_features_with_one_name_are_rejected(groups: tuple[PropertyGroup, ...]) -> None:
    with pytest.raises(ConfigError, match="expected different features"):
        ObjectSchema(groups)


WORLD = World(SIZED, SIZED.vocabulary, joints=7)


def test_sizes_follow_from_the_world() -> None:
    assert (WORLD.object_features, WORLD.arm_features, WORLD.actions) == (17, 21, 7)
    assert WORLD.columns == 38


def reversed_words(group: WordGroup) -> WordGroup:
    """The same words in another order: other rows of Φ."""
    return WordGroup(group.name, group.words[::-1])


def test_a_world_is_read_back_from_its_json_and_identified_by_its_digest() -> None:
    assert World.from_json(WORLD.to_json()) == WORLD
    assert list(World.from_json(WORLD.to_json()).schema["size"].features.values) == [
        "SMALL",
        "LARGE",
    ]
    fewer = Vocabulary.of(shape=("CUBE",), color=("RED",), size=("SMALL", "LARGE"))
    others = [
        World(PAPER, PAPER.vocabulary, joints=6),
        World(PAPER, PAPER.vocabulary, joints=7),
        World(SIZED, SIZED.vocabulary, joints=6),
        World(SIZED, fewer, joints=7),
        World(SIZED, Vocabulary(tuple(map(reversed_words, SIZED.vocabulary.groups))), joints=7),
        World(SIZED, SIZED.vocabulary.asking("NEAR", "ABOVE"), joints=7),
    ]
    digests = {world.digest for world in (WORLD, *others)}
    assert len(digests) == 7 and {len(digest) for digest in digests} == {16}


@pytest.mark.parametrize("text", ["", "[]", '{"objects": 3}'])
def test_wrong_json_is_rejected(text: str) -> None:
    with pytest.raises(ConfigError, match="world: expected"):
        World.from_json(text)
    with pytest.raises(ConfigError, match="object schema: expected groups"):
        World.from_data(WORLD.to_data() | {"objects": 3})


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"joints": 17}, "joints: expected 1 to 16, got 17"),
        ({"joints": True}, "joints: expected 1 to 16, got True"),
        ({"joints": 0}, "joints: expected 1 to 16, got 0"),
        ({"joints": 6.5}, "joints: expected 1 to 16, got 6.5"),
        ({"vocabulary": PAPER.vocabulary.asking("BESIDE")}, "unknown relation: expected one of"),
        (
            {"vocabulary": Vocabulary.of(color=("RED",), shape=("CUBE",))},
            r"expected \['shape', 'color'\], got \['color', 'shape'\]",
        ),
    ],
)
def test_a_world_checks_its_limits(changed: dict[str, object], why: str) -> None:
    given = {"schema": PAPER, "vocabulary": PAPER.vocabulary, "joints": 6} | changed
    with pytest.raises(ConfigError, match=why):
        World(**given)  # type: ignore[arg-type]


SEEN = ObjectSchema(
    (
        PropertyGroup("shape", ("CUBE", "C"), Seen(3, scale=2.0, calibration="abc")),
        PropertyGroup("color", ("RED",), Seen(1)),
    )
)


def test_seen_features_have_columns_and_words_but_tell_none() -> None:
    world = World(SEEN, SEEN.vocabulary, joints=6)
    assert SEEN.feature_names[7:] == ("shape_0", "shape_1", "shape_2", "color_0")
    assert SEEN.scales.tolist() == [1.0] * 7 + [2.0] * 3 + [1.0]
    assert world.vocabulary.words == ("CUBE", "C", "RED")
    assert PAPER.tells_words and not SEEN.tells_words
    assert SEEN.labels(np.ones((2, 11), np.float32), 0) == ("hand", "block 1")
    with pytest.raises(ConfigError, match="truth: expected properties that are told, got ones"):
        world.truth(np.ones((2, 11), np.float32))


def test_objects_without_a_body_are_told_where_others_are_seen() -> None:
    shape = PropertyGroup("shape", ("CUBE", "PLACE"), Seen(2, told=("PLACE",)), ("PLACE",))
    schema = ObjectSchema((shape, PropertyGroup("color", ("RED",), Seen(1, told=("RED",)))))
    world = World(schema, schema.vocabulary.moving("PLACE"), joints=6)
    assert schema.feature_names[7:] == ("shape_0", "shape_1", "shape_place", "color_0", "color_red")
    assert schema.seen_columns.tolist() == [7, 8, 10]
    block = np.array([0] * 7 + [0.2, 1, 0, 0.5, 0], np.float32)
    objects = np.stack([0 * block, block, schema.features({"shape": "PLACE", "color": "RED"})])
    assert schema.bodies(objects).tolist() == [True, True, False]
    assert schema.labels(objects, 0) == ("hand", "block 1", "RED PLACE")
    assert world.told(objects).tolist() == [[0, 0, 0], [0, 0, 0], [0, 1, 1]]
    assert World.from_json(world.to_json()) == world


def test_the_calibration_of_what_is_seen_is_part_of_a_world() -> None:
    world = World(SEEN, SEEN.vocabulary, joints=6)
    assert World.from_json(world.to_json()) == world
    text = world.to_json().replace('"abc"', '"abd"')
    assert World.from_json(text).digest != world.digest


@pytest.mark.parametrize("width", [0, 241, 2.5, True])
def test_a_wrong_number_of_seen_features_is_rejected(width: int) -> None:
    with pytest.raises(ConfigError, match="seen features: width: expected 1 to 240, got"):
        Seen(width)
