"""A recorded run is repeated to the last bit, and whatever was altered is found and named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from helpers.recordings import rewritten, train
from pa_ros.bags.episodes import episodes
from pa_ros.bags.errors import BagFullError
from pa_ros.bags.experience import Experience, arenas_of
from pa_ros.bags.format import topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import NAMED, ArenaReplay, verify
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.learning.checkpoint_files import find_checkpoint
from pa_ros.wire.definitions import installed_types

pytestmark = pytest.mark.xdist_group("learning from bags")  # its recordings are made once
FRAMES = 500


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run's `bag` and its `checkpoint`."""
    folder = tmp_path_factory.mktemp("recorded")
    assert train(folder, "--record", folder / "bag", frames=FRAMES) == 0
    return folder


def learned_state(root: Path) -> list[bytes]:
    """Both networks, their targets, Adam's moments, and the replay buffer."""
    checkpoint = find_checkpoint(root / "checkpoint")
    names = ("engine.safetensors", "replay.safetensors")
    return [(checkpoint / name).read_bytes() for name in names]


def learn(out: Path, *arguments: str | Path) -> int:
    return main(["train", "--out", str(out), "--from-bag", *map(str, arguments)])


def verified(bag: Path):
    with Bag(bag) as opened:
        return verify(Experience.read(opened))


def test_recording_changes_nothing(recorded, tmp_path):
    assert train(tmp_path, frames=FRAMES) == 0
    assert learned_state(tmp_path) == learned_state(recorded)


def test_learning_from_the_bag_ends_in_the_live_learners_checkpoint(recorded, tmp_path, capsys):
    assert learn(tmp_path, recorded / "bag") == 0
    assert "5 trajectories, 500 transitions, 500 updates" in capsys.readouterr().out
    assert learned_state(tmp_path) == learned_state(recorded)


def test_verify_finds_every_version_and_transition_equal(recorded, capsys):
    assert main(["verify", str(recorded / "bag")]) == 0
    out = capsys.readouterr().out
    assert "6 versions of the weights are equal" in out and out.rstrip().endswith("EQUAL")
    assert "compared with a fresh arena: 500 transitions" in out
    hashes = [line.split()[-1] for line in out.splitlines() if line.startswith("newest weights")]
    assert len(hashes) == 2 and len(set(hashes)) == 1 and len(hashes[0]) == 64


@pytest.mark.parametrize(
    ("option", "own"),
    [("--algorithm=td3", "dpg"), ("--design=3-D", "2-L"), ("--recipe=paper", "ours")],
)
def test_an_option_that_contradicts_the_recording_is_rejected(
    recorded, tmp_path, option, own, capsys
):
    assert learn(tmp_path / "out", recorded / "bag", option) == 2
    name, _, other = option[2:].partition("=")
    said = capsys.readouterr().err
    assert f"expected the recording's {name} {own}, got {other}" in said
    assert not (tmp_path / "out").exists()


def test_an_option_that_would_not_count_is_rejected(recorded, tmp_path, capsys):
    assert learn(tmp_path / "out", recorded / "bag", "--frames=7", "--eval-every=5") == 2
    assert "expected no evaluate_every_frames, frames: all that was" in capsys.readouterr().err


def altered(field: str, sequence: int, index: int, change):
    """Changes one number of one trajectory."""

    def alter(topic, message):
        if topic == "/trajectories" and message.sequence == sequence:
            values = getattr(message, field).copy()
            values[index] = change(values[index])
            setattr(message, field, values)
        return [message]

    return alter


@pytest.mark.parametrize(
    ("field", "index", "change"),
    [
        ("rewards", 42, lambda reward: -reward),
        ("actions", 42 * 6 + 3, lambda action: np.float32(-0.5) * action + np.float32(0.1)),
        ("arm", 43 * 18, lambda value: np.nextafter(value, np.float32(2))),
        ("objects", 43 * 5 * 16 + 17, lambda value: np.nextafter(value, np.float32(2))),
    ],
)
def test_one_altered_transition_is_found_and_named(
    recorded, tmp_path, capsys, field, index, change
):
    copy = rewritten(recorded / "bag", tmp_path / "copy", altered(field, 2, index, change))
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert "transition 42 of trajectory 2 of agent (episode 2, step 42)" in out
    assert "1 trajectories differ from what the arena gives" in out and "\nEQUAL" not in out


