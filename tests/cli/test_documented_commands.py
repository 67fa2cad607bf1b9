"""Commands that README and docs show are what programs take. `make docs-check` runs them, too."""

import re

import pytest
import yaml
from lifecycle_msgs.msg import Transition

from agent_node.config import AgentConfig
from helpers.documents import ALL_NODES, COMMANDS, ROOT, Command
from learner_node.config import LearnerNodeConfig
from pa_ros.cli import main as cli
from pa_ros.core.settings import Settings
from pa_ros.ros import actions, topics
from sim_node.config import SimConfig
from sim_node.robot.node import RobotConfig

CONFIGS: dict[str, type[Settings]] = {
    "sim_node": SimConfig,
    "agent_node": AgentConfig,
    "learner_node": LearnerNodeConfig,
    "robot_node": RobotConfig,
}
ACTIONS = dict([actions.EXECUTE_PROGRAM, actions.SIMULATE_STEPS])


def of(*programs: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize(
        "command", [c for c in COMMANDS if c.program in programs], ids=str
    )


@pytest.fixture(autouse=True)
def at_the_root(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)


@of("pa_ros")
def test_options_are_taken_as_they_stand(command: Command):
    given = command.words[1:]
    cli.load_extensions(given)
    name = next(word for word in given if word in cli.COMMANDS)
    options = cli.build_parser(name).parse_args(given)
    assert options.command == name


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.output], ids=str)
def test_what_is_shown_is_what_is_printed(command: Command, capsys: pytest.CaptureFixture[str]):
    status = cli.main(command.words[1:])
    out, err = capsys.readouterr()
    assert status == (2 if err else 0)
    assert out + err.encode("ascii", "replace").decode() == command.output


@of("make")
def test_make_has_the_target(command: Command):
    targets = re.findall(r"^([\w%-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    known = "|".join(target.replace("%", r"[\w-]+") for target in targets)
    wanted = [word for word in command.words[1:] if "=" not in word]
    assert wanted and all(re.fullmatch(known, word) for word in wanted)


@of(*ALL_NODES)
def test_a_nodes_parameters_and_files_are_there(command: Command):
    assert command.words[1] == "--ros-args"
    for option, value in zip(command.words[2::2], command.words[3::2], strict=True):
        if option == "--params-file":
            assert (ROOT / value).is_file()
        elif option == "-p":
            name, _, text = value.partition(":=")
            CONFIGS[command.program]().changed(**{name: yaml.safe_load(text)})
        else:
            assert option == "-r" and re.fullmatch(r"[\w/]+:=[\w/]+", value)


@of("python")
def test_a_file_that_python_runs_is_there(command: Command):
    assert (ROOT / command.words[1]).is_file()


def interface(kind: str, name: str) -> type:
    """The type that the graph has for a topic, service or action."""
    if kind == "action":
        return ACTIONS[name]
    for value in vars(topics).values():
        if kind == "topic" and isinstance(value, topics.Topic) and value.name == name:
            return value.type
        if kind == "service" and isinstance(value, tuple) and value[0] == name:
            return value[1]
    raise LookupError(f"{kind} {name}")


def fill(message, values: dict[str, object]) -> None:
    """Set fields as the stock tools do: nested messages by mappings."""
    for field, value in values.items():
        assert field in message.get_fields_and_field_types()
        if isinstance(value, dict):
            fill(getattr(message, field), value)
        else:
            setattr(message, field, type(getattr(message, field))(value))


@of("ros2")
def test_what_a_stock_tool_is_told_is_of_the_graph(command: Command):
    kind, verb, *given = command.words[1:]
    if kind in ("run", "launch"):
        files = [path.name for path in ROOT.glob(f"{verb}/launch/*.py")]
        assert given[0] == verb if kind == "run" else given[0] in files
        return
    if kind == "lifecycle":
        node, transition = given
        assert verb == "set" and node.strip("/") in ALL_NODES
        assert hasattr(Transition, f"TRANSITION_{transition.upper()}")
        return
    name = next(word for word in given if word.startswith("/"))
    type_ = interface(kind, name.lstrip("/"))
    (told,) = [word for word in given if re.fullmatch(r"\w+/(msg|srv|action)/\w+", word)]
    assert told.split("/") == [type_.__module__.split(".")[0], *_of(type_)]
    if given[-1].startswith("{"):
        parts = {"service": "Request", "action": "Goal"}
        filled = getattr(type_, parts[kind]) if kind in parts else type_
        fill(filled(), yaml.safe_load(given[-1]))


def _of(type_: type) -> list[str]:
    """Folder and name of an interface."""
    return [type_.__module__.split(".")[1], type_.__name__]
