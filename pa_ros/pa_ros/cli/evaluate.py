"""`pa_ros eval`: score a checkpoint, or a reference policy, under a condition."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import isnan
from pathlib import Path

import numpy as np

from pa_ros.acting.executing import Actor
from pa_ros.agents import TrainedAgent, acting_under, load_agent
from pa_ros.arena import ArenaConfig, Design, ReachTask, condition_named, conditions_for
from pa_ros.arena.camera import PICTURES
from pa_ros.arena.formulas import FORMULAS
from pa_ros.arena.skills import SUCCESS
from pa_ros.arena.zones import FormulaSkill
from pa_ros.cli.options import add_setting, add_settings, asked, file_to_write, settings_from
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import device, versions
from pa_ros.core.text import Report, write_report
from pa_ros.evaluation.conditions import RANDOM_WEIGHTS, conditions_of
from pa_ros.evaluation.evaluate import (
    REFERENCES,
    AgentPolicy,
    Evaluation,
    EvaluationConfig,
    ProgramRow,
    by_program,
    evaluate,
    evaluate_programs,
    goal_ends,
    layouts_seed,
)
from pa_ros.evaluation.judgement import Judgement
from pa_ros.evaluation.pushing import CLOSE_M, ends
from pa_ros.evaluation.scores import normalized, rewards
from pa_ros.evaluation.traces import traces
from pa_ros.language import Program, logic_named, parse_goal
from pa_ros.perception import task_seen

ALL, FINITE = "all", "finite"  # all conditions; those of `arena.formulas`
ITS_OWN = "the design's"
CHECKPOINT, POLICY, ONE = "--checkpoint", "--policy", "one condition"
SEES, AVOIDS = "an agent that sees", "a design that avoids, such as 3-D-avoid"
DRAWN = "the condition's own programs, without --program"
UNSHARED = f"another condition than {FINITE}"
NEEDS = {
    f"condition {ALL}": (CHECKPOINT,),
    f"condition {RANDOM_WEIGHTS}": (CHECKPOINT,),
    f"condition {FINITE}": (AVOIDS,),
    "relations": (POLICY,),  # a checkpoint has its own
    "layouts": (UNSHARED, DRAWN),
    "logic": (CHECKPOINT,),
    "judge": (CHECKPOINT, ONE, DRAWN),
    "pictures": (CHECKPOINT, ONE, SEES, DRAWN),
}
"""What an option, or one of its values, cannot do without."""


@dataclass(frozen=True)
class Subject:
    """Who is scored, and where."""

    design: Design
    arena: ArenaConfig
    policy: AgentPolicy | str  # or the name of a reference
    agent: TrainedAgent | None = None  # whose policy it is

    @property
    def perception(self) -> str:
        """The calibration of the camera it sees with; empty: it is told properties."""
        return "" if self.agent is None else self.agent.perception

    def under(self, condition: str, seed: int) -> tuple[Subject, str]:
        """Who acts under a condition, and the condition of the episodes."""
        if self.agent is None:
            return self, condition
        agent, drawn_from = acting_under(condition, self.agent, seed)
        return replace(self, policy=agent.policy, agent=agent), drawn_from


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
        "--program", nargs="+", metavar="TEXT",
        help="score these programs alone, in scenes of the condition in which they can hold",
    )  # fmt: skip
    names = ("pictures", "episodes", "seed", "layouts", "logic", "judge")
    add_settings(parser, EvaluationConfig, *names)
    parser.add_argument("--json", type=file_to_write, help="also write the figures to this file")


def run(options: argparse.Namespace) -> int:
    """Evaluate, print one row per program (or per condition) and the figures."""
    subject = _subject(options)
    _check_needs(options, subject)
    if options.program:
        report = _programs(subject, options)
    elif options.condition == ALL:
        report = _all_conditions(subject, options)
    elif options.condition == FINITE:
        report = _formulas(subject, options)
    else:
        subject, drawn_from = subject.under(options.condition, options.seed)
        report = _one_condition(subject, drawn_from, options)
    report = {**report, **_setting(subject, options)}
    write_report(options.json, report, without="eval.program.")  # each has a line above
    return 0


def _subject(options: argparse.Namespace) -> Subject:
    if not options.checkpoint:
        chosen = settings_from(options, EvaluationConfig)
        return Subject(chosen.design_of(), chosen.arena_config(), options.policy)
    given = options.design, options.preset, options.arm, logic_named(options.logic)
    agent = load_agent(options.checkpoint, *given)
    return Subject(agent.design, agent.arena, agent.policy, agent)


def _check_needs(options: argparse.Namespace, subject: Subject) -> None:
    """Raise ConfigError for an option that would have no effect."""
    fulfilled = {
        CHECKPOINT: options.checkpoint is not None,
        POLICY: options.policy is not None,
        ONE: options.condition not in (ALL, FINITE),
        DRAWN: not options.program,
        UNSHARED: options.condition != FINITE,
        SEES: bool(subject.perception),
        AVOIDS: {*FORMULAS} <= {*conditions_for(subject.design)},
    }
    for name in asked(options, EvaluationConfig):
        option = name if name in NEEDS else f"{name} {getattr(options, name)}"
        for need in NEEDS.get(option, ()):
            if not fulfilled[need]:
                raise ConfigError(f"--{option}: needs {need}")


def _scored(
    subject: Subject,
    drawn_from: str,
    options: argparse.Namespace,
    judgement: Judgement | None = None,
    blind: bool = False,
) -> Evaluation:
    """Scores on the episodes of a condition."""
    seed = options.seed if options.layouts == "shared" else layouts_seed(options.seed, drawn_from)
    return evaluate(
        subject.arena, subject.design, subject.policy, drawn_from, options.episodes, seed,
        perception=subject.perception, pictures=PICTURES[options.pictures],
        pursued=None if judgement is None else judgement.program, blind=blind,
    )  # fmt: skip


def _one_condition(subject: Subject, drawn_from: str, options: argparse.Namespace) -> Report:
    """A row per program, and `eval.…` in the report."""
    if isinstance(subject.design.skill, FormulaSkill):
        task = ReachTask(subject.arena, subject.design, options.seed)
        row = traces(task, subject.policy, drawn_from, options.episodes)
        return {f"eval.{name}": value for name, value in asdict(row).items()}
    judgement, decides = None, options.judge == "agent"
    chain = condition_named(drawn_from, subject.design).chain
    if subject.agent is not None and (decides or chain):
        judgement = Judgement(Actor.of(subject.agent.snapshot, subject.agent.logic), decides)
    evaluation = _scored(subject, drawn_from, options, judgement)
    _print_rows(by_program(evaluation))
    return {
        **figures(evaluation),
        **_ends(evaluation, subject.design),
        **({} if judgement is None else judgement.report()),
        "eval.condition": options.condition,
        "eval.pictures": options.pictures,
    }


def _print_rows(rows: Sequence[ProgramRow]) -> None:
    for row in rows:
        count = f"{row.episodes} episode{'s' * (row.episodes > 1)}"
        print(f"{row.program}: {count}, {row.reward_per_step:+.3f} per step, "
              f"{row.success_rate:.0%} near at the end")  # fmt: skip


def _programs(subject: Subject, options: argparse.Namespace) -> Report:
    """A row for each program that was asked for, and the means of all."""
    subject, drawn_from = subject.under(options.condition, options.seed)
    if subject.agent is None:
        raise ConfigError(f"--program: needs {CHECKPOINT}")
    rows = evaluate_programs(
        subject.arena, subject.design, subject.agent.policy, options.program, options.episodes,
        drawn_from, subject.perception, options.seed,
    )  # fmt: skip
    _print_rows(rows)
    return {
        "eval.condition": options.condition,
        "eval.reward_per_step": float(np.mean([row.reward_per_step for row in rows])),
        "eval.success_rate": float(np.mean([row.success_rate for row in rows])),
    }


def _ends(evaluation: Evaluation, design: Design) -> Report:
    """How episodes ended: of goals over time, and where agents are judged by success; spheres
    apart, since they roll on."""
    vocabulary = design.vocabulary
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
    for own in ends(evaluation.scores, vocabulary) if design.skill.score == SUCCESS else ():
        name = "eval.spheres." if own.spheres else "eval."
        report |= {f"{name}success": own.success, f"{name}ever": own.ever}
        if not isnan(own.close):
            report[f"{name}within_{CLOSE_M}"] = own.close
    return report


def _setting(subject: Subject, options: argparse.Namespace) -> Report:
    agent = subject.agent
    acts = {} if agent is None else {"logic": agent.logic.name, "weights": agent.digest}
    return {
        "eval.design": subject.design.name,
        "eval.arm": subject.arena.arm,
        "eval.preset": subject.arena.preset,
        "eval.seed": options.seed,
        "eval.layouts": options.layouts,
        **{f"eval.{name}": value for name, value in acts.items()},
        "device": device(),
        "threads": 1,
        "versions": versions(),
    }


def _all_conditions(subject: Subject, options: argparse.Namespace) -> Report:
    """Every condition of the design: a table, and `eval.CONDITION.…` in the report."""
    report: dict[str, float | int | str] = {"eval.episodes": options.episodes}
    for condition in conditions_of(subject.design):
        acting, drawn_from = subject.under(condition, options.seed)
        one = _scored(acting, drawn_from, options, blind=True)
        score, success = one.normalized, one.success_rate
        print(f"{condition:16s} {score.mean:6.3f} [{score.low:.3f}, {score.high:.3f}] "
              f"normalized, {success:.0%} near at the end, "
              f"{one.gain.mean:+.3f} over the best blind reference", flush=True)  # fmt: skip
        blind, *scale = (float(rewards(r).mean()) for r in (one.blind, one.random, one.scripted))
        report |= {
            f"eval.{condition}.normalized": score.mean,
            f"eval.{condition}.low": score.low,
            f"eval.{condition}.high": score.high,
            f"eval.{condition}.success_rate": success,
            f"eval.{condition}.blind_normalized": normalized(blind, *scale),
        }
    return report


def _formulas(subject: Subject, options: argparse.Namespace) -> Report:
    """Every formula: a table, and `eval.CONDITION.…` in the report."""
    task = task_seen(subject.arena, subject.design, options.seed, subject.perception)
    report: dict[str, float | int | str] = {"eval.episodes": options.episodes}
    print("            success  violations  formula")
    for condition, (formula, _) in FORMULAS.items():
        ends = goal_ends(task, subject.policy, condition, options.episodes)
        success, violations = np.mean([(one.satisfied, one.violated) for one in ends], axis=0)
        print(f"{condition:10s}  {success:7.2f}  {violations:10.2f}  {formula}", flush=True)
        report |= {
            f"eval.{condition}.success": float(success),
            f"eval.{condition}.violations": float(violations),
        }
    return report


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