def replayed(bag: Path, **altered):
    """A fresh arena for a bag's description, and the bag's first trajectory."""
    with Bag(bag) as opened:
        experience, (arena,) = Experience.read(opened), arenas_of(opened)
        return ArenaReplay(replace(arena, **altered)), next(experience.used(arena.world)).trajectory


@pytest.mark.parametrize(
    ("parameters", "altered"),
    [({"condition": "train", "blocks": 0}, 0), ({"condition": "eval"}, 3),
     ({"condition": "train", "blocks": 3}, 3)],
)  # fmt: skip
def test_the_arena_is_repeated_as_it_was_started(learned, parameters, altered):
    with Bag(learned) as bag:
        found = Experience.read(bag)
        (arena,) = found.arenas
        own = replace(found.learner, learner=None, instance=arena.arena_id, parameters=parameters)
        assert verify(replace(found, origins=[*found.origins, own])).altered == altered


def test_a_run_that_pushes_is_repeated_with_its_places(tmp_path):
    assert train(tmp_path, "--record", tmp_path / "bag", "--design", "push-2", frames=100) == 0
    assert verified(tmp_path / "bag").equal


def test_an_altered_first_row_is_found_and_named(learned):
    arena, trajectory = replayed(learned)
    trajectory.objects[0, 1, 1] += 1e-3
    assert "transition 0 of trajectory 0" in arena.check(trajectory)


def test_transitions_are_compared_with_the_thresholds_of_their_arena(learned):
    arena, trajectory = replayed(learned, thresholds=(9.0,))
    assert "reward -1.0 recorded, the arena gives 1.0" in arena.check(trajectory)


def test_only_the_first_altered_trajectories_are_described(learned, tmp_path):
    def many(topic, message):
        """Each trajectory becomes three, their actions turned."""
        if topic != "/trajectories":
            return [message]
        turned = replace(message, actions=-message.actions)
        return [replace(turned, sequence=message.sequence + 3 * i) for i in range(3)]

    found = verified(rewritten(learned, tmp_path / "copy", many))
    assert found.altered == 9 and len(found.named) == NAMED
    assert "of trajectory 0 of" in found.named[0]


def test_each_agent_of_several_arenas_has_the_arena_beside_it(learned):
    with Bag(learned) as bag:
        found = Experience.read(bag)
    sides, (arena,), origin = ("left", "right"), found.arenas, found.learner
    arenas = [replace(arena, arena_id=side) for side in sides]
    origins = [
        replace(origin, node=f"/{side}/{node}", instance=instance)
        for side in sides
        for node, instance in (("sim_node", side), ("agent_node", f"agent {side}"))
    ]
    found = replace(found, arenas=arenas, origins=origins)
    assert [found.arena_of(f"agent {side}").arena_id for side in sides] == list(sides)
    assert found.arena_of("agent of no arena") is None


@pytest.mark.parametrize("order", [1, -1])
def test_weights_sent_again_without_their_trajectory_do_not_hide_it(learned, tmp_path, order):
    def again(topic, message):
        if topic != "/policy_weights":
            return [message]
        return [message, replace(message, latest=[])][::order]

    with Bag(rewritten(learned, tmp_path / "copy", again)) as bag:
        latest = [one.latest for one in Experience.read(bag).published.values()]
    assert [one and one.sequence for one in latest] == [None, 0, 1, 2]


def test_a_run_in_exact_order_in_one_process_is_verified(tmp_path):
    exact = "--learner.schedule.in_step=exact"
    assert train(tmp_path, "--record", tmp_path / "bag", exact, frames=100) == 0
    assert verified(tmp_path / "bag").equal


