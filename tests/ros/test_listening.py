"""Time as a listener counts it."""

from __future__ import annotations

from pa_ros.ros.listening import LONGEST_S, TICK_S, ListeningClock


def test_a_process_that_stood_still_has_heard_nothing_in_that_time(clock) -> None:
    listening = ListeningClock(clock)
    for _ in range(8):
        clock.now += TICK_S
        listening()
    assert listening() == 8 * TICK_S
    clock.now += 3600.0
    assert listening() == 8 * TICK_S + LONGEST_S
    clock.now += TICK_S
    assert listening() == 9 * TICK_S + LONGEST_S
