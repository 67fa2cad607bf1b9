"""An arena and an agent in lockstep, in one process: invariants 1, 6, 7 and 9."""

from collections.abc import Iterator
from typing import Any

import pytest

from agent_node.node import AgentNode
from helpers.graph import Probe, graph
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp, read_stamp
from pa_ros.wire.program import ProgramRequest, decode_program_status, encode_program
from pa_ros.wire.services import ResetRequest, encode_reset, encode_speed
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


@pytest.fixture(scope="module")
def probe(module_domain: str) -> Iterator[Probe]:
    """One graph for all tests of this module, with episodes of ten steps."""
    with graph(
        SimNode, AgentNode, sim_node__episode_steps=10, agent_node__weights="random"
    ) as probe:
        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 60)
        yield probe


def step_key(message: Any) -> tuple[int, int, int]:
    stamp_ns = read_stamp(message.stamp) if hasattr(message, "stamp") else header_stamp(message)
    return message.episode, message.step, stamp_ns


def test_all_messages_of_a_step_have_its_stamp(probe):
    steps = [step_key(m) for m in probe.heard["object_features"]]
    assert len({stamp for _, _, stamp in steps}) == len(set(steps))
    commands = {step_key(m) for m in probe.heard["joint_commands"]}
    assert commands and commands <= set(steps)
    verdicts = {step_key(m) for m in probe.heard["verdict"]}
    assert len(verdicts & set(steps)) >= len(set(steps)) - 1
    joints = {header_stamp(m) for m in probe.heard["joint_states"]}
    assert len(joints & {stamp for _, _, stamp in steps}) >= len(set(steps)) - 1


def test_the_last_step_of_an_episode_gets_no_command(probe):
    assert {m.step for m in probe.heard["object_features"]} == set(range(11))
    assert {m.step for m in probe.heard["joint_commands"]} == set(range(10))
    assert probe.until(lambda: probe.value("sim_node", "refused") == "0")


def test_the_clock_never_goes_back_even_at_a_reset(probe):
    for episode in (7, 3, None):
        assert probe.call(topics.RESET, encode_reset(ResetRequest(episode))).success
        ticks = probe.count(topics.CLOCK)
        assert probe.until(lambda: probe.count(topics.CLOCK) > ticks + 20)  # noqa: B023
    stamps = [read_stamp(m.clock) for m in probe.heard["clock"]]
    assert stamps == sorted(stamps)


def test_a_paused_arena_takes_single_steps_and_the_agent_sends_nothing(probe):
    step = topics.STEP_SIMULATION[1].Request
    running = probe.call(topics.STEP_SIMULATION, step(steps=1))
    assert not running.success and "expected a paused arena" in running.reason
    assert probe.pause().success
    session = probe.nodes[0].session
    assert probe.until(lambda: "waits for observations" in probe.message("agent_node"))
    before, sent = session.steps, probe.count(topics.JOINT_COMMANDS)
    probe.until(lambda: False, 0.3)
    assert (session.steps, probe.count(topics.JOINT_COMMANDS)) == (before, sent)
    assert probe.call(topics.STEP_SIMULATION, step(steps=3)).success
    assert session.steps == before + 3
    assert not probe.call(topics.STEP_SIMULATION, step(steps=0)).success
    assert probe.call(topics.SPEED, encode_speed(2.0)).code == "arena.lockstep"
    assert probe.pause(False).success
    assert probe.until(lambda: session.steps > before + 30)  # the agent is asked again


def test_programs_are_accepted_or_refused_with_a_reason_while_the_arena_runs(probe):
    speaker = probe.speaker(topics.PROGRAM)

    def ask(program_id: str, text: str) -> dict[str, Any]:
        """The answers of arena and agent."""
        speaker.publish(encode_program(ProgramRequest(program_id, text)))

        def answers() -> dict[str, Any]:
            found = map(decode_program_status, probe.heard["program_status"])
            return {status.node: status for status in found if status.program_id == program_id}

        assert probe.until(lambda: len(answers()) == 2)
        return answers()

    good = ask("good", "NEAR(HAND,OR( RED, NOT(RED)))")
    assert {s.canonical for s in good.values()} == {"NEAR(HAND, OR(RED, NOT(RED)))"}
    assert probe.until(lambda: any(m.program_id == "good" for m in probe.heard["object_features"]))
    wrong = {
        "empty": "",
        "long": "A" * 1_000_000,
        "deep": "NEAR(HAND, " + "NOT(" * 10_000 + "RED" + ")" * 10_001,
        "unknown": "NEAR(HAND, PINK)",
        "not ascii": "NEAR(HAND, RÉD)",
    }
    for name, text in wrong.items():
        answers = ask(name, text)
        assert not any(status.accepted for status in answers.values()), name
        assert all(s.code.startswith("program.") and s.reason for s in answers.values())
    unknown = ask("unknown", wrong["unknown"])["/sim_node"]
    assert unknown.position == 11 and "^" in unknown.reason
    steps = probe.nodes[0].session.steps
    assert probe.until(lambda: probe.nodes[0].session.steps > steps + 20)
