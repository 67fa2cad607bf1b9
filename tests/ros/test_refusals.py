"""Refusals are counted one by one and logged now and then."""

from __future__ import annotations

import sys
import threading

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.errors import WireError


def make() -> tuple[Refusals, list[str], list[float]]:
    lines: list[str] = []
    now = [0.0]
    return Refusals(lines.append, clock=lambda: now[0], period_s=5.0), lines, now


def test_each_is_counted_by_code_and_the_first_of_a_code_is_logged():
    refusals, lines, _ = make()
    for _ in range(3):
        refusals.refuse("topic", WireError("field", 6, 5, code="wire.size"))
    refusals.refuse("topic", ConfigError("no"))
    assert refusals.total == 4
    counts = [("refused.config", "1"), ("refused.wire.size", "3")]  # in the codes' order
    assert list(refusals.values().items()) == counts
    assert lines == [
        "refused: topic: [wire.size] field: expected 6, received 5",
        "refused: topic: [config] no",
    ]


def test_a_flood_is_logged_once_a_period_with_how_many_there_were():
    refusals, lines, now = make()
    for i in range(100):
        now[0] = i * 0.1
        refusals.refuse("topic", ConfigError("no"))
    assert len(lines) == 2
    assert lines[1].endswith("(49 more since the last report)")


def test_a_guarded_callback_lets_bugs_through_and_refuses_bad_input():
    refusals, _, _ = make()

    def callback(message: str) -> None:
        raise {"bad": ConfigError("no"), "bug": ZeroDivisionError()}[message]

    guarded = refusals.guard("topic", callback)
    guarded("bad")
    assert refusals.counts["config"] == 1
    with pytest.raises(ZeroDivisionError):
        guarded("bug")


class SlowCode(str):
    """A code that Python itself hashes, so that another thread may come between."""

    def __hash__(self) -> int:
        return super().__hash__()


def in_threads(count: int, act) -> None:
    threads = [threading.Thread(target=act) for _ in range(count)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)


def test_none_is_lost_where_threads_refuse_at_once():
    refusals, _, _ = make()
    error = ConfigError("no")
    error.code = SlowCode("config")

    def refuse_often() -> None:
        for _ in range(2000):
            refusals.refuse("topic", error)

    in_threads(4, refuse_often)
    assert refusals.total == 8000


def test_two_threads_log_the_first_of_a_code_once():
    lines: list[str] = []
    asked, both = [], threading.Event()

    def clock() -> float:
        asked.append(True)
        if len(asked) > 1:
            both.set()
        both.wait(0.2)
        return 0.0

    refusals = Refusals(lines.append, clock)
    in_threads(2, lambda: refusals.refuse("topic", ConfigError("no")))
    assert lines == ["refused: topic: [config] no"]
