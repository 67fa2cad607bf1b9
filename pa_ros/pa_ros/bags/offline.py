"""Learning from recordings alone: no arena, no graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from pa_ros.bags.experience import Experience
from pa_ros.core.errors import PaError
from pa_ros.learning.learner import Learner
from pa_ros.world import Trajectory


@dataclass
class Lessons:
    """What became of the trajectories of some bags."""

    accepted: int = 0
    missing: int = 0  # the recorded learner had them, the bag has not
    left_out: int = 0  # the bag has them, the recorded learner had not taken them in
    refused: int = 0  # not usable with these networks
    refusal: str = ""  # the first
    unheard: int = 0  # versions from before the recording, of whose trajectories the order is open
    unseen: str = ""  # parts of the bags that were damaged

    @property
    def complete(self) -> bool:
        """Whether everything was learned that the recorded learners had learned."""
        return not (self.missing or self.refused or self.unheard or self.unseen)


def learn(
    experiences: Sequence[Experience],
    learner: Learner,
    progress: Callable[[Lessons], None] | None = None,
) -> Lessons:
    """Feed the trajectories of one bag after the other to a learner, each in its run's own order.

    Of a bag that tells which trajectories its learner took in, these and no others. Agents of
    different runs are kept apart, even if they have the same name, and so are an agent's lives.
    """
    found = Lessons()
    runs: dict[str, int] = {}
    for experience in experiences:
        run = runs.setdefault(_run(experience), len(runs))
        followed = len(experience.published) > 1
        found.unseen = "; ".join(filter(None, (found.unseen, experience.unseen)))
        if len({key[:2] for key in experience.keys}) > 1:  # of one agent the order is its own
            found.unheard += experience.unheard
        for lesson in experience.lessons(learner.network.world):
            if lesson.trajectory is None:
                found.missing += 1
            elif followed and lesson.version is None:
                found.left_out += 1
            else:
                life = lesson.key.incarnation, run  # whoever came later has not taken its name here
                agent = f"{lesson.key.agent_id}@{life}"
                _take(learner, replace(lesson.trajectory, agent_id=agent, held_from=0), found)
            if progress is not None:
                progress(found)
    return found


def _run(experience: Experience) -> str:
    """What tells runs apart: the learner's, or the bag itself."""
    runs = {origin.instance for origin in experience.origins if origin.learner is not None}
    return "+".join(sorted(runs)) or str(id(experience))


def _take(learner: Learner, trajectory: Trajectory, found: Lessons) -> None:
    try:
        report = learner.consume(trajectory)
    except PaError as error:
        found.refused += 1
        found.refusal = found.refusal or str(error)
    else:
        found.accepted += report.insert.accepted
