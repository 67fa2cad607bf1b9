"""Whether a program was executed, according to the verdicts on an arena's steps.

Ten classes say "it is done", each from what the one before it says:

Progress (language): the automaton of a goal, from which programs hold in each state.
GoalWatch (world): the verdict on each state, from scores of programs; keeps a `Progress`.
Verifier (arena): the score of one program in the true state.
GoalVerifier (arena): the verdict on a goal in the true state; arena and robot publish it.
OwnJudgement (acting): the same by the agent's estimate, where nobody judged the step.
Judgement (evaluation): counts how often that estimate errs, for `pa_ros evaluate --judge`.
ExecutionWatch (here): done once the verdicts held for `hold_s`, or the goal can't be reached.
ProgramGoals (agent_node): ends a goal of the action with what an ExecutionWatch says.
ProgramSender (tools): the same for a program that was published, where no agent takes goals.
Goal (tools): done once the agent's answer has arrived; it judges nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from pa_ros.core.experience import Step
from pa_ros.world.relation import at_stage, measured, programs_in

WINDOW_S = 10.0  # simulation time that each program of a goal is given: an episode of the paper
HOLD_S = 1.0  # simulation time for which NEAR must hold
ENDED = {  # how an execution that failed ended → code and reason
    "window": ("goal.time_limit", "the time limit came first"),
    "violated": ("goal.violated", "an object to be avoided was near"),
    "episode": ("goal.episode_ended", "the arena's episode ended"),
    "replaced": ("goal.replaced", "another program, or another scene, took its place"),
}


@dataclass(frozen=True, slots=True)
class Execution:
    """The result of executing one program."""

    satisfied: bool  # NEAR held for HOLD_S, or still held when the window or the episode ended
    distance: float  # m, hand to the nearest object named, at the last step watched; inf: none
    reached_s: float | None  # simulation time from its first step to NEAR for good; None: never
    watched_s: float  # simulation time from the program's first step to the last step watched
    ended: str  # "held", or one of ENDED
    stage: int = 0  # at the last step watched

    def text(self, program: str) -> str:
        """The result of a program in one line."""
        where = ""
        if self.distance != inf:
            where = f", at {measured(program, self.distance, self.stage)}"
        if self.satisfied and self.reached_s is not None:
            return f"satisfied after {self.reached_s:.1f} s{where}"
        stage = at_stage(program, self.stage)
        when = f"{self.watched_s:.1f} s{', in ' if stage else ''}{stage}"
        return f"not satisfied: {ENDED[self.ended][1]}, after {when}{where}"


@dataclass(frozen=True)
class Result:
    """The outcome of one program."""

    program: str  # canonical text
    success: bool  # satisfied at the end, for long enough
    distance: float  # of the relation at the end; for NEAR in m, to the nearest named object
    reached_s: float | None  # simulation time until it was satisfied for good; None: never
    reason: str = ""  # why it was not reached
    code: str = ""  # of the reason, such as goal.time_limit


def window_s(goal: str) -> float:
    """Simulation time that a goal is given, s."""
    return WINDOW_S * max(len(programs_in(goal)), 1)


class ExecutionWatch:
    """Watches steps, in their order, until the result of one program is certain.

    Steps under other programs before the program's first step are ignored, unless they are later
    than its acceptance. A step of another program or episode after its first step ends the watch.
    A step that nobody judged counts as not satisfied.
    """

    def __init__(self, program_id: str, window_s: float = WINDOW_S, hold_s: float = HOLD_S) -> None:
        self._program_id = program_id
        self._window_ns, self._hold_ns = round(window_s * 1e9), round(hold_s * 1e9)
        self._first_ns: int | None = None
        self._episode, self._last_ns = 0, 0  # of the step watched last
        self._near_since_ns: int | None = None
        self._accepted_ns: int | None = None
        self.distance = inf  # at the step watched last
        self.satisfied = False  # at the step watched last
        self.stage = 0  # at the step watched last

    @property
    def begun(self) -> bool:
        """Whether a step under the program was seen."""
        return self._first_ns is not None

    def accepted(self, stamp_ns: int) -> None:
        """The program was accepted while the step of this stamp was current."""
        self._accepted_ns = max(stamp_ns, self._accepted_ns or 0)

    def observe(self, step: Step) -> Execution | None:
        """Take in one step. Returns the result once it is certain."""
        seen, verdict = step.observation, step.verdict
        other_episode = self.begun and seen.episode != self._episode
        if seen.program_id != self._program_id or other_episode:
            # It may also be that another program replaced this one before its first step.
            late = self._accepted_ns is not None and seen.stamp_ns > self._accepted_ns
            return self._finish("replaced") if self.begun or late else None
        if self._first_ns is None:
            self._first_ns = seen.stamp_ns
        self._episode, self._last_ns = seen.episode, seen.stamp_ns
        self.distance = verdict.distance if verdict else inf
        self.satisfied = verdict is not None and verdict.satisfied
        self.stage = step.stage
        if verdict is not None and verdict.violated:
            return self._finish("violated")
        if not self.satisfied:
            self._near_since_ns = None
        elif self._near_since_ns is None:
            self._near_since_ns = seen.stamp_ns
        near_since_ns = self._near_since_ns
        if near_since_ns is not None and seen.stamp_ns - near_since_ns >= self._hold_ns:
            return self._finish("held")
        if verdict is not None and verdict.truncated:
            return self._finish("episode")
        if seen.stamp_ns - self._first_ns >= self._window_ns:
            return self._finish("window")
        return None

    def _finish(self, ended: str) -> Execution:
        first_ns = self._first_ns
        if first_ns is None:
            return Execution(False, inf, None, 0.0, ended)
        near_ns = None if ended in ("replaced", "violated") else self._near_since_ns
        reached_s = None if near_ns is None else (near_ns - first_ns) / 1e9
        watched_s = (self._last_ns - first_ns) / 1e9
        satisfied = near_ns is not None
        return Execution(satisfied, self.distance, reached_s, watched_s, ended, self.stage)