def test_a_reward_alters_the_weights_from_the_version_that_learned_from_it(tmp_path):
    """Without relabeling, which asks the verifier instead of the recorded reward."""
    alone = ("--learner.relabeling.rule=none",
             "--learner.relabeling.programs_per_transition=1")  # fmt: skip
    assert train(tmp_path, "--record", tmp_path / "bag", *alone, frames=FRAMES) == 0
    alter = altered("rewards", 2, 42, lambda reward: -reward)
    found = verified(rewritten(tmp_path / "bag", tmp_path / "copy", alter))
    version = found.compared  # versions 0 to n - 1 are equal, so n is the first that is not
    assert version in (3, 4, 5)
    first, last = 100 * (version - 1) + 1, 100 * version
    assert found.difference == f"version {version} (updates {first} to {last})"
    assert found.recorded != found.computed


def late_beginning(topic, message):
    """Takes away the first step of two episodes, and turns their rewards."""
    if topic != "/trajectories" or message.sequence not in (1, 2):
        return [message]
    return [replace(message, first_step=1, rewards=-message.rewards)]


def another_arena(topic, message):
    """A second arena's description, so that the agent's own is not known."""
    other = [replace(message, arena_id="other")] if topic == "/arena_info" else []
    return [message, *other]


def without_trajectory(number: int):
    def drop(topic, message):
        return [] if topic == "/trajectories" and message.sequence == number else [message]

    return drop


def without_weights(before: int):
    """Weights are recorded from a version on."""

    def drop(topic, message):
        return [] if topic == "/policy_weights" and message.version < before else [message]

    return drop


def late_without_the_first(topic, message):
    return without_weights(4)(topic, message) and without_trajectory(0)(topic, message)


def of_two_agents(topic, message):
    if topic == "/trajectories" and message.sequence % 2:
        return [replace(message, agent_id="other")]
    return without_weights(4)(topic, message)


INCOMPLETE = {
    "no weights": (without_weights(9), "the bag contains no weights"),
    "a missing trajectory": (
        without_trajectory(3), "trajectory 3 of agent, which led to version 4, is not in the bag"
    ),
    "a recording that began too late": (
        late_without_the_first, "what led to versions 1 to 1 is not in the bag"
    ),
    "episodes without a beginning": (
        late_beginning, "200 transitions could not be compared with an arena"
    ),
    "an unknown order of two agents": (
        of_two_agents, "the first 4 versions of the weights were not recorded"
    ),
    "two arenas": (another_arena, "expected the description of the one arena of 'agent', got 2"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "said"), INCOMPLETE.values(), ids=INCOMPLETE)
def test_a_verification_that_did_not_compare_everything_says_so(
    recorded, tmp_path, capsys, change, said
):
    copy = rewritten(recorded / "bag", tmp_path / "copy", change)
    assert main(["verify", str(copy)]) == 1
    out = capsys.readouterr().out
    assert f"INCOMPLETE: {said}" in out and "\nEQUAL" not in out and "DIFFERENT" not in out
    if "--no-arena" in out:
        assert main(["verify", "--no-arena", str(copy)]) == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without_trajectory(3), "1 trajectories were learned from but are not in the bag"),
        (of_two_agents, "4 versions were made before the recording"),
    ],
)
def test_learning_from_an_incomplete_bag_says_so(recorded, tmp_path, capsys, change, said):
    copy = rewritten(recorded / "bag", tmp_path / "copy", change)
    assert learn(tmp_path / "out", copy) == 1
    assert said in capsys.readouterr().out


def test_a_trajectory_that_the_learner_did_not_use_is_left_out(recorded, tmp_path, capsys):
    def add(topic, message):
        if topic != "/trajectories" or message.sequence != 4:
            return [message]
        return [message, replace(message, sequence=5, episode=5)]

    copy = rewritten(recorded / "bag", tmp_path / "copy", add)
    assert learn(tmp_path / "out", copy) == 0
    assert "1 trajectories in the bag were not learned from" in capsys.readouterr().out
    assert learned_state(tmp_path / "out") == learned_state(recorded)


def test_the_order_is_the_learners_whatever_the_order_of_the_recording(recorded, tmp_path):
    """Weights may be received before the trajectory they learned from, and trajectories twice."""
    kept = []

    def shuffle(topic, message):
        if topic != "/trajectories":
            return [message]
        kept.append(message)
        return [] if len(kept) < 5 else [kept[0], *reversed(kept)]

    found = verified(rewritten(recorded / "bag", tmp_path / "copy", shuffle))
    assert found.equal and found.compared == 6


