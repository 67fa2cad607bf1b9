"""A recorded run can be made again to the last bit, and what was altered is found and named."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from helpers.recordings import rewritten, train
from pa_ros.bags.contents import topic
from pa_ros.bags.errors import BagFullError
from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import verify
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.learning.checkpoints import find_checkpoint
from pa_ros.wire.definitions import installed_types

pytestmark = pytest.mark.xdist_group("learning from bags")  # its recordings are made once
FRAMES = 500


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run's `bag` and its `checkpoint`."""
    folder = tmp_path_factory.mktemp("recorded")
    assert train(folder, "--record", folder / "bag", frames=FRAMES) == 0
    return folder


def checkpoint_file(root: Path, name: str) -> bytes:
    return (find_checkpoint(root / "checkpoint") / name).read_bytes()


def verified(bag: Path):
    with Bag(bag) as opened:
        return verify(Experience(opened))


def test_recording_changes_nothing(recorded, tmp_path):
    assert train(tmp_path, frames=FRAMES) == 0
    for name in ("engine.safetensors", "replay.safetensors"):
        assert checkpoint_file(tmp_path, name) == checkpoint_file(recorded, name)


def test_learning_from_the_bag_ends_in_the_live_learners_checkpoint(recorded, tmp_path, capsys):
    """All of it: both networks, their targets, Adam's moments, the replay memory."""
    assert main(["train", "--from-bag", str(recorded / "bag"), "--out", str(tmp_path)]) == 0
    assert "5 trajectories, 500 transitions, 500 updates" in capsys.readouterr().out
    for name in ("engine.safetensors", "replay.safetensors"):
        assert checkpoint_file(tmp_path, name) == checkpoint_file(recorded, name)


PAID = '{"name":"sparse","otherwise":-1.0,"satisfied":%s}'


@pytest.mark.parametrize(("option", "own"), [
    ("--algorithm=td3", "dpg"), ("--design=3-D", "2-L"), ("--protocol=paper", "ours"),
    (f"--reward={PAID % 2.0}", PAID % 1.0), ("--network=canonical", "programmable"),
])  # fmt: skip
def test_what_the_recording_says_is_not_asked_for_in_vain(recorded, tmp_path, option, own, capsys):
    out = tmp_path / "out"
    assert main(["train", "--from-bag", str(recorded / "bag"), "--out", str(out), option]) == 2
    name, _, other = option[2:].partition("=")
    said = capsys.readouterr().err
    assert f"expected the recording's own {name}, which" in said
    assert f"{name} {own}, got {name} {other}" in said
    assert not out.exists() or not [path for path in out.iterdir() if path.name != ".lock"]


def test_verify_finds_every_version_equal(recorded, capsys):
    assert main(["verify", str(recorded / "bag")]) == 0
    out = capsys.readouterr().out
    assert "6 versions of the weights are equal" in out and out.rstrip().endswith("EQUAL")
    assert "held against a fresh arena: 500 transitions" in out
    hashes = [line.split()[-1] for line in out.splitlines() if line.startswith("newest weights")]
    assert len(hashes) == 2 and len(set(hashes)) == 1 and len(hashes[0]) == 64


def test_verify_of_a_bag_with_parts_unseen_is_incomplete(recorded, tmp_path, capsys):
    copy = tmp_path / "bag"
    shutil.copytree(recorded / "bag", copy)
    about = copy / "metadata.yaml"
    content = yaml.safe_load(about.read_text())
    note = "bag.mcap: 1 damaged chunks were passed over"
    content["rosbag2_bagfile_information"]["custom_data"]["pa_ros.repaired"] = note
    about.write_text(yaml.safe_dump(content))
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert f"INCOMPLETE: parts of the bag were damaged and not seen: {note}" in out
    assert "\nEQUAL" not in out


def altered(field: str, sequence: int, index: int, change):
    def alter(topic, message):
        if topic == "/trajectories" and message.sequence == sequence:
            values = getattr(message, field).copy()
            values[index] = change(values[index])
            setattr(message, field, values)
        return [message]

    return alter


