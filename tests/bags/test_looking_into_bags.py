"""Info, export and film: what is told, stored and drawn is what was recorded."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from films import captions
from mcap.reader import make_reader
from PIL import Image, ImageSequence
from recorded_runs import rewritten, train
from rerun_files import columns

from pa_ros.arena import ARMS, ReachTask, design_named, preset_named
from pa_ros.arena.movie import captioned
from pa_ros.arena.rearranging import bodies, rearrange
from pa_ros.arena.render import top_view
from pa_ros.bags.contents import reliable_qos, topic
from pa_ros.bags.episodes import episodes
from pa_ros.bags.experience import arenas_of
from pa_ros.bags.film import Stage
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.core.body import Body
from pa_ros.core.experience import Observation, Verdict
from pa_ros.core.signals import EXIT_INTERRUPTED
from pa_ros.language import Program, parse
from pa_ros.provenance.origins import describe
from pa_ros.tools.scenes import name_of
from pa_ros.wire import codec
from pa_ros.wire.definitions import installed_types, message_type, to_cdr
from pa_ros.wire.records import Command, ProgramRequest, StepContext
from pa_ros.world.schema import PAPER

pytestmark = pytest.mark.xdist_group("looking into bags")  # its recordings are made once
STEPS = 30
Step = tuple[Observation, Verdict, Command | None, Program, bool]
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ARENA, DESIGN = preset_named("fast"), design_named("2-L")


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of transitions: three episodes of a run in one process."""
    folder = tmp_path_factory.mktemp("learned")
    assert train(folder, "--record", folder / "bag", frames=300) == 0
    return folder / "bag"


def rearranged() -> list[Step]:
    """An episode in which the first block is removed, and two others are put down later."""
    task, found = ReachTask(ARENA, DESIGN, 3), list[Step]()
    observation, verdict = task.reset(7)
    kinds = [block.kind for block in task.episode.blocks]
    for step in range(9):
        if step == 3:
            rearrange(task, kinds[1:], bodies(task)[2:])
        if step == 6:
            corners = [Body.at_rest(np.array([x, -0.4, 0.0]), UPRIGHT) for x in (-0.4, -0.3)]
            spare = kinds[0].but(color="GREEN")
            rearrange(task, [*kinds[1:], kinds[0], spare], [*bodies(task)[1:], *corners])
        found.append((observation, verdict, None, task.program, False))
        observation, verdict = task.step(np.full(6, 0.2))
    return found


def acted() -> list[Step]:
    """Two short episodes: training 7, evaluation 7; with the commands that led on."""
    task, rng, found = ReachTask(ARENA, DESIGN, 3), np.random.default_rng(0), []
    for evaluation in (False, True):
        observation, verdict = task.reset(7, "eval" if evaluation else "train")
        for step in range(STEPS + 1):
            action = rng.uniform(-1, 1, 6).astype(np.float32)
            stamp = observation.stamp_ns
            command = Command(7, step, stamp, "a", 4, action) if step < STEPS else None
            found.append((observation, verdict, command, task.program, evaluation))
            if command is not None:
                observation, verdict = task.step(action * np.array(ARENA.joint_speed_limits))
    return found


@pytest.fixture(scope="module")
def stepped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the arena's topics, parts of a step in changing order, one step sent twice."""
    return recorded(tmp_path_factory.mktemp("stepped") / "bag", acted())


