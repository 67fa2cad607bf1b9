"""The parameters file of a launch: which nodes, with what, and what is refused."""

import re
from typing import Any

import pytest
import yaml

from learner_node.config import LearnerNodeConfig
from pa_ros import make_arena
from pa_ros.cli.launch import DEFAULT
from pa_ros.core.errors import ConfigError
from pa_ros.learning.errors import CheckpointError
from pa_ros.tools.launch_params import (
    Parameters,
    chosen,
    extended,
    fleet,
    in_step,
    learning_into,
    load_parameters,
    merged,
    new_folder,
    packaged,
    packaged_names,
    preferred,
    seeing,
    write_parameters,
)

GOOD = """
/**:
  ros__parameters: {seed: 3, design: 2-L}
/arena1/sim_node:
  ros__parameters: {seed: 4}
/**/agent_node:
  ros__parameters: {}
"""


def written(tmp_path, text: str):
    path = tmp_path / "params.yaml"
    path.write_text(text)
    return path


def test_named_nodes_are_started_with_common_and_own_parameters(tmp_path):
    parameters = load_parameters(written(tmp_path, GOOD))
    assert parameters == {
        "sim_node": {"seed": 4, "design": "2-L"},
        "agent_node": {"seed": 3, "design": "2-L"},
    }


def test_what_people_try_first_changes_the_files_agent_design_and_seed():
    executing, learning = (load_parameters(packaged(name)) for name in (DEFAULT, "train_2l"))
    pushing = preferred(executing, None, "push-3D", None)
    assert pushing["agent_node"]["checkpoint"] == "shipped:push"
    assert pushing["sim_node"]["preset"] == "push" and pushing["sim_node"]["mode"] == "real_time"
    other = preferred(executing, "shipped:2-L", None, 7)
    assert other["sim_node"]["design"] == "2-L"
    assert {values["seed"] for values in other.values()} == {7}
    taught = preferred(learning, None, "3-D", 7)
    assert taught["sim_node"]["design"] == "3-D" and "checkpoint" not in taught["agent_node"]
    assert {values["seed"] for values in taught.values()} == {7}
    with pytest.raises(ConfigError, match="without a learner_node"):
        preferred(learning, "shipped:2-L", None, None)
    with pytest.raises(ConfigError, match="2-L, 3-D, .*got '3-C': name your agent by --checkpoint"):
        preferred(executing, None, "3-C", None)
    with pytest.raises(ConfigError, match="expected a file with one arena"):
        preferred(fleet(executing, 2), None, None, 7)


@pytest.mark.parametrize("name", ["execute_3d", "execute_avoid", "execute_push"])
def test_the_program_that_a_packaged_file_shows_names_what_is_on_its_table(name):
    (shown,) = re.findall(r'pa_ros send "(.*)"', packaged(name).read_text())
    values = load_parameters(packaged(name))["sim_node"]
    arena = make_arena(values.get("design", "3-D"), seed=values["seed"])
    assert arena.begin(shown) is arena.observation


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "got nothing"),
        ("{", "params.yaml: "),
        ("sim_nod: {ros__parameters: {}}", "'sim_nod'"),
        ("sim_node: {seed: 1}", "ros__parameters alone"),
        ("sim_node: {ros__parameters: 1}", "names and values"),
    ],
)
def test_an_error_says_what_was_received(tmp_path, text, reason):
    with pytest.raises(ConfigError, match=reason):
        load_parameters(written(tmp_path, text))


@pytest.mark.parametrize(
    "keys", [("/arena1/sim_node", "/a/learner_node"), ("/arena1/sim_node", "/arena2/agent_node")]
)  # fmt: skip
def test_nodes_that_belong_to_no_arena_are_refused(tmp_path, keys):
    text = yaml.dump({key: {"ros__parameters": {"seed": i}} for i, key in enumerate(keys)})
    with pytest.raises(ConfigError, match=f"a sim_node each .*, got {keys[1]}"):
        load_parameters(written(tmp_path, text))


FLEET = """
/**: {ros__parameters: {extra: 1}}
/arena1/sim_node: {ros__parameters: {seed: 4}}
/**/sim_node: {ros__parameters: {seed: 3, design: 2-L}}
/arena2/sim_node: {ros__parameters: {preset: paper}}
/arena2/agent_node: {ros__parameters: {learning: true}}
/learner_node: {ros__parameters: {seed: 9}}
"""


def test_nodes_in_several_namespaces_are_a_fleet(tmp_path):
    parameters = load_parameters(written(tmp_path, FLEET))
    assert parameters == {
        "arena1/sim_node": {"extra": 1, "seed": 4, "design": "2-L"},
        "arena2/sim_node": {"extra": 1, "seed": 3, "design": "2-L", "preset": "paper"},
        "arena2/agent_node": {"extra": 1, "learning": True, "agent_id": "arena2"},
        "learner_node": {
            "extra": 1,
            "seed": 9,
            "arenas": ["arena1", "arena2"],
            "agents": ["arena2"],
        },
    }