@pytest.mark.parametrize(
    ("field", "index", "change", "transition"),
    [
        ("rewards", 42, lambda reward: -reward, 42),
        ("actions", 42 * 6 + 3, lambda action: np.float32(-0.5) * action + np.float32(0.1), 42),
        ("arm", 43 * 18, lambda value: np.nextafter(value, np.float32(2)), 42),
        ("objects", 43 * 5 * 16 + 17, lambda value: np.nextafter(value, np.float32(2)), 42),
    ],
)
def test_one_altered_transition_is_found_and_named(
    recorded, tmp_path, capsys, field, index, change, transition
):
    alter = altered(field, 2, index, change)
    copy = rewritten(recorded / "bag", tmp_path / "copy", alter)
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert f"transition {transition} of trajectory 2 of agent (episode 2, step 42)" in out
    assert "1 trajectories are not what the arena gives" in out and "\nEQUAL" not in out


def test_what_no_arena_was_asked_about_is_not_called_equal(recorded, tmp_path, capsys):
    """Under all-goals relabeling the weights don't tell of altered rewards."""

    def begin_later(topic, message):
        if topic != "/trajectories" or message.sequence not in (1, 2):
            return [message]
        return [replace(message, first_step=1, rewards=-message.rewards)]

    copy = rewritten(recorded / "bag", tmp_path / "copy", begin_later)
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert "INCOMPLETE: 200 transitions of episodes whose beginning is not recorded" in out
    assert "held against a fresh arena: 300 transitions" in out
    assert "\nEQUAL" not in out and "DIFFERENT" not in out
    assert main(["verify", "--no-arena", str(copy)]) == 0


def test_the_rest_of_an_episode_that_the_arena_denied_is_not_said_to_lack_its_beginning(
    tmp_path, capsys
):
    short = "--set=learner.schedule.trajectory_steps=25"
    assert train(tmp_path, "--record", tmp_path / "bag", short, frames=200) == 0
    alter = altered("rewards", 1, 12, lambda reward: -reward)
    copy = rewritten(tmp_path / "bag", tmp_path / "copy", alter)
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert "1 trajectories are not what the arena gives" in out and "INCOMPLETE" not in out


ALONE = ("--set=learner.relabeling.rule=none", "--set=learner.relabeling.programs_per_transition=1")


def test_a_reward_alters_the_weights_from_the_version_that_learned_from_it(recorded, tmp_path):
    """Without relabeling, which asks the verifier instead of the recorded reward."""
    run = tmp_path / "run"
    assert train(run, "--record", run / "bag", *ALONE, frames=FRAMES) == 0
    alter = altered("rewards", 2, 42, lambda reward: -reward)
    found = verified(rewritten(run / "bag", tmp_path / "copy", alter))
    version = found.compared  # versions 0 to n - 1 are equal, so n is the first that is not
    assert version in (3, 4, 5)
    first, last = 100 * (version - 1) + 1, 100 * version
    assert found.difference == f"version {version} (updates {first} to {last})"
    assert found.recorded != found.remade


def test_weights_that_their_own_checksum_belies_are_refused(recorded, tmp_path, capsys):
    def damage(topic, message):
        if topic == "/policy_weights" and message.version == 3:
            message.payload = message.payload.copy()
            message.payload[7] ^= 1
        return [message]

    copy = rewritten(recorded / "bag", tmp_path / "damaged", damage)
    assert main(["verify", str(copy)]) == 2
    assert "checksum" in capsys.readouterr().err


def test_a_trajectory_that_is_missing_is_named(recorded, tmp_path, capsys):
    def drop(topic, message):
        return [] if topic == "/trajectories" and message.sequence == 3 else [message]

    copy = rewritten(recorded / "bag", tmp_path / "copy", drop)
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert "INCOMPLETE: trajectory 3 of agent, which led to version 4, is not in the bag" in out
    assert main(["train", "--from-bag", str(copy), "--out", str(tmp_path / "out")]) == 1
    assert "1 trajectories were learned from but are not in the bag" in capsys.readouterr().out


