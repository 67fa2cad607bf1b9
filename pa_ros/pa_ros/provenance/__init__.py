"""Provenance: which software and settings made a run."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from pa_ros.core import __version__
from pa_ros.core.clock import now_ns
from pa_ros.core.software import here
from pa_ros.language import Program
from pa_ros.wire.diagnostics import LearnerOrigin, Origin

if TYPE_CHECKING:  # it imports torch, which an arena does not need
    from pa_ros.learning.learner import Learner


def origin(node: str, instance: str, seed: int, **of_process: Any) -> Origin:
    """The provenance of this process; `of_process` are other fields of Origin."""
    return Origin(
        node=node,
        instance=instance,
        seed=seed,
        software_version=__version__,
        versions=here(),
        stamp_ns=now_ns(),
        **{"parameters": {}, **of_process},
    )


def learner_origin(
    node: str,
    instance: str,
    seed: int,
    learner: Learner,
    training_programs: Iterable[Program],
    **of_process: Any,
) -> Origin:
    """The provenance of a learner, with its settings and training programs."""
    parameters = {"engine": learner.engine.name, **of_process.pop("parameters", {})}
    return origin(
        node,
        instance,
        seed,
        world=learner.network.world,
        parameters=parameters,
        learner=LearnerOrigin(
            first_version=learner.counters.version,
            network=learner.network.to_json(),
            learner=learner.config.to_json(),
            algorithm=learner.config.ALGORITHM,
            training_programs=tuple(training_programs),
        ),
        **of_process,
    )