@pytest.fixture(scope="module")
def changing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the episode in which there are fewer blocks, then more."""
    return recorded(tmp_path_factory.mktemp("changing") / "bag", rearranged())


def recorded(folder: Path, steps: list[Step]) -> Path:
    store = installed_types()
    with BagWriter(folder) as bag:
        clock = iter(range(10**18, 10**18 + 10**9, 1000))
        declared: set[str] = set()

        def write(name: str, message) -> None:
            if name not in declared:
                declared.add(name)
                kind = message_type(type(message))
                bag.add(topic(store, name, kind, [reliable_qos(100)]))
            bag.write(name, to_cdr(store, message), next(clock))

        about = describe(ARENA, DESIGN, 3, [parse("NEAR(HAND, RED)", DESIGN.vocabulary)], "x")
        write("/arena_info", codec.encode_arena_info(about))
        for i, (observation, verdict, command, program, evaluation) in enumerate(steps):
            if observation.step == 0:
                request = ProgramRequest(observation.program_id, str(program))
                write("/program", codec.encode_program(request))
            features, joints = codec.encode_observation(
                observation, ARMS["jaco"].joint_names, StepContext(evaluation=evaluation)
            )
            parts = [
                ("/joint_states", joints),
                ("/object_features", features),
                ("/verdict", codec.encode_verdict(verdict, evaluation)),
            ]
            if command is not None:
                parts.append(("/joint_commands", codec.encode_command(command)))
            for name, message in parts if i % 2 else reversed(parts):
                write(name, message)
            if i == 5:
                write("/object_features", features)
    return folder


def test_steps_are_put_together_as_they_were(stepped):
    with Bag(stepped) as bag:
        found = list(episodes(bag))
    assert [(e.number, e.evaluation, len(e.rows), e.missing) for e in found] == [
        (7, False, STEPS + 1, 0), (7, True, STEPS + 1, 0),
    ]  # fmt: skip
    rows = [row for episode in found for row in episode.rows]
    for row, (observation, verdict, command, program, _) in zip(rows, acted(), strict=True):
        assert (row.step, row.program) == (observation.step, str(program))
        np.testing.assert_array_equal(row.objects, observation.objects)
        np.testing.assert_array_equal(row.joint_position, observation.joint_position)
        np.testing.assert_array_equal(row.joint_velocity, observation.joint_velocity)
        assert (row.reward, row.distance) == (verdict.reward, verdict.distance)
        if command is None:
            assert len(row.action) == 0 and row.policy_version == -1
        else:
            np.testing.assert_array_equal(row.action, command.action)
            assert row.policy_version == 4


def test_the_stage_shows_what_was_recorded(stepped, learned, changing):
    """The features of the scene put up again are those recorded: blocks and hand are in place."""
    for path, tolerance, every in ((stepped, 1e-5, 7), (learned, 1e-5, 7), (changing, 1e-5, 1)):
        with Bag(path) as bag:
            episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
        stage = Stage(episode, arena)
        for row in episode.rows[::every]:
            stage.show(row)
            given = stage.task.simulation.objects()
            np.testing.assert_allclose(given[:, :3], row.objects[:, :3], atol=tolerance)
            turned = np.abs(np.sum(given[:, 3:7] * row.objects[:, 3:7], axis=1))
            np.testing.assert_allclose(turned, 1.0, atol=tolerance)
            np.testing.assert_array_equal(given[:, 7:], row.objects[:, 7:])


def test_a_film_has_a_picture_of_each_step_at_the_arenas_speed(stepped, tmp_path, capsys):
    out = tmp_path / "film.gif"
    arguments = ["--episode", "7", "--evaluation", "--side", "96", "--out", str(out)]
    assert main(["bag", "film", str(stepped), *arguments]) == 0
    with Image.open(out) as film:
        assert film.format == "GIF" and film.size == (96, 126)  # with its caption
        assert film.info["duration"] == 100
        pictures = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(film)]
    shown = len(pictures)
    assert (pictures[-1] != pictures[0]).any()
    assert STEPS // 2 < shown <= STEPS + 1  # equal pictures in a row are stored once
    assert main(["bag", "film", str(stepped), "--episode", "8", "--out", str(out)]) == 2
    assert "expected an episode of 7 to 7, got 8" in capsys.readouterr().err
    movie = tmp_path / "film.avi"
    assert main(["bag", "film", str(stepped), *arguments[:-1], str(movie)]) == 2
    assert "expected a file that ends in .gif or .mp4, got '.avi'" in capsys.readouterr().err
    assert not movie.exists()


def test_a_film_goes_on_where_blocks_come_and_go(changing, tmp_path, capsys):
    out = str(tmp_path / "film.gif")
    assert main(["bag", "film", str(changing), "--episode", "7", "--side", "64", "--out", out]) == 0
    assert "9 pictures" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", "a-program-id", "NEAR(HAND, AND(CYLINDER, CAPSULE))"])
def test_a_film_shows_no_target_where_none_is_known(stepped, text):
    """Before the first program, and where it is gone or names nothing."""
    with Bag(stepped) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    known = episode.rows[4]
    for row in episode.rows[:4] + episode.rows[5:]:
        row.program = text
    stage, targets = Stage(episode, arena), []
    for row in episode.rows[:9]:
        stage.show(row)
        targets.append(len(stage.task.verifier.targets))
        top_view(stage.task, 64)
    assert known.program and targets == [0] * 4 + [1] + [0] * 4


def test_a_film_needs_no_block_that_has_a_word(stepped):
    with Bag(stepped) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    spare = list(PAPER.features({"shape": "CAPSULE", "color": "MAGENTA"})[7:])
    for row in episode.rows:
        row.objects[1:, 7:] = spare
    stage = Stage(episode, arena)
    stage.show(episode.rows[0])
    assert stage.task.verifier.targets == ()


def test_a_film_tells_the_program_the_step_and_the_reward(stepped, tmp_path, monkeypatch):
    said = captions(monkeypatch, "pa_ros.bags.film.captioned")
    out = str(tmp_path / "film.gif")
    arguments = ["--episode", "7", "--side", "64", "--out", out]
    assert main(["bag", "film", str(stepped), *arguments]) == 0
    steps = acted()[: STEPS + 1]
    for (program, state), (_, verdict, _, asked, _) in zip(said, steps, strict=True):
        assert program == str(asked) and f"distance {verdict.distance:.2f} m" in state
    assert said[0][1].startswith("step 0") and f"step {STEPS}   reward" in said[-1][1]


def test_exported_arrays_are_what_was_recorded(stepped, tmp_path, capsys):
    assert main(["bag", "export", str(stepped), "--out", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "episodes.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["file"] for row in table] == ["episode-000007.npz", "eval-000007.npz"]
    steps = acted()
    rewards = [verdict.reward for _, verdict, *_ in steps[1 : STEPS + 1]]
    assert float(table[0]["reward_per_step"]) == pytest.approx(np.mean(rewards))
    with np.load(tmp_path / "out" / "eval-000007.npz") as arrays:  # pickles are refused
        assert arrays["objects"].shape == (STEPS + 1, 5, 16)
        assert arrays["program"][0] == str(steps[-1][3])
        np.testing.assert_array_equal(arrays["step"], np.arange(STEPS + 1))
        expected = [o.stamp_ns / 1e9 for o, *_ in steps[STEPS + 1 :]]
        np.testing.assert_allclose(arrays["stamp_s"], expected)
    assert main(["bag", "export", str(stepped), "--out", str(tmp_path / "out")]) == 2
    assert "exists already" in capsys.readouterr().err


def test_exported_objects_that_are_not_there_are_nan(changing, tmp_path):
    assert main(["bag", "export", str(changing), "--out", str(tmp_path)]) == 0
    steps = [observation.objects for observation, *_ in rearranged()]
    counts = [len(objects) for objects in steps]
    assert len(set(counts)) == 3
    with np.load(tmp_path / "episode-000007.npz") as arrays:
        assert arrays["objects"].shape == (9, max(counts), 16)
        assert arrays["objects"].dtype == np.float32
        for given, objects in zip(arrays["objects"], steps, strict=True):
            np.testing.assert_array_equal(given[: len(objects)], objects)
            assert np.isnan(given[len(objects) :]).all()


def test_a_file_for_rerun_follows_blocks_that_come_and_go(changing, tmp_path):
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    path = tmp_path / "out.rrd"
    assert main(["bag", "export", str(changing), "--rerun", str(path)]) == 0
    told = columns(path)
    with Bag(changing) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    stage = Stage(episode, arena)
    seen: dict[str, int] = {}
    for row in episode.rows:
        stage.show(row)
        for i, block in enumerate(stage.task.episode.blocks, start=1):
            name = name_of(block.kind.words, DESIGN.vocabulary.row).lower().replace(" ", "_")
            (pose,) = told[f"/world/blocks/{name} Transform3D:translation"][seen.get(name, 0)][1]
            assert pose == pytest.approx(stage.task.simulation.positions[i].tolist(), abs=1e-6)
            seen[name] = seen.get(name, 0) + 1
    assert sorted(set(seen.values())) == [2, 6, 9]  # the last one, the one that left, the others


def test_a_file_for_rerun_that_fails_is_not_left_behind(changing, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    path = tmp_path / "out.rrd"

    def show(*_):
        raise RuntimeError("no such scene")

    monkeypatch.setattr(Stage, "show", show)
    with pytest.raises(RuntimeError, match="no such scene"):
        main(["bag", "export", str(changing), "--rerun", str(path)])
    assert not path.exists()


def test_episodes_that_are_not_there_are_said(stepped, tmp_path, capsys):
    chosen = ["bag", "export", str(stepped), "--episodes", "7", "9"]
    assert main([*chosen, "--out", str(tmp_path / "out")]) == 2
    said = "expected episodes that the bag has, got [9], too; 2 others are there"
    assert said in capsys.readouterr().err
    assert (tmp_path / "out" / "eval-000007.npz").exists()
    pytest.importorskip("rerun")
    assert main([*chosen, "--rerun", str(tmp_path / "out.rrd")]) == 2
    assert "got [9], too" in capsys.readouterr().err and not (tmp_path / "out.rrd").exists()
    assert main([*chosen, "--rerun", str(tmp_path / "out.rrd"), "--format", "npz"]) == 2
    assert "expected --out with --format" in capsys.readouterr().err


def test_parquet_holds_the_same_numbers_a_row_for_each_step(stepped, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for kind in ("npz", "parquet"):
        arguments = ["--out", str(tmp_path / kind), "--format", kind]
        assert main(["bag", "export", str(stepped), *arguments]) == 0
    table = parquet.read_table(tmp_path / "parquet" / "eval-000007.parquet")
    shapes = json.loads(table.schema.metadata[b"shapes"])
    with np.load(tmp_path / "npz" / "eval-000007.npz") as arrays:
        assert table.column_names == list(arrays) and table.num_rows == STEPS + 1
        for name, values in arrays.items():
            stored = np.array(table[name].to_pylist())
            np.testing.assert_array_equal(stored.reshape(-1, *shapes[name]), values)


def test_another_format_or_one_without_its_extra_is_refused(stepped, tmp_path, capsys, monkeypatch):
    arguments = ["bag", "export", str(stepped), "--out", str(tmp_path / "out"), "--format"]
    assert main([*arguments, "xls"]) == 2
    assert "expected one of npz, parquet, got 'xls'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main([*arguments, "parquet"]) == 2
    assert "programmable-agents[parquet]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_transitions_alone_are_exported_too(learned, tmp_path):
    """Without stamps and distances, which transitions don't carry."""
    chosen = ["--episodes", "1", "--out", str(tmp_path)]
    assert main(["bag", "export", str(learned), *chosen]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "episode-000001.npz",
        "episodes.csv",
    ]
    with np.load(tmp_path / "episode-000001.npz") as arrays:
        assert arrays["action"].shape == (101, 6) and np.isnan(arrays["action"][-1]).all()
        assert np.isnan(arrays["reward"][0]) and set(arrays["reward"][1:]) <= {-1.0, 1.0}
        assert np.isnan(arrays["stamp_s"]).all() and np.isfinite(arrays["joint_position"]).all()


