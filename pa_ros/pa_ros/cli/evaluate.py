"""`pa_ros eval`: score a checkpoint, or a reference policy, under a condition."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from math import isnan
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pa_ros.acting.executing import Actor
from pa_ros.arena import ArenaConfig, Design, ReachTask, condition_named
from pa_ros.arena.camera import PICTURES
from pa_ros.arena.formulas import FORMULAS
from pa_ros.cli.options import add_setting, add_settings, file_to_write, settings_from
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import device, versions
from pa_ros.core.text import Report, write_report
from pa_ros.evaluation.agents import TrainedAgent, load_agent
from pa_ros.evaluation.evaluate import (
    REFERENCES,
    AgentPolicy,
    Evaluation,
    EvaluationConfig,
    by_program,
    evaluate,
    goal_ends,
    layouts_seed,
)
from pa_ros.evaluation.generalization import (
    RANDOM_WEIGHTS,
    acting_under,
    condition_rows,
    conditions_of,
    summarize,
)
from pa_ros.evaluation.judgement import Judgement
from pa_ros.evaluation.pushing import CLOSE_M, ends
from pa_ros.evaluation.scorer import Benchmark, Scorer
from pa_ros.language import MIN_MAX, Program, Vocabulary, logic_named, parse_goal
from pa_ros.perception import task_seen

ALL, FINITE = "all", "finite"  # all conditions; those of `arena.formulas`
ITS_OWN = "the design's"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros eval`."""
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--checkpoint", type=Path, help="folder that a training run left")
    source.add_argument("--policy", choices=REFERENCES, help="a reference policy")
    for name in ("design", "relations", "arm", "preset"):
        default = f"the checkpoint's, or {EvaluationConfig.leaf(name).default or ITS_OWN}"
        add_setting(parser, EvaluationConfig, name, otherwise=default)
    parser.add_argument(
        "--condition",
        default=EvaluationConfig.leaf("condition").default,
        help="train, eval, only-color, … (docs/evaluation.md), `random` for random weights, "
        "`all` for all of them, `finite` for all with formulas (%(default)s)",
    )
    parser.add_argument(
        "--pictures", choices=PICTURES, default="plain",
        help="how the world looks to the camera of an agent that sees (%(default)s)",
    )  # fmt: skip
    add_settings(parser, EvaluationConfig, "episodes", "seed", "layouts", "logic", "judge")
    parser.add_argument("--json", type=file_to_write, help="also write the figures to this file")


def run(options: argparse.Namespace) -> int:
    """Evaluate, print one row per program (or per condition) and the figures."""
    if options.condition in (ALL, RANDOM_WEIGHTS) and not options.checkpoint:
        raise ConfigError(f"eval --condition {options.condition}: expected --checkpoint, got none")
    if options.condition == FINITE and options.layouts != "shared":
        raise ConfigError(
            f"eval --layouts {options.layouts}: expected another condition than {FINITE}"
        )
    if options.policy and options.logic != MIN_MAX.name:
        raise ConfigError(f"eval --logic: expected --checkpoint, got --policy {options.policy}")
    if options.policy and options.judge != "verifier":
        raise ConfigError(f"eval --judge: expected --checkpoint, got --policy {options.policy}")
    if options.policy and options.pictures != "plain":
        raise ConfigError(f"eval --pictures: expected --checkpoint, got --policy {options.policy}")
    if options.checkpoint and options.relations:
        raise ConfigError("eval --relations: needs --policy; a checkpoint has its own relations")
    if options.checkpoint:
        logic = logic_named(options.logic)
        given = options.design, options.preset, options.arm, logic
        agent = load_agent(options.checkpoint, *given)
        several = options.condition in (ALL, FINITE)
        if options.pictures != "plain" and (several or not agent.perception):
            raise ConfigError(
                f"eval --pictures {options.pictures}: expected one condition and an agent that "
                f"sees, got condition {options.condition}"
            )
        if options.judge != "verifier" and several:
            raise ConfigError(f"eval --judge: expected one condition, got {options.condition}")
        if options.condition == ALL:
            return _all_conditions(agent, options)
        if options.condition == FINITE:
            task = task_seen(agent.arena, agent.design, options.seed, agent.perception)
            return _formulas(task, agent.policy, options)
        agent, drawn_from = acting_under(options.condition, agent, options.seed)
        judgement = None
        if options.judge == "agent" or condition_named(drawn_from, agent.design).chain:
            actor = Actor.of(agent.snapshot, logic)
            judgement = Judgement(actor, options.judge == "agent")
        report = _report(
            options, agent.design, agent.arena, agent.policy, drawn_from,
            agent.perception, judgement,
        )  # fmt: skip
        report = {**report, "eval.logic": agent.logic.name, "eval.weights": agent.digest}
    else:
        chosen = settings_from(options, EvaluationConfig)
        design, arena = chosen.design_of(), chosen.arena_config()
        if options.condition == FINITE:
            return _formulas(ReachTask(arena, design, options.seed), options.policy, options)
        report = _report(options, design, arena, options.policy, options.condition)
    write_report(options.json, report, without="eval.program.")  # each has a line above
    return 0