def test_what_the_recorded_learner_never_took_is_left_out(recorded, tmp_path, capsys):
    """A trajectory that was sent when the learner had stopped, or that it had refused."""

    def add(topic, message):
        if topic != "/trajectories" or message.sequence != 4:
            return [message]
        return [message, replace(message, sequence=5, episode=5)]

    copy = rewritten(recorded / "bag", tmp_path / "copy", add)
    assert main(["train", "--from-bag", str(copy), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "1 trajectories are in the bag, but its learner had not taken them in" in out
    assert "5 trajectories, 500 transitions, 500 updates" in out
    for name in ("engine.safetensors", "replay.safetensors"):
        assert checkpoint_file(tmp_path / "out", name) == checkpoint_file(recorded, name)


def test_order_is_the_learners_whatever_the_order_of_the_recording(recorded, tmp_path):
    """Weights may be heard before the trajectory that they come from, and trajectories twice."""
    kept = []

    def shuffle(topic, message):
        if topic != "/trajectories":
            return [message]
        kept.append(message)
        return [] if len(kept) < 5 else [kept[0], *reversed(kept)]

    found = verified(rewritten(recorded / "bag", tmp_path / "copy", shuffle))
    assert found.equal and found.compared == 6


def test_without_weights_and_provenance_there_is_learning_but_no_verifying(
    recorded, tmp_path, capsys
):
    def strip(topic, message):
        return [message] if topic == "/trajectories" else []

    copy = rewritten(recorded / "bag", tmp_path / "copy", strip)
    assert main(["verify", str(copy)]) == 2
    assert "nothing says how this run was made" in capsys.readouterr().err
    out = ["--out", str(tmp_path / "out"), "--set=network.hidden=16"]
    assert main(["train", "--from-bag", str(copy), *out]) == 0
    assert "5 trajectories, 500 transitions" in capsys.readouterr().out


def test_many_bags_at_another_rate(recorded, tmp_path, capsys):
    """The second run's agent has the same name and the same numbers, and is another."""
    assert train(tmp_path / "b", "--record", tmp_path / "b/bag", "--seed", "6", frames=200) == 0
    bags = [str(recorded / "bag"), str(tmp_path / "b/bag"), str(recorded / "bag")]
    out = ["--out", str(tmp_path / "out"), "--set", "learner.updates.per_frame=0.5"]
    assert main(["train", "--from-bag", *bags, *out]) == 0
    assert "7 trajectories, 700 transitions, 350 updates" in capsys.readouterr().out


def test_a_bag_of_another_world_is_refused_before_anything_is_learned(recorded, tmp_path, capsys):
    other = tmp_path / "b" / "bag"
    assert train(tmp_path / "b", "--record", other, "--design", "3-D", frames=100) == 0
    out = tmp_path / "out"
    assert main(["train", "--out", str(out), "--from-bag", str(recorded / "bag"), str(other)]) == 2
    error = capsys.readouterr().err
    assert f"bag: {other}: expected a recording of the world" in error
    assert not out.exists()


def test_a_resumed_run_is_not_verified(recorded, tmp_path, capsys):
    assert train(tmp_path, frames=100) == 0
    assert train(tmp_path, "--resume", "--record", tmp_path / "bag", frames=200) == 0
    assert main(["verify", str(tmp_path / "bag")]) == 2
    assert "got one resumed at version 1" in capsys.readouterr().err


def test_weights_are_recorded_less_often_than_every_frame_and_all_is_verified(tmp_path):
    arguments = ["--set=learner.schedule.trajectory_steps=1", "--set=learner.schedule.policy_lag=0"]
    assert train(tmp_path, "--record", tmp_path / "bag", *arguments, frames=200) == 0
    with Bag(tmp_path / "bag") as bag:
        assert bag.counts == {
            "/provenance": 1, "/arena_info": 1, "/learner_info": 1, "/trajectories": 200,
            "/policy_weights": 3,
        }  # fmt: skip
    found = verified(tmp_path / "bag")
    assert found.equal and (found.compared, found.version, found.reenacted) == (3, 200, 200)


def test_a_run_outlives_a_full_disk(tmp_path, monkeypatch):
    def refuse(self, *_):
        raise BagFullError("no space left")

    monkeypatch.setattr("pa_ros.bags.writer.BagWriter.flush", refuse)
    monkeypatch.setattr("pa_ros.bags.run_log.FLUSH_S", 0.0)
    assert train(tmp_path, "--record", tmp_path / "bag", frames=300) == 1
    assert len(checkpoint_file(tmp_path, "engine.safetensors")) > 1000
    with Bag(tmp_path / "bag") as bag:
        assert bag.counts["/trajectories"] == 1


@pytest.mark.parametrize("refused", [["--set=learner.engine.device=xla"], ["--resume"], []])
def test_a_run_that_is_refused_leaves_no_bag(recorded, tmp_path, refused):
    out = tmp_path / "out" if refused else recorded  # which is used
    assert train(out, "--record", tmp_path / "bag", *refused) == 2
    assert not [*tmp_path.iterdir()]


def test_one_of_several_arenas_is_chosen_by_its_namespace(recorded, tmp_path, capsys):
    """Two arenas in one recording: which one is meant must be said."""
    store = installed_types()
    with Bag(recorded / "bag") as source, BagWriter(tmp_path / "both") as target:
        for where in ("/one", "/two"):
            for name, type_name in source.types.items():
                target.add(topic(store, where + name, type_name, source.qos(name)))
        for message in source.messages():
            for where in ("/one", "/two"):
                target.write(where + message.topic, message.payload, message.stamp_ns)
    assert main(["verify", str(tmp_path / "both")]) == 2
    assert "choose with --namespace" in capsys.readouterr().err
    assert main(["verify", str(tmp_path / "both"), "--namespace", "two"]) == 0
    out = ["--out", str(tmp_path / "out"), "--namespace", "/one"]
    assert main(["train", "--from-bag", str(tmp_path / "both"), *out]) == 0
    assert checkpoint_file(tmp_path / "out", "engine.safetensors") == checkpoint_file(
        recorded, "engine.safetensors"
    )


def begun_late(first: int, several: bool = False, lacking: int = -1):
    """A recorder that heard no weights before a version; of `several` agents, if told so."""

    def change(topic, message):
        if several and topic == "/trajectories" and message.sequence % 2:
            return [replace(message, agent_id="other")]
        if topic == "/policy_weights" and message.version < first:
            return []
        return [] if topic == "/trajectories" and message.sequence == lacking else [message]

    return change


def test_first_versions_that_were_not_heard_are_proved_by_the_first_that_was(
    recorded, tmp_path, capsys
):
    copy = rewritten(recorded / "bag", tmp_path / "copy", begun_late(4))
    assert main(["verify", str(copy)]) == 0
    assert "2 versions of the weights are equal" in capsys.readouterr().out
    assert main(["train", "--from-bag", str(copy), "--out", str(tmp_path / "out")]) == 0
    for name in ("engine.safetensors", "replay.safetensors"):
        assert checkpoint_file(tmp_path / "out", name) == checkpoint_file(recorded, name)


def test_of_a_recording_that_began_too_late_it_is_said(recorded, tmp_path, capsys):
    copy = rewritten(recorded / "bag", tmp_path / "late", begun_late(4, lacking=0))
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert "INCOMPLETE: what led to versions 1 to 1 is not in the bag" in out
    assert "DIFFERENT" not in out and "\nEQUAL" not in out


def test_an_order_that_is_not_known_is_not_called_different(recorded, tmp_path, capsys):
    kept = []

    def swapped(topic, message):
        """The second trajectory is recorded before the first, and is of another agent."""
        found = begun_late(4, several=True)(topic, message)
        if topic == "/policy_weights":
            for one in found:
                one.consumed = [
                    replace(one.consumed[0], sequence=4),
                    replace(one.consumed[0], sequence=3, agent_id="other"),
                ]
                one.latest = [] if one.version == 4 else one.latest
        if topic != "/trajectories" or message.sequence > 1:
            return found
        kept[:0] = found
        return kept if len(kept) == 2 else []

    copy = rewritten(recorded / "bag", tmp_path / "copy", swapped)
    assert main(["verify", "--no-arena", str(copy)]) == 1
    out = capsys.readouterr().out
    assert "INCOMPLETE: the first 4 versions of the weights were not heard" in out
    assert "DIFFERENT" not in out
    assert main(["train", "--from-bag", str(copy), "--out", str(tmp_path / "out")]) == 1
    assert "4 versions are from before the recording" in capsys.readouterr().out


@pytest.mark.parametrize("arenas", [0, 2])
def test_transitions_that_no_one_arena_can_be_asked_about_are_said(
    recorded, tmp_path, capsys, arenas
):
    def change(topic, message):
        if topic != "/arena_info":
            return [message]
        return [replace(message, arena_id=f"{message.arena_id}{n}") for n in range(arenas)]

    copy = rewritten(recorded / "bag", tmp_path / "copy", change)
    if arenas:
        assert main(["verify", str(copy)]) == 1
        assert "expected one arena's description to hold trans" in capsys.readouterr().out
        assert main(["verify", "--no-arena", str(copy)]) == 0
    else:  # nor is it known what was rewarded
        assert main(["verify", str(copy)]) == 2
