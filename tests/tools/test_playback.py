"""Which topics of a bag are played."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

from pa_ros.tools.playback import PlaybackOptions, Player

CLOCK, TEXT = "rosgraph_msgs/msg/Clock", "std_msgs/msg/String"
TYPES = {"/clock": CLOCK, "/one/clock": CLOCK, "/sim_clock": TEXT, "/one/text": TEXT}


def _played(options: PlaybackOptions) -> set[str]:
    bag: Any = Mock(types=TYPES)
    bag.differs.return_value, bag.qos.return_value = False, []
    return set(Player(bag, Mock(), options).played.counts)


def test_a_clock_published_instead_leaves_out_the_recorded_one_and_no_arenas_own() -> None:
    assert _played(PlaybackOptions()) == set(TYPES)
    assert _played(PlaybackOptions(clock=True)) == set(TYPES) - {"/clock"}
