"""Faults of users: many requests at once, and nodes that go through all their states."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter

from chaos.faults import LEARNER, Act, Fault
from chaos.stage import NODES, Stage, StageError
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.wire.program import ProgramGoal, encode_goal

ANSWER_S: Final = 30.0  # in which everything is answered
AT_ONCE: Final = 1000
CYCLES: Final = 20
GROWTH: Final = (100, 5, 5)  # MiB (a replay buffer fills meanwhile), threads, open files
ALL_STATES: Final = (
    Transition.TRANSITION_DEACTIVATE,
    Transition.TRANSITION_CLEANUP,
    Transition.TRANSITION_CONFIGURE,
    Transition.TRANSITION_ACTIVATE,
)


def service_faults() -> list[Fault]:
    """1,000 requests or goals at once, each of which must be answered; and all transitions."""
    asked = {"get_entities": topics.GET_ENTITIES, "get_state": ("sim_node/get_state", GetState)}
    floods = [
        Fault(f"{AT_ONCE:,} requests at once: {name}", _flood(service), silent="all are answered")
        for name, service in asked.items()
    ]
    return [
        *floods,
        Fault(f"{AT_ONCE:,} goals at once", _many_goals, kind="executing",
              silent="all are answered"),
        Fault(f"all nodes: {CYCLES} times through all states", _go_through_all_states,
              silent="somebody asked the nodes to do it"),
    ]  # fmt: skip


def _call(stage: Stage, kind: Any, name: str, requests: Sequence[Any]) -> list[Any]:
    """Send all requests at once; their answers. Raises StageError if some are missing."""
    client = stage.node.create_client(kind, name, qos_profile=topics.SERVICE)
    try:
        if not stage.until(client.service_is_ready, ANSWER_S):
            raise StageError(f"{name}: expected the service, found none")
        answers = [client.call_async(request) for request in requests]
        _await_all(stage, name, answers)
        return [answer.result() for answer in answers]
    finally:
        stage.node.destroy_client(client)


def _await_all(stage: Stage, name: str, answers: Sequence[Any]) -> None:
    if not stage.until(lambda: all(answer.done() for answer in answers), ANSWER_S):
        missing = sum(not answer.done() for answer in answers)
        raise StageError(f"{name}: {missing} of {len(answers)} requests were not answered")


def _flood(service: tuple[str, Any]) -> Act:
    name, kind = service
    return lambda stage: _call(stage, kind, name, [kind.Request()] * AT_ONCE)


def _many_goals(stage: Stage) -> None:
    name, kind = EXECUTE_PROGRAM
    queues = {f"{one}_service_qos_profile": topics.SERVICE for one in ("goal", "result")}
    client = ActionClient(stage.node, kind, name, **queues)
    try:
        stage.until(client.server_is_ready, ANSWER_S)
        goal = encode_goal(ProgramGoal("NEAR(HAND, RED)", 1.0, 0.1))
        sent = [client.send_goal_async(goal) for _ in range(AT_ONCE)]
        _await_all(stage, name, sent)
        accepted = [answer.result() for answer in sent if answer.result().accepted]
        _await_all(stage, f"{name}: results", [one.get_result_async() for one in accepted])
    finally:
        client.destroy()


def _go_through_all_states(stage: Stage) -> None:
    resume = Parameter("resume", value=True).to_parameter_msg()
    before = {name: _held(stage.pid(name)) for name in NODES}
    for _ in range(CYCLES):
        for name in NODES:
            for number in ALL_STATES:
                if name == LEARNER and number == Transition.TRANSITION_CONFIGURE:
                    wanted = SetParameters.Request(parameters=[resume])
                    _call(stage, SetParameters, f"{name}/set_parameters", [wanted])
                request = ChangeState.Request(transition=Transition(id=number))
                (answer,) = _call(stage, ChangeState, f"{name}/change_state", [request])
                if not answer.success:
                    raise StageError(f"{name}: the transition {number} failed")
    for name in NODES:
        grown = [now - then for now, then in zip(_held(stage.pid(name)), before[name], strict=True)]
        if any(more > most for more, most in zip(grown, GROWTH, strict=True)):
            raise StageError(f"{name}: grew by {grown} (MiB, threads, files)")


def _held(pid: int) -> list[int]:
    """Resident memory in MiB, threads, and open files of a process."""
    process = Path(f"/proc/{pid}")
    (line,) = (s for s in (process / "status").read_text().splitlines() if s.startswith("VmRSS"))
    return [
        int(line.split()[1]) // 1024,
        *(len(list((process / k).iterdir())) for k in ("task", "fd")),
    ]