def _report(
    options: argparse.Namespace,
    design: Design,
    arena: ArenaConfig,
    policy: AgentPolicy | str,
    drawn_from: str,
    perception: str = "",
    judgement: Judgement | None = None,
) -> Report:
    seed = options.seed if options.layouts == "shared" else layouts_seed(options.seed, drawn_from)
    evaluation = evaluate(
        arena, design, policy, drawn_from, options.episodes, seed,
        perception=perception, pictures=PICTURES[options.pictures],
        pursued=None if judgement is None else judgement.program,
    )  # fmt: skip
    for row in by_program(evaluation):
        count = f"{row.episodes} episode{'s' * (row.episodes > 1)}"
        print(f"{row.program}: {count}, {row.reward_per_step:+.3f} per step, "
              f"{row.success_rate:.0%} near at the end")  # fmt: skip
    return {
        **figures(evaluation),
        **_ends(evaluation, design.vocabulary),
        **({} if judgement is None else judgement.report()),
        "eval.condition": options.condition,
        "eval.pictures": options.pictures,
        **_setting(options, design, arena),
    }


def _ends(evaluation: Evaluation, vocabulary: Vocabulary) -> Report:
    """How episodes ended: of goals over time, and where blocks can be moved; spheres apart, since
    they roll on."""
    goals = [parse_goal(score.program, vocabulary) for score in evaluation.scores]
    if not all(isinstance(goal, Program) and not goal.compares and goal.avoided is None
               for goal in goals):  # fmt: skip
        rows = [(s.success, s.ever, s.violated, s.stage + s.success) for s in evaluation.scores]
        names = ("success", "ever", "violations", "programs_done")
        return {
            f"eval.{name}": float(np.mean(column))
            for name, column in zip(names, zip(*rows, strict=True), strict=True)
        }
    report: dict[str, float | int | str] = {}
    for own in ends(evaluation.scores, vocabulary) if vocabulary.moves_objects else ():
        name = "eval.spheres." if own.spheres else "eval."
        report |= {f"{name}success": own.success, f"{name}ever": own.ever}
        if not isnan(own.close):
            report[f"{name}within_{CLOSE_M}"] = own.close
    return report


def _setting(
    options: argparse.Namespace, design: Design, arena: ArenaConfig
) -> dict[str, float | int | str]:
    return {
        "eval.design": design.name,
        "eval.arm": arena.arm,
        "eval.preset": arena.preset,
        "eval.seed": options.seed,
        "eval.layouts": options.layouts,
        "device": device(),
        "threads": 1,
        "versions": versions(),
    }


def _all_conditions(agent: TrainedAgent, options: argparse.Namespace) -> int:
    """Every condition of the design: a table, and `eval.CONDITION.…` in the report."""
    report: dict[str, float | int | str] = {"eval.episodes": options.episodes}
    with TemporaryDirectory() as cache:
        benchmark = Benchmark(
            design=agent.design,
            arena=agent.arena,
            episodes=options.episodes,
            seed=options.seed,
            layouts=options.layouts,
        )
        scorer = Scorer(benchmark, Path(cache))
        for condition in conditions_of(agent.design):
            (row,) = summarize(condition_rows(scorer, options.seed, agent, condition))
            print(f"{condition:16s} {row.normalized:6.3f} [{row.low:.3f}, {row.high:.3f}] "
                  f"normalized, {row.success_rate:.0%} near at the end, "
                  f"{row.gain:+.3f} over the best blind reference", flush=True)  # fmt: skip
            values = asdict(row)
            report |= {
                f"eval.{condition}.{name}": values[name]
                for name in ("normalized", "low", "high", "success_rate", "blind_normalized")
            }
    report |= {"eval.logic": agent.logic.name, "eval.weights": agent.digest}
    write_report(options.json, report | _setting(options, agent.design, agent.arena))
    return 0


def _formulas(task: ReachTask, policy: AgentPolicy | str, options: argparse.Namespace) -> int:
    """Every formula: a table, and `eval.CONDITION.…` in the report."""
    if not task.design.vocabulary.avoids:
        raise ConfigError(
            f"eval --condition finite: expected a design that avoids, such as 3-D-avoid, got "
            f"{task.design.name}"
        )
    report: dict[str, float | int | str] = {"eval.episodes": options.episodes}
    print("            success  violations  formula")
    for condition, (formula, _) in FORMULAS.items():
        ends = goal_ends(task, policy, condition, options.episodes)
        success, violations = np.mean([(one.satisfied, one.violated) for one in ends], axis=0)
        print(f"{condition:10s}  {success:7.2f}  {violations:10.2f}  {formula}", flush=True)
        report |= {
            f"eval.{condition}.success": float(success),
            f"eval.{condition}.violations": float(violations),
        }
    write_report(options.json, report | _setting(options, task.design, task.config))
    return 0


def figures(evaluation: Evaluation) -> Report:
    """The evaluation as a flat report; per-program rows are under `eval.program.<text>.…`."""
    raw, scaled = evaluation.raw, evaluation.normalized
    report: dict[str, float | int | str] = {
        "eval.reward_per_step": raw.mean,
        "eval.reward_per_step_low": raw.low,
        "eval.reward_per_step_high": raw.high,
        "eval.normalized": scaled.mean,
        "eval.normalized_low": scaled.low,
        "eval.normalized_high": scaled.high,
        "eval.success_rate": evaluation.success_rate,
        "eval.episodes": len(evaluation.scores),
    }
    for row in by_program(evaluation):
        for name, value in asdict(row).items():
            if name != "program":
                report[f"eval.program.{row.program}.{name}"] = value
    return report