def test_one_arena_becomes_many(tmp_path):
    one = load_parameters(packaged("train_2l"))
    many = fleet(merged(one, {"sim_node": {"seed": 5}}), 3)
    assert list(many) == [
        *(f"arena{k}/{name}" for k in (1, 2, 3) for name in ("sim_node", "agent_node")),
        "learner_node",
    ]
    assert [many[f"arena{k}/sim_node"]["seed"] for k in (1, 2, 3)] == [5, 6, 7]
    assert many["learner_node"]["arenas"] == ["arena1", "arena2", "arena3"]
    path = tmp_path / "fleet.yaml"
    write_parameters(path, many, "lab")
    assert list(yaml.safe_load(path.read_text()))[-1] == "/lab/learner_node"
    write_parameters(path, many)
    assert load_parameters(path) == many


@pytest.mark.parametrize("arenas", [0, 65])
def test_no_arenas_and_too_many_are_refused(arenas):
    with pytest.raises(ConfigError, match=f"expected 1 to 64, got {arenas}"):
        fleet(load_parameters(packaged("train_2l")), arenas)


def test_a_file_that_does_not_exist_is_named_with_the_packaged_ones():
    with pytest.raises(ConfigError, match="expected a file or one of .*did you mean 'train_2l'"):
        load_parameters(chosen("train_2L"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda p: in_step(p, "exact"),
            "--in-step: expected a parameters file with a learner_node",
        ),
        (lambda p: seeing(p, "corner"), "--perception corner: expected camera, as the agent of"),
        (lambda p: fleet(merged(p, {"sim_node": {"seed": "3"}}), 2), "seed: expected an integer"),
    ],
)
def test_what_would_not_count_is_refused(change, said):
    with pytest.raises(ConfigError, match=said):
        change(load_parameters(packaged("execute_3d")))


def test_a_packaged_file_is_chosen_by_name_and_any_other_by_its_path(tmp_path):
    assert chosen("train_2l") == packaged("train_2l")
    assert chosen(str(tmp_path / "my.yaml")) == tmp_path / "my.yaml"
    assert load_parameters(chosen(DEFAULT))["agent_node"]["checkpoint"] == "shipped:3-D"
    assert all(load_parameters(packaged(name)) for name in packaged_names())


def test_extensions_are_written_for_every_node_without_yaml_aliases_which_rcl_rejects(tmp_path):
    path = tmp_path / "params.yaml"
    given: Parameters = {"agent_node": {}, "learner_node": {"extensions": ["mine"]}}
    more = ["other"]
    write_parameters(path, extended(given, more))
    assert load_parameters(path) == {
        "learner_node": {"extensions": ["mine", "other"]}, "agent_node": {"extensions": more},
    }  # fmt: skip
    write_parameters(path, {name: {"extensions": more} for name in given})
    assert path.read_text().count("other") == 2 and "&" not in path.read_text()


def test_each_launch_has_its_own_folder_and_learns_into_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = [new_folder("launch") for _ in range(3)]
    assert len(set(folders)) == 3 and all(folder.is_dir() for folder in folders)
    training = load_parameters(packaged("train_2l"))
    assert learning_into(folders[0], training)["learner_node"]["out"] == str(folders[0].resolve())
    chosen_by_hand = {"learner_node": {"out": ""}}
    assert learning_into(folders[0], chosen_by_hand) == chosen_by_hand


def test_a_launch_into_a_folder_with_a_run_is_rejected(tmp_path):
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "checkpoint" / "LATEST").write_text("version-000000001")
    with pytest.raises(CheckpointError, match="expected a folder without a run"):
        learning_into(tmp_path, {"learner_node": {}})
    resumed = {"learner_node": {"resume": True}}
    assert learning_into(tmp_path, resumed)["learner_node"]["out"] == str(tmp_path)


LEARNING: Parameters = {"sim_node": {}, "agent_node": {"learning": True}, "learner_node": {}}


def test_agents_of_a_fleet_are_named_after_their_arenas_and_the_learner_gets_the_list():
    spread = fleet(LEARNING, 2)
    assert [spread[f"arena{i}/agent_node"]["agent_id"] for i in (1, 2)] == ["arena1", "arena2"]
    assert spread["learner_node"] == {
        "arenas": ["arena1", "arena2"], "agents": ["arena1", "arena2"],
    }  # fmt: skip
    told = in_step(spread, "exact")["learner_node"]
    assert LearnerNodeConfig(**told).turns == ("arena1", "arena2")
    assert LearnerNodeConfig(**spread["learner_node"]).turns == ()
    greedy = fleet({"sim_node": {}, "agent_node": {}, "learner_node": {}}, 2)
    assert greedy["learner_node"]["agents"] == [] and "agent_id" not in greedy["arena1/agent_node"]


def test_a_fleet_with_ambiguous_agents_is_rejected():
    exact: dict[str, Any] = {"learner.schedule.in_step": "exact"}
    with pytest.raises(ConfigError, match="expected the agent_id of each that learns"):
        LearnerNodeConfig(arenas=("a", "b"), **exact)
    with pytest.raises(ConfigError, match="agents: expected each once"):
        LearnerNodeConfig(agents=("a", "a"))
    with pytest.raises(ConfigError, match="learner_node"):
        in_step({"sim_node": {}}, "exact")
