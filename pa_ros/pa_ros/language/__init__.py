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
from pa_ros.language.parser import parse
from pa_ros.language.syntax import HAND, And, Expression, Not, Or, Program, Word
from pa_ros.language.vocabulary import Vocabulary

__all__ = [
    "And",
    "Expression",
    "HAND",
    "LOGICS",
    "Logic",
    "MIN_MAX",
    "Not",
    "Or",
    "PRODUCT",
    "Program",
    "ProgramError",
    "Vocabulary",
    "Word",
    "compile_program",
    "degree",
    "logic_named",
    "parse",
    "relevance",
    "require_target",
    "role_relevance",
    "roles",
    "satisfying",
]
