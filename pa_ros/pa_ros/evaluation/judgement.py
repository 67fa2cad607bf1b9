"""An agent's own judgement of what is done, beside the verifier's, at each step."""

from __future__ import annotations

from pa_ros.acting.executing import Actor
from pa_ros.arena import ReachTask
from pa_ros.core.experience import Observation
from pa_ros.core.text import Report
from pa_ros.language import Program
from pa_ros.world.progress import GoalWatch


class Judgement:
    """Says which program of a goal is pursued, and counts how often the agent errs about it.

    At each step verifier and agent judge the program that is pursued: does its relation hold?
    """

    def __init__(self, actor: Actor, decides: bool) -> None:
        """`decides`: the agent's own judgement leads from one program to the next, instead of the
        verifier's."""
        self._actor, self._decides = actor, decides
        self._watch: GoalWatch | None = None
        self._counts = {(truth, own): 0 for truth in (False, True) for own in (False, True)}

    def program(self, observation: Observation, task: ReachTask) -> Program:
        """The program to pursue at a step; call once per step."""
        if observation.step == 0 or self._watch is None:
            self._watch = GoalWatch(task.goal)
        score = self._actor.judge(observation, task.scoring)
        judged = (self._watch.program if self._decides else task.program).relation_alone
        state = task.simulation  # what is true, whatever the agent sees
        truth = task.verifier_of(judged).score(state.objects(), state.hand_pose)
        self._counts[bool(truth.satisfied), bool(score(judged).satisfied)] += 1
        self._watch.verdict(score, task.scoring.reward)
        return self._watch.program if self._decides else task.program

    def report(self) -> Report:
        """Steps judged, and error rates: `false_done` of the steps at which the program does not
        hold, `missed` of those at which it does."""
        counts = self._counts

        def rate(truth: bool) -> float:
            total = counts[truth, False] + counts[truth, True]
            return counts[truth, not truth] / total if total else float("nan")

        return {
            "eval.judgement.steps": sum(counts.values()),
            "eval.judgement.false_done": rate(False),
            "eval.judgement.missed": rate(True),
        }
