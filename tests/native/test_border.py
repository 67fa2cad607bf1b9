"""The extension module checks its arguments: no caller can make it leave its memory."""

import gc
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pa_ros.native import _fused
from pa_ros.native.errors import FusedError

WORDS = [(7, [1.0, 0.0], 0.5), (7, [0.0, 1.0], 0.5), (11, [1.0], 0.5)]
GIVEN = {"arm_features": 18, "actions": 6, "scale": [1.0] * 16, "group_sizes": [2, 1],
         "words": WORDS}  # fmt: skip
STUB = Path(__file__).parents[2] / "pa_ros/pa_ros/native/_fused.pyi"


def trunk(critic: bool = False, **changes: object) -> _fused.Network:
    given = GIVEN | {"hidden": 8, "attention": 4, "detectors": True, "hide_properties": False}
    return _fused.Network.trunk(**given | {"critic": critic, "self_weight": 1.0} | changes)  # type: ignore[arg-type]


def canonical(critic: bool = False, **changes: object) -> _fused.Network:
    given = GIVEN | {"hidden": 8, "slots": [[0, 2], [1, 2]]}
    return _fused.Network.canonical(**given | {"critic": critic} | changes)  # type: ignore[arg-type]


def engine(make: Callable[..., _fused.Network] = trunk, threads: int = 1) -> _fused.Engine:
    settings = {
        "actor_rate": 1e-3,
        "critic_rate": 1e-3,
        "beta1": 0.9,
        "beta2": 0.999,
        "epsilon": 1e-8,
        "clip": 1.0,
        "action_penalty": 0.0,
        "detector_gain": 1.0,
    }
    settings |= {"sparsity": 0.0, "free_from": 1.0}
    actor, critic = make(), make(critic=True)
    return _fused.Engine(
        actor, critic, **settings, detector_arm=True, detector_bias=True, threads=threads
    )


def program(*rows: tuple[int, int, int], **changes: tuple[int, ...]) -> dict[str, np.ndarray]:
    """A program's record, [1, L] each of the instructions, with changes to the rest, [1] each."""
    op, a, b = (np.array([column], np.int32) for column in zip(*rows, strict=True))
    rest = {"relation": (0,), "moved": (3,), "target": (0,), "avoided": (3,)} | changes
    return {"op": op, "a": a, "b": b} | {k: np.array(v, np.int32) for k, v in rest.items()}


def scene(objects: int = 2) -> tuple[np.ndarray, np.ndarray, int, np.ndarray, np.ndarray]:
    """What an actor is called with: objects, arm, the hand's index, and arrays for its answers."""
    zeros = partial(np.zeros, dtype=np.float32)
    return zeros((objects, 16)), zeros(18), 0, zeros(6), zeros((4, objects))


def batch(transitions: int = 4, objects: int = 3, programs: int = 2) -> dict[str, object]:
    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.float32)

    return {
        "objects": zeros(transitions, objects, 16),
        "arm": zeros(transitions, 18),
        "action": zeros(transitions, 6),
        "next_objects": zeros(transitions, objects, 16),
        "next_arm": zeros(transitions, 18),
        "program": np.zeros((transitions, programs), np.int32),
        "reward": zeros(transitions, programs),
        "discount": zeros(transitions),
        "hand_index": 0,
        "correction1": 0.1,
        "correction2": 0.001,
    }


WRONG = [
    (
        {"objects": np.zeros((4, 3, 15), np.float32)},
        r"objects: .* \(4, 3, 16\), got float32 \(4, 3, 15",
    ),
    ({"arm": np.zeros((3, 18), np.float32)}, r"arm: expected contiguous float32 \(4, 18\)"),
    ({"action": np.zeros((4, 12), np.float32)[:, ::2]}, r"action: .*got strided float32 \(4, 6\)"),
    ({"program": np.zeros((4, 2), np.int64)}, r"program: .*int32 \(4, 2\), got int64 \(4, 2\)"),
    ({"program": np.full((4, 2), -1, np.int32)}, "expected programs below 1, got -1"),
    ({"program": np.ones((4, 2), np.int32)}, "expected programs below 1, got 1"),
    ({"reward": np.zeros((4, 2))}, r"reward: .*float32 \(4, 2\), got float64 \(4, 2\)"),
    ({"discount": np.zeros((4, 1), np.float32)}, r"discount: .*\(4,\), got float32 \(4, 1\)"),
    ({"hand_index": 3}, "hand_index: expected 0 … 2, got 3"),
    (batch(objects=65), "objects: expected 1 … 64, got 65"),
    (batch(transitions=0), "transitions: expected 1"),
]


@pytest.mark.parametrize(("change", "message"), WRONG)
def test_batches_that_do_not_fit(change: dict[str, object], message: str) -> None:
    made = engine()
    made.set_programs(**program((3, 0, 0)))
    made.update(**batch())  # type: ignore[arg-type]
    with pytest.raises(FusedError, match=message):
        made.update(**batch() | change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(4, 0, 0)], "op of a program: expected 0 … 3, got 4"),
        ([(0, 4, 0)], "register a of a program: expected 0 … 3, got 4"),
        ([(0, 0, -1)], "register b of a program: .*got -1"),
        ([(0, 0, 0), (0, 0, 5)], "register b of a program: expected 0 … 4, got 5"),
        ([(0, 0, 0)] * 1025, "length of a program: expected 1 … 1024, got 1025"),
    ],
)
def test_programs_with_registers_out_of_range(rows: list[tuple[int, int, int]], message: str):
    with pytest.raises(FusedError, match=message):
        engine().set_programs(**program(*rows))
    with pytest.raises(FusedError, match=message):
        _fused.Actor(trunk()).set_program(**program(*rows))


