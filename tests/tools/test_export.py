"""Agents for others: ONNX files that act as the agent does, and model cards of measured scores."""

import json
from importlib.util import find_spec

import numpy as np
import pytest

from helpers.pictures import opengl
from pa_ros.acting.executing import Actor
from pa_ros.agents import TrainedAgent, load_agent
from pa_ros.arena import conditions_for, design_named, preset_named, world_of
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import PolicySnapshot
from pa_ros.language import parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor
from pa_ros.tools.export import OBSERVATIONS, PARITY, export_onnx, observations

needs_onnx = pytest.mark.skipif(
    not (find_spec("onnx") and find_spec("onnxruntime")), reason="the extra `onnx` is not installed"
)


def agent_of(design: str, relations=("NEAR",), **network: object) -> TrainedAgent:
    """An agent of random weights that are as large as trained ones."""
    blocks = design_named(design).with_relations(*relations)
    arena = preset_named(blocks.preset)
    config = NetworkConfig(world=world_of(arena, blocks), hidden=12, attention=5).changed(**network)
    tensors = {k: 3 * v for k, v in initial_actor(config, np.random.default_rng(0)).items()}
    snapshot = PolicySnapshot(1, config.architecture, config.world.digest, tensors)
    return TrainedAgent(snapshot, blocks, arena)


@needs_onnx
@pytest.mark.parametrize(
    "agent",
    [
        load_agent("shipped:3-D"),
        agent_of("2-L", ("NEAR", "ABOVE", "LEFT_OF"), actor_output_scale=0.5),
        agent_of("push-2", upper_layers=2, self_weight=0.03, actor_output_scale=0.5),
    ],
    ids=["shipped", "relations", "pushing"],
)
def test_the_onnx_file_acts_as_the_agent_on_a_thousand_observations(agent, tmp_path):
    path = tmp_path / "actor.onnx"
    assert 0 < export_onnx(agent, path) <= PARITY


@needs_onnx
def test_the_file_acts_as_an_agent_that_loses_blocks_from_sight(tmp_path):
    pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
    opengl()
    agent = load_agent("shipped:camera")
    seen = {(seen.episode, len(seen.objects)) for seen, _ in observations(agent, OBSERVATIONS)}
    assert len(seen) > len({episode for episode, _ in seen})
    assert 0 < export_onnx(agent, tmp_path / "actor.onnx") <= PARITY


@needs_onnx
def test_the_file_alone_says_how_to_execute_a_program(tmp_path):
    import onnx
    from onnxruntime import InferenceSession

    agent, path = load_agent("shipped:2-L"), tmp_path / "actor.onnx"
    text = "NEAR(HAND, AND(BLUE, NOT(CUBE)))"
    assert main(["export", "shipped:2-L", "--onnx", str(path), "--program", text]) == 0
    session = InferenceSession(str(path))
    about = session.get_modelmeta().custom_metadata_map
    program = json.loads(about["programs"])[text]
    assert json.loads(about["joint_speed_limits"]) == list(agent.arena.joint_speed_limits)
    seen, _ = next(observations(agent, 1))
    feeds = {
        "objects": [seen.objects] * 2,
        "joint_position": [seen.joint_position] * 2,
        "joint_velocity": [seen.joint_velocity] * 2,
    }
    codes = {name: np.array([code] * 2, np.int64) for name, code in program.items()}
    feeds = {name: np.array(value, np.float32) for name, value in feeds.items()}
    action, relevance = session.run(None, {**feeds, **codes})
    actor, parsed = Actor.of(agent.snapshot), parse(text, agent.design.vocabulary)
    np.testing.assert_allclose(action, [actor.act(seen, parsed)] * 2, atol=PARITY)
    np.testing.assert_allclose(relevance, [actor.relevance(seen, parsed)] * 2, atol=PARITY)
    described = {value.name: value.doc_string for value in onnx.load(path).graph.input}
    assert "in the frame of the hand" in described["objects"] and all(described.values())


@needs_onnx
def test_networks_without_programs_are_rejected_in_one_line(tmp_path):
    with pytest.raises(ConfigError, match="programmable networks of this package, got canonical"):
        export_onnx(agent_of("2-L", family="canonical"), tmp_path / "actor.onnx")
    assert not list(tmp_path.iterdir())


@needs_onnx
def test_a_difference_from_the_agent_is_an_error(tmp_path, monkeypatch):
    from pa_ros.networks import onnx_file

    monkeypatch.setattr(onnx_file, "sharpened", lambda tensors, logic: tensors)
    with pytest.raises(ConfigError, match="do not use this file"):
        export_onnx(load_agent("shipped:2-L"), tmp_path / "actor.onnx")


def test_observations_show_all_conditions_of_the_design():
    agent = load_agent("shipped:2-L")
    found = [*observations(agent, 200)]
    programs = {str(program) for _, program in found}
    assert len(found) == 200 and len({len(seen.objects) for seen, _ in found}) == 3
    assert len(programs) > len(conditions_for(agent.design)) / 2
