"""Goals over time: THEN, ALL and AVOID of programs, and how far a goal has come.

`Progress` is the automaton that says so. The verifier feeds it the true state, an agent its own
estimate. A part *begins* at one state, and from then on it either holds in a state or does not:

- A program holds in the states in which its relation does.
- THEN(g, …): the second part begins in the first state in which the first part holds, and so on;
  the whole holds in the states in which the last part does.
- ALL(g, …) holds where all parts do. The hand can only be in one place, so a part that moves the
  hand counts from the first state on in which it holds; what moves objects must still hold.
- AVOID(e, g) holds where g does, unless the hand was NEAR an object of e since it began.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from pa_ros.language.errors import ProgramError
from pa_ros.language.evaluate import describes, present_objects, require_target, roles
from pa_ros.language.syntax import NEAR, Expression, Or, Program, Span


@dataclass(frozen=True, slots=True)
class Then:
    """One goal after the other. Two goals or more."""

    goals: tuple[Goal, ...]

    def __str__(self) -> str:
        return f"THEN({', '.join(map(str, self.goals))})"


@dataclass(frozen=True, slots=True)
class All:
    """All goals, in any order. Two goals or more."""

    goals: tuple[Goal, ...]

    def __str__(self) -> str:
        return f"ALL({', '.join(map(str, self.goals))})"


@dataclass(frozen=True, slots=True)
class Avoid:
    """A goal, during which the hand is never NEAR an object of a set.

    A single program contains its set itself (`Program.avoided`), unless it has two.
    """

    avoided: Expression
    goal: Goal

    def __str__(self) -> str:
        return f"AVOID({self.avoided}, {self.goal})"


Goal: TypeAlias = Program | Then | All | Avoid


def stages(goal: Goal) -> tuple[Program, ...]:
    """The programs of a goal, in the order of its text, each with all that is avoided meanwhile."""
    return tuple(program for _, program, _ in _placed(goal))


def require_possible(
    goal: Goal,
    objects: Sequence[Collection[str]],
    hand_index: int | None,
    bodiless: Collection[str] = (),
) -> None:
    """Raise ProgramError, with its place in the goal's canonical text, unless each program of the
    goal can hold (`require_target`).

    Besides its codes: `program.avoids_target` if a program needs the hand near an avoided object.
    """
    text = str(goal)
    for start, program, avoided in _placed(goal):
        alone = program.relation_alone
        try:
            require_target(alone, objects, hand_index, bodiless)
        except ProgramError as error:
            span = Span(start + error.span.start, start + error.span.end)
            expected, received = error.expected, error.received
            raise ProgramError(
                text, span, code=error.code, expected=expected, received=received
            ) from None
        moved, targets = roles(alone, objects, hand_index, bodiless)
        # The hand touches the moved object. Targets of relations other than NEAR may be far away.
        needed = (moved, targets) if program.relation == NEAR else (moved,)
        for place, expression in avoided:
            span = Span(place, place + len(str(expression)))
            out = [i != hand_index and describes(expression, w) for i, w in enumerate(objects)]
            if not any(out):
                code, expected = "program.names_nothing", present_objects(objects, hand_index)
            elif any(all(o for n, o in zip(named, out, strict=True) if n) for named in needed):
                code = "program.avoids_target"
                expected = f"a set that leaves out an object which {alone} needs near"
            else:
                continue
            raise ProgramError(text, span, code=code, expected=expected, received=f"{expression}")


_Placed: TypeAlias = tuple[int, Program, tuple[tuple[int, Expression], ...]]


def _placed(
    goal: Goal, start: int = 0, avoided: tuple[tuple[int, Expression], ...] = ()
) -> Iterator[_Placed]:
    """Each program with the set that it avoids, where its relation begins in the canonical text,
    and the parts of that set, each with its place."""
    match goal:
        case Program():
            if goal.avoided is not None:
                avoided = (*avoided, (start + len("AVOID("), goal.avoided))
                start += len(f"AVOID({goal.avoided}, ")
            sets = tuple(expression for _, expression in avoided)
            joined = None if not sets else sets[0] if len(sets) == 1 else Or(sets)
            same = goal.avoided == joined
            yield start, goal if same else replace(goal, avoided=joined), avoided
        case Avoid(expression, inner):
            avoided = (*avoided, (start + len("AVOID("), expression))
            yield from _placed(inner, start + len(f"AVOID({expression}, "), avoided)
        case Then(goals) | All(goals):
            start += len("THEN(" if isinstance(goal, Then) else "ALL(")
            for part in goals:
                yield from _placed(part, start, avoided)
                start += len(f"{part}, ")


Truth = Callable[[Program], bool]
"""Whether a program of one relation, which avoids nothing, holds in a state."""


@dataclass(frozen=True, slots=True)
class Progress:
    """The progress of a goal after the states so far; `after` returns it after one more."""

    goal: Goal
    holds: bool = False  # in the state received last
    violated: bool = False  # an object to be avoided was NEAR: the goal cannot hold any more
    part: int = 0  # of THEN: the one that has begun last
    parts: tuple[Progress, ...] = ()  # of THEN: that part; of ALL: all; of AVOID: its goal

    @classmethod
    def of(cls, goal: Goal) -> Progress:
        """The progress of a goal that begins at the next state."""
        match goal:
            case Program():
                return cls(goal)
            case Then(goals):
                return cls(goal, parts=(cls.of(goals[0]),))
            case All(goals):
                return cls(goal, parts=tuple(map(cls.of, goals)))
            case Avoid(_, inner):
                return cls(goal, parts=(cls.of(inner),))

    def after(self, truth: Truth) -> Progress:
        """The progress after another state, of which `truth` says what holds there."""
        match self.goal:
            case Program() as program:
                violated = self.violated or _is_near(program.avoided, truth)
                holds = not violated and truth(program.relation_alone)
                return Progress(program, holds, violated)
            case Then(goals) as goal:
                part, progress = self.part, self.parts[0].after(truth)
                while progress.holds and part + 1 < len(goals):
                    part, progress = part + 1, Progress.of(goals[part + 1]).after(truth)
                return Progress(goal, progress.holds, progress.violated, part, (progress,))
            case All() as goal:
                parts = tuple(
                    one if one.holds and not _must_still_hold(one.goal) else one.after(truth)
                    for one in self.parts
                )
                holds, violated = all(p.holds for p in parts), any(p.violated for p in parts)
                return Progress(goal, holds, violated, parts=parts)
            case Avoid(avoided) as goal:
                inner = self.parts[0].after(truth)
                violated = self.violated or inner.violated or _is_near(avoided, truth)
                return Progress(goal, inner.holds and not violated, violated, parts=(inner,))

    @property
    def stage(self) -> int:
        """Which of `stages(goal)` is to be pursued: of THEN the one that has begun, of ALL the
        first one that does not hold, but what others are moved to comes before them."""
        match self.goal:
            case Program():
                return 0
            case Then(goals):
                return _count(goals[: self.part]) + self.parts[0].stage
            case All(goals):
                missing = [i for i, one in enumerate(self.parts) if not one.holds]
                moving = {_moved(goals[i]) for i in missing}
                # The bottom of a tower comes first: what is moved later takes others along.
                first = [i for i in missing if _target(goals[i]) not in moving - {None}] or missing
                part = first[0] if first else len(goals) - 1
                return _count(goals[:part]) + self.parts[part].stage
            case Avoid():
                return self.parts[0].stage


def _count(goals: tuple[Goal, ...]) -> int:
    return sum(len(stages(goal)) for goal in goals)


def _is_near(avoided: Expression | None, truth: Truth) -> bool:
    return avoided is not None and truth(Program(avoided))


def _moved(goal: Goal) -> Expression | None:
    """What a program moves, unless it is the hand; None for other goals."""
    return goal.moved if isinstance(goal, Program) and not goal.moves_hand else None


def _target(goal: Goal) -> Expression | None:
    return goal.target if isinstance(goal, Program) else None


def _must_still_hold(goal: Goal) -> bool:
    """Whether a part of ALL must hold at the end: it moves objects, which stay where they are."""
    match goal:
        case Program():
            return not goal.moves_hand
        case Then(goals):
            return _must_still_hold(goals[-1])
        case All(goals):
            return any(map(_must_still_hold, goals))
        case Avoid(_, inner):
            return _must_still_hold(inner)