@pytest.mark.parametrize(
    ("relation", "message"),
    [
        ((2,), "relation of a program: expected 0 … 1, got 2"),
        ((), r"relation: expected contiguous int32 \(1,\), got int32 \(0,\)"),
    ],
)
def test_relations_out_of_range(relation: tuple[int, ...], message: str) -> None:
    several = partial(trunk, relations=2)
    code = program((3, 0, 0), relation=relation)
    with pytest.raises(FusedError, match=message):
        engine(several).set_programs(**code)
    with pytest.raises(FusedError, match=message):
        _fused.Actor(several()).set_program(**code)
    with pytest.raises(FusedError, match="relations: expected 0 … 16, got 17"):
        trunk(relations=17)


@pytest.mark.parametrize("name", ["moved", "target", "avoided"])
@pytest.mark.parametrize(
    ("registers", "message"),
    [
        ((5,), "register of a set: expected 0 … 4, got 5"),
        ((-1,), "register of a set: expected 0 … 4, got -1"),
        ((), r"{}: expected contiguous int32 \(1,\), got int32 \(0,\)"),
    ],
)
def test_sets_out_of_range(name: str, registers: tuple[int, ...], message: str) -> None:
    with pytest.raises(FusedError, match=message.format(name)):
        engine().set_programs(**program((3, 0, 0), **{name: registers}))
    with pytest.raises(FusedError, match="upper layers: expected 0 … 4, got 5"):
        trunk(upper_layers=5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([[0, 3]], "word of a target: expected 0 … 2, got 3"),
        ([[0, 1, 2]], r"targets: expected contiguous int32 \(1, 2\), got int32 \(1, 3\)"),
    ],
)
def test_targets_out_of_range(words: list[list[int]], message: str) -> None:
    with pytest.raises(FusedError, match=message):
        engine(canonical).set_targets(np.array(words, np.int32))


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda: trunk(group_sizes=[2, 2]), "size of a group: expected 1 … 1, got 2"),
        (lambda: trunk(group_sizes=[1] * 9), "groups: expected 1 … 8, got 9"),
        (lambda: trunk(words=[(15, [1.0, 0.0], 0.5)] * 3), "a word: expected 0 … 14, got 15"),
        (lambda: trunk(words=[(0, [1.0] * 17, 0.5)] * 3), "features of a word: .*16, got 17"),
        (lambda: trunk(scale=[1.0] * 257), "features of an object: expected 7 … 256, got 257"),
        (lambda: trunk(actions=17), "actions: expected 1 … 16, got 17"),
        (
            lambda: trunk(scale=[1.0] * 256, words=[(7, [0.0] * 200, 0.5)] * 21),
            "numbers of all words: expected 0 … 4096, got 4200",
        ),
        (lambda: trunk(hidden=0), "hidden: expected 1 … 8192, got 0"),
        (lambda: canonical(slots=[[0, 3]]), "word of a slot: expected 0 … 2, got 3"),
        (lambda: canonical(slots=[[0, 2]] * 33), "slots: expected 1 … 32, got 33"),
        (lambda: engine(threads=65), "threads: expected 1 … 64, got 65"),
        (lambda: _fused.Actor(trunk(critic=True)), "expected an actor, got a critic"),
    ],
)
def test_networks_beyond_the_limits(attempt: Callable[[], object], message: str) -> None:
    with pytest.raises(FusedError, match=message):
        attempt()


def test_an_observation_and_its_action_array_must_fit() -> None:
    actor, (objects, arm, hand, action, degrees) = _fused.Actor(trunk()), scene()
    with pytest.raises(FusedError, match="programs to act on: expected 1 … 1, got 0"):
        actor.act(objects, arm, hand, action)
    actor.set_program(**program((3, 0, 0)))
    actor.act(objects, arm, 1, action)
    with pytest.raises(FusedError, match=r"action: .*\(6,\), got float32 \(5,\)"):
        actor.act(objects, arm, 1, action[:5])
    actor.degrees(objects, arm, 1, degrees)
    with pytest.raises(FusedError, match=r"degrees: .*\(4, 2\), got float32 \(3, 2\)"):
        actor.degrees(objects, arm, 1, degrees[:3])
    flat = _fused.Actor(canonical())
    flat.set_target(np.array([[0, 2]], np.int32))
    with pytest.raises(FusedError, match="not told of programs by networks of this kind"):
        flat.degrees(objects, arm, 1, degrees)
    with pytest.raises(FusedError, match=r"arm: .*\(18,\), got float32 \(17,\)"):
        actor.act(objects, arm[:17], 1, action)
    with pytest.raises(FusedError, match="hand_index"):
        actor.act(objects, arm, 2, action)
    action.flags.writeable = False
    with pytest.raises(TypeError):
        actor.act(objects, arm, 1, action)


def test_views_keep_their_memory_alive() -> None:
    made = engine(threads=2)
    made.critic.parameters[:] = np.arange(made.critic.parameters.size)
    lent = made.critic.parameters
    assert lent.ctypes.data % 64 == 0
    del made
    gc.collect()
    np.testing.assert_array_equal(lent, np.arange(lent.size))


def test_the_stub_matches_the_module(tmp_path: Path) -> None:
    """After a change of bindings.cpp: copy what this command writes."""
    fresh = tmp_path / "_fused.pyi"
    command = ["-m", "nanobind.stubgen", "-q", "-m", "pa_ros.native._fused", "-o", str(fresh)]
    subprocess.run([sys.executable, *command], check=True)
    assert STUB.read_text() == fresh.read_text()
