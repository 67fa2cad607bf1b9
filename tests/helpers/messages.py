"""Records to send, strategies for their fields, and equality of records with arrays."""

import dataclasses
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from pa_ros.core.experience import Observation, Step, Verdict
from pa_ros.wire.step import Command

stamps = st.integers(0, 2**31 * 10**9 - 1)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)


def observation(seed: int = 0, count: int = 5) -> Observation:
    """An observation of `count` objects of the paper's world and six joints."""
    rng = np.random.default_rng(seed)
    return Observation(
        episode=2,
        step=4,
        stamp_ns=12_300_000_001,
        objects=rng.normal(size=(count, 16)).astype(np.float32),
        joint_position=rng.normal(size=6),
        joint_velocity=rng.normal(size=6),
        hand_index=seed % count,
        program_id="p",
        hand_pose=np.array([0.4, -0.1, 0.3, 0.0, 0.6, 0.0, 0.8]),
    )


def answer(to: Observation, share: float = 0.5, **fields: Any) -> Command:
    """A command of an agent "me" to an observation, with some fields changed."""
    action = np.full(6, share, np.float32)
    return replace(Command(to.episode, to.step, to.stamp_ns, "me", 0, action), **fields)


def judged(step: int, near: bool, stamp_ns: int, **fields: Any) -> Step:
    """A step whose verdict is +1 within 0.1 m, or -1 at 0.5 m; `fields` are of any of its parts."""
    given = {"episode": 0, "step": step, "stamp_ns": stamp_ns, **fields}
    reward, distance = (1.0, 0.1) if near else (-1.0, 0.5)
    verdict = Verdict(reward, near, distance, given.pop("truncated", False))
    evaluation = given.pop("evaluation", False)
    return Step(replace(observation(), **given), verdict, evaluation=evaluation)


def same(a: Any, b: Any) -> bool:
    """Whether two records have equal fields of the same types."""
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    return all(np.array_equal(x, y) and type(x) is type(y) for x, y in pairs)