def test_info_tells_of_episodes_versions_and_provenance(learned, stepped, capsys):
    assert main(["bag", "info", str(learned)]) == 0
    out = capsys.readouterr().out
    assert "3 trajectories of transitions, no gaps" in out
    assert "weights: versions 0 to 3" in out and "3 training episodes, 300 steps" in out
    assert "2-L, jaco, fast, seed 5" in out and "from scratch" in out
    assert main(["bag", "info", str(stepped)]) == 0
    out = capsys.readouterr().out
    assert "1 training episodes, 30 steps, reward per step" in out
    assert "1 evaluation episodes, 30 steps" in out and "acted by versions 4 to 4" in out


def test_info_names_gaps(learned, stepped, tmp_path, capsys):
    def drop(name, message):
        gone = name == "/trajectories" and message.sequence == 1
        return [] if gone or (name == "/policy_weights" and message.version == 2) else [message]

    assert main(["bag", "info", str(rewritten(learned, tmp_path / "a", drop))]) == 0
    out = capsys.readouterr().out
    assert "2 trajectories of transitions; GAPS: 1 missing of agent" in out
    assert "versions 0 to 3, 1 of them not recorded" in out

    def lose(name, message):
        gone = name == "/object_features" and message.step in (4, 5, 6)
        return [] if gone and not message.evaluation else [message]

    assert main(["bag", "info", str(rewritten(stepped, tmp_path / "b", lose))]) == 0
    assert "GAPS: 3 steps between others are not recorded" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("topic", "field", "damaged", "reason"),
    [
        ("/object_features", "object_count", 7, "object_features.features"),
        ("/joint_states", "position", np.zeros(3), "joint_states.position"),
        ("/verdict", "distance", -1.0, "verdict.distance"),
    ],
)
def test_steps_that_are_not_what_they_promise_are_refused(
    stepped, tmp_path, capsys, topic, field, damaged, reason
):
    def damage(name, message):
        if name == topic:
            setattr(message, field, damaged)
        return [message]

    bag = rewritten(stepped, tmp_path / "damaged", damage)
    assert main(["bag", "info", str(bag)]) == 1
    assert f"not readable: {reason}" in capsys.readouterr().out
    assert main(["bag", "export", str(bag), "--out", str(tmp_path / "out")]) == 2
    assert reason in capsys.readouterr().err


