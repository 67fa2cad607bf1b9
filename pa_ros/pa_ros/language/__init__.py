"""The program language: text to tree, its meaning, its flat form. Standard library only."""

from pa_ros.language.errors import ProgramError
from pa_ros.language.evaluate import (
    LOGICS,
    MIN_MAX,
    PRODUCT,
    Logic,
    degree,
    logic_named,
    relevance,
    require_target,
    role_relevance,
    roles,
    satisfying,
)
from pa_ros.language.flat import compile_program
from pa_ros.language.goals import All, Avoid, Goal, Progress, Then, require_possible, stages
from pa_ros.language.parser import parse, parse_goal
from pa_ros.language.syntax import HAND, And, Expression, Not, Or, Program, Word
from pa_ros.language.vocabulary import Vocabulary

__all__ = [
    "All", "And", "Avoid", "Expression", "Goal", "HAND", "LOGICS", "Logic", "MIN_MAX", "Not", "Or",
    "PRODUCT", "Program", "ProgramError", "Progress", "Then", "Vocabulary", "Word",
    "compile_program", "degree", "logic_named", "parse", "parse_goal", "relevance",
    "require_possible", "require_target", "role_relevance", "roles", "satisfying", "stages",
]  # fmt: skip
