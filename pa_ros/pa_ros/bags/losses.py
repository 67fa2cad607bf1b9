"""Messages that were sent and never came, from the numbers that publishers give them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

LOST: Final = "pa_ros.lost"  # key of metadata.yaml: JSON object, messages lost by topic
STREAMS = 16  # publishers of one topic that are told apart at a time


class Losses:
    """Counts the gaps in one topic's sequence numbers; 1, 2, 3, … from each publisher.

    A message does not say whose it is, so with several publishers the numbers are put together
    in the way that explains them with the fewest losses.
    """

    def __init__(self, publishers: Callable[[], int] = lambda: 1) -> None:
        """`publishers`: how many there are now; asked only where the numbers leave it open."""
        self.lost = 0
        self.before = 0  # sent by publishers before they were first heard
        self._publishers = publishers
        self._expected: list[int] = []  # next number of each publisher, the latest heard last

    def take(self, number: int) -> None:
        """Take in the number of a message that came."""
        if number in self._expected:
            self._expected.remove(number)
        elif self._is_new(number):
            self.before += number - 1
        else:
            nearest = max(expected for expected in self._expected if expected < number)
            self.lost += number - nearest
            self._expected.remove(nearest)
        self._expected = [*self._expected[-STREAMS + 1 :], number + 1]

    def _is_new(self, number: int) -> bool:
        """Whether it is the first that is heard of a publisher, who may have sent others before."""
        if number == 1 or all(expected > number for expected in self._expected):
            return True
        return self._publishers() > len(self._expected)