def cut_off(bag: Path, copy: Path) -> Path:
    """The bag, with a byte of its last chunk of messages altered: its first episode is whole."""
    shutil.copytree(bag, copy)
    file = next(copy.glob("*.mcap"))
    with file.open("rb") as stream:
        chunk = max(
            make_reader(stream).get_summary().chunk_indexes, key=lambda c: c.chunk_start_offset
        )
    content = bytearray(file.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    file.write_bytes(content)
    return copy


def test_an_export_that_is_refused_does_not_stand_in_the_way(learned, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    chosen = ["bag", "export", str(learned), "--out", str(out), "--episodes"]
    assert main([*chosen, "99"]) == 2
    assert (
        "expected episodes that the bag has, got [99]; none was written" in capsys.readouterr().err
    )
    assert not out.exists()
    assert main([*chosen, "1"]) == 0
    assert (out / "episodes.csv").exists()


def test_a_bag_without_episodes_is_refused(tmp_path, capsys):
    with BagWriter(tmp_path / "bag") as bag:
        for name, kind in (("/object_features", "ObjectFeatures"), ("/arena_info", "ArenaInfo")):
            bag.add(topic(installed_types(), name, f"msgs_schema/msg/{kind}", [reliable_qos(1)]))
        bag.add(topic(installed_types(), "/joint_states", "sensor_msgs/msg/JointState"))
    assert main(["bag", "export", str(tmp_path / "bag"), "--out", str(tmp_path / "out")]) == 2
    assert "expected episodes, got none" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_of_a_damaged_bag_it_is_said_how_many_episodes_were_exported(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pa_ros.bags.run_log.FLUSH_S", 0.0)  # a chunk for each
    assert train(tmp_path / "run", "--record", tmp_path / "bag", frames=300) == 0
    copy, out = cut_off(tmp_path / "bag", tmp_path / "copy"), tmp_path / "out"
    assert main(["bag", "export", str(copy), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "unreadable after" in error and "1 episodes are in" in error
    assert "their table is episodes.csv.part" in error and not (out / "episodes.csv").exists()
    with (out / "episodes.csv.part").open() as file:
        assert [row["episode"] for row in csv.DictReader(file)] == ["0"]


def test_a_film_that_is_interrupted_leaves_the_one_before(stepped, tmp_path, monkeypatch):
    out = tmp_path / "films" / "film.gif"
    arguments = ["bag", "film", str(stepped), "--episode", "7", "--side", "64", "--out", str(out)]
    assert main(arguments) == 0
    before, shown = out.read_bytes(), []

    def interrupted(*given):
        if len(shown) == 3:
            raise KeyboardInterrupt
        shown.append(given)
        return captioned(*given)

    monkeypatch.setattr("pa_ros.bags.film.captioned", interrupted)
    assert main(arguments) == EXIT_INTERRUPTED
    assert out.read_bytes() == before and [*out.parent.iterdir()] == [out]
