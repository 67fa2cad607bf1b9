"""The program language: text to tree, what it means, and its flat form. Standard library only."""

from pa_ros.language.errors import ProgramError
from pa_ros.language.evaluate import degree, relevance, require_target, satisfying
from pa_ros.language.flat import FlatProgram, compile_program
from pa_ros.language.parser import parse
from pa_ros.language.syntax import And, Expression, Not, Or, Program, Word
from pa_ros.language.vocabulary import Vocabulary

__all__ = [
    "And",
    "Expression",
    "FlatProgram",
    "Not",
    "Or",
    "Program",
    "ProgramError",
    "Vocabulary",
    "Word",
    "compile_program",
    "parse",
    "degree",
    "relevance",
    "require_target",
    "satisfying",
]
