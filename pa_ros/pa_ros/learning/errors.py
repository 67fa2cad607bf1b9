"""What the learning room refuses, and why."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class TrajectoryError(PaError):
    """A trajectory of experience that cannot be learned from."""

    code = "learning.trajectory"


class TrajectorySizeError(TrajectoryError):
    """Array shapes that do not fit each other or the replay buffer."""

    code = "learning.size"


class TrajectoryWorldError(TrajectoryError):
    """A trajectory of another world than the learner's."""

    code = "learning.world"


class SupersededAgentError(TrajectoryError):
    """A trajectory of an agent whose name a later one has taken."""

    code = "learning.superseded"


class AheadError(TrajectoryError):
    """A trajectory that its agent cannot have made yet."""

    code = "learning.ahead"


class TooOldError(TrajectoryError):
    """A trajectory acted by weights from too many versions before."""

    code = "learning.too_old"


class TurnError(TrajectoryError):
    """A trajectory of an agent that has no turn."""

    code = "learning.turn"


class NonFiniteError(TrajectoryError):
    """A number that is not finite."""

    code = "learning.non_finite"


class OutOfBoundsError(TrajectoryError):
    """An action outside [-1, 1], or a number too large for any arena, or for an update."""

    code = "learning.out_of_bounds"


class DivergedError(PaError):
    """Learning whose numbers are not finite any more; nothing of it may be published or saved."""

    code = "learning.diverged"
    restored = False  # whether the learner is again as it was before


class EmptyReplayError(PaError):
    """A sample was asked of a replay buffer without transitions."""

    code = "learning.empty_replay"


class CheckpointError(PaError):
    """A checkpoint that is missing, damaged, or of other networks or settings."""

    code = "learning.checkpoint"


class ScalarsError(PaError):
    """Scalars that can't be written any more."""

    code = "learning.tensorboard"


class FolderInUseError(CheckpointError):
    """A run's folder that another run writes into."""

    code = "learning.in_use"


class FolderUsedError(CheckpointError):
    """A run's folder that would be begun anew, over what an earlier run left in it."""

    code = "learning.folder_used"