def test_weights_that_were_not_recorded_at_first_are_proved_by_the_first_that_were(
    recorded, tmp_path
):
    copy = rewritten(recorded / "bag", tmp_path / "copy", without_weights(4))
    found = verified(copy)
    assert found.equal and found.compared == 2
    assert learn(tmp_path / "out", copy) == 0
    assert learned_state(tmp_path / "out") == learned_state(recorded)


def test_transitions_alone_can_be_learned_from_but_not_verified(recorded, tmp_path, capsys):
    alone = lambda topic, message: [message] if topic == "/trajectories" else []  # noqa: E731
    copy = rewritten(recorded / "bag", tmp_path / "copy", alone)
    assert main(["verify", str(copy)]) == 2
    assert "it is not known how this run was made" in capsys.readouterr().err
    assert learn(tmp_path / "out", copy, "--network.hidden=16") == 0
    assert "5 trajectories, 500 transitions" in capsys.readouterr().out


def test_agents_of_different_bags_are_kept_apart(recorded, tmp_path, capsys):
    """The second run's agent has the same name and the same numbers."""
    assert train(tmp_path / "b", "--record", tmp_path / "b/bag", "--seed", "6", frames=200) == 0
    bags = [recorded / "bag", tmp_path / "b/bag", recorded / "bag"]
    assert learn(tmp_path / "out", *bags, "--learner.updates.per_frame=0.5") == 0
    assert "7 trajectories, 700 transitions, 350 updates" in capsys.readouterr().out


def test_a_bag_of_another_world_is_rejected_before_anything_is_learned(recorded, tmp_path, capsys):
    other = tmp_path / "b" / "bag"
    assert train(tmp_path / "b", "--record", other, "--design", "3-D", frames=100) == 0
    assert learn(tmp_path / "out", recorded / "bag", other) == 2
    assert f"bag: {other}: expected a recording of the learner's world" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert learn(tmp_path / "out", other, "--design=3-D") == 0  # which the recording says, too


def test_a_resumed_run_is_not_verified(tmp_path, capsys):
    assert train(tmp_path, frames=100) == 0
    assert train(tmp_path, "--resume", "--record", tmp_path / "bag", frames=200) == 0
    assert main(["verify", str(tmp_path / "bag")]) == 2
    assert "got one resumed at version 1" in capsys.readouterr().err


def test_a_run_with_few_recorded_versions_is_verified_completely(tmp_path):
    arguments = ["--learner.schedule.trajectory_steps=1", "--learner.schedule.policy_lag=0"]
    assert train(tmp_path, "--record", tmp_path / "bag", *arguments, frames=200) == 0
    with Bag(tmp_path / "bag") as bag:
        assert bag.counts["/trajectories"] == 200 and bag.counts["/policy_weights"] == 3
        assert [len(episode.rows) for episode in episodes(bag)] == [101, 101]
    found = verified(tmp_path / "bag")
    assert found.equal and (found.compared, found.version, found.checked) == (3, 200, 200)


def test_a_run_continues_when_the_disk_of_its_recording_is_full(tmp_path, monkeypatch):
    def full(self, *_):
        raise BagFullError("no space left")

    monkeypatch.setattr("pa_ros.bags.writer.BagWriter.flush", full)
    monkeypatch.setattr("pa_ros.bags.run_log.FLUSH_S", 0.0)
    assert train(tmp_path, "--record", tmp_path / "bag", frames=300) == 1
    assert len(learned_state(tmp_path)[0]) > 1000


@pytest.mark.parametrize("wrong", [["--learner.engine.device=xla"], ["--resume"], []])
def test_a_rejected_run_leaves_no_bag(recorded, tmp_path, wrong):
    out = tmp_path / "out" if wrong else recorded  # which contains a run
    assert train(out, "--record", tmp_path / "bag", *wrong) == 2
    assert not [*tmp_path.iterdir()]


def test_a_namespace_selects_one_of_several_arenas(recorded, tmp_path, capsys):
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
    assert learn(tmp_path / "out", tmp_path / "both", "--namespace", "/one") == 0
    assert learned_state(tmp_path / "out") == learned_state(recorded)
