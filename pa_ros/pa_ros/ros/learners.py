"""Which learner an agent acts for: the one that it acts for already, as long as that one lives."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

from pa_ros.core.published import LearnerInfo
from pa_ros.ros.rivals import GONE_S

LEARNER_ID = "learner_id"  # key of a learner's /diagnostics
UNKNOWN_S = 1.0  # weights may come so long before the announcement of who publishes them
SAID_S = 3.0  # weights of nobody's run are worth a word for so long
KNOWN = 16  # learners remembered


class Learners:
    """The learner that counts, and the others heard of.

    A learner that is started again, of the same run, takes its own place at once; one of another
    run, or of an earlier stamp (another machine's clock), only once the learner that counts has
    said nothing for GONE_S.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.current: LearnerInfo | None = None
        self._clock = clock
        self._known: OrderedDict[str, LearnerInfo] = OrderedDict()
        self._heard: dict[str, float] = {}  # when a learner said something last
        # whose weights came, first and last
        self._unknown: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def announce(self, learner: LearnerInfo) -> bool:
        """A learner announces itself; whether it is the one that counts now."""
        self._known[learner.learner_id] = learner
        self._known.move_to_end(learner.learner_id)
        self._heard[learner.learner_id] = self._clock()
        self._unknown.pop(learner.learner_id, None)
        if self._takes_over(learner):
            self.current = learner
        self._forget()
        return self.current is learner

    def heard(self, learner_id: str) -> bool:
        """A learner says that it lives; whether another counts because of it."""
        learner = self._known.get(learner_id)
        if learner is None:
            return False
        before, self._heard[learner_id] = self.current, self._clock()
        if self._takes_over(learner):
            self.current = learner
        return self.current is not before

    def weights(self, learner_id: str) -> bool:
        """Weights have come; whether another learner counts because of it."""
        if learner_id in self._known or self.current is None:
            return self.heard(learner_id)
        now = self._clock()
        self._unknown[learner_id] = self._unknown.get(learner_id, (now, now))[0], now
        while len(self._unknown) > KNOWN:
            self._unknown.popitem(last=False)
        return False

    @property
    def alarm(self) -> str:
        """What a person should know and do; empty: nothing."""
        now = self._clock()
        mine = "" if self.current is None else self.current.learner_id
        others = sorted(name for name in self._known if name != mine and self._lives(name))
        if others:
            return (
                f"other learners run, too ({', '.join(others)}), whose weights are not used: stop "
                "all but one learner_node"
            )
        self._unknown = OrderedDict(
            (name, at) for name, at in self._unknown.items() if now - at[1] < UNKNOWN_S + SAID_S
        )
        nobodys = sorted(name for name, at in self._unknown.items() if now - at[0] >= UNKNOWN_S)
        if nobodys:
            return (
                f"weights come of a learner that never announced itself ({', '.join(nobodys)}), "
                "and are not used: find who publishes them, or sign with auth_key_file"
            )
        return ""

    def _takes_over(self, learner: LearnerInfo) -> bool:
        current = self.current
        if current is None or current.learner_id == learner.learner_id:
            return True
        again = current.run_id == learner.run_id and learner.stamp_ns >= current.stamp_ns
        return again or not self._lives(current.learner_id)

    def _lives(self, learner_id: str) -> bool:
        return self._clock() - self._heard[learner_id] < GONE_S

    def _forget(self) -> None:
        """The learners that announced themselves longest ago, but for the one that counts."""
        spare = [name for name, one in self._known.items() if one is not self.current]
        for name in spare[: max(0, len(self._known) - KNOWN)]:
            del self._known[name], self._heard[name]
