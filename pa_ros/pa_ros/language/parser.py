"""Program text to tree: a tokenizer, then recursive descent with one token ahead.

The parser knows the grammar and the words; `language.evaluate` knows what a program means.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Literal, NamedTuple, TypeVar

from pa_ros.language.errors import ProgramError, one_of, unknown_word
from pa_ros.language.goals import All, Avoid, Goal, Then
from pa_ros.language.syntax import (
    COMPARISONS,
    HAND,
    HOLD,
    NEAR,
    ON,
    And,
    Expression,
    Not,
    Or,
    Program,
    Span,
    Word,
)
from pa_ros.language.vocabulary import RESERVED, Vocabulary

# These limits keep hostile text from costing time, memory or stack. The largest program of the
# paper (novel shape and color, appendix) has 96 characters in canonical form and 17 nodes, and is
# 5 deep.
MAX_LENGTH = 4096
"""Characters of program text, including white space; also of the canonical form."""

MAX_DEPTH = 32
"""Nested expressions: a word is 1 deep, an operator one deeper than its deepest argument."""

MAX_NODES = 256
"""Words and operators of a program, which bounds the instructions of its flat form."""

MAX_GOAL_DEPTH = 4
"""THEN, ALL and AVOID within each other."""

OPERATORS = ("AND", "OR", "NOT")
OVER_TIME = ("THEN", "ALL", "AVOID")

SEVERAL = "2 arguments or more"
ARGUMENT = 1
"""Depth of an expression that is an argument of the relation."""

Part = TypeVar("Part")
Kind = Literal["word", "(", ")", ",", "end"]

_TOKEN = re.compile(r"[A-Za-z0-9_]+|[(),]")
_REFUSED = re.compile(r"[^A-Za-z0-9_(),\s]", re.ASCII)
_SIGNS: dict[str, Kind] = {"(": "(", ")": ")", ",": ","}


def parse(text: str, vocabulary: Vocabulary) -> Program:
    """Parse a program of one relation, which may avoid a set; otherwise as `parse_goal`.

    Raises ProgramError (program.over_time) for another goal.
    """
    goal = parse_goal(text, vocabulary)
    if isinstance(goal, Program):
        return goal
    raise over_time(goal, text)


def over_time(goal: Goal, source: str) -> ProgramError:
    """An error for a goal over time where one program is expected."""
    return ProgramError(
        source,
        Span(0, len(source)),
        code="program.over_time",
        expected="a single program here, such as NEAR(HAND, e)",
        received=str(goal).partition("(")[0],
    )


def parse_goal(text: str, vocabulary: Vocabulary) -> Goal:
    """Parse a goal over the words of `vocabulary`; white space between tokens is ignored.

    Raises ProgramError: for length and characters first, then for the first fault from the left.
    """
    # Check the length before anything is read, so that a megabyte of text costs nothing.
    if len(text) > MAX_LENGTH:
        end = Span(MAX_LENGTH, MAX_LENGTH + 1)
        raise _too_large(text, end, "long", f"{MAX_LENGTH} characters", str(len(text)))
    if not text.strip():
        example = f"{vocabulary.relations[0]}(HAND, {vocabulary.words[0]})"
        raise ProgramError(
            text,
            Span(0, 0),
            code="program.empty",
            expected=f"a program such as {example}",
            received="nothing",
        )
    goal = _Parser(text, vocabulary).parse_text()
    if (length := len(str(goal))) > MAX_LENGTH:
        # Otherwise a goal would be accepted whose own printed form is rejected.
        received = f"{length} in canonical form"
        raise _too_large(text, Span(0, len(text)), "long", f"{MAX_LENGTH} characters", received)
    return goal


def _too_large(source: str, span: Span, how: str, limit: str, received: str) -> ProgramError:
    return ProgramError(
        source, span, code=f"program.too_{how}", expected=f"at most {limit}", received=received
    )


class Token(NamedTuple):
    """A word or sign and its place; the text of the end is empty."""

    kind: Kind
    text: str
    span: Span

    def __str__(self) -> str:
        return "the end of the text" if self.kind == "end" else repr(self.text)


def tokenize(source: str) -> Iterator[Token]:
    """Yield the tokens of `source` from left to right, then one "end" token.

    Raises ProgramError (program.unexpected_character), before any token, for a character that no
    token contains.
    """
    if refused := _REFUSED.search(source):
        character, position = refused[0], refused.start()
        name = unicodedata.name(character, "unnamed")
        # Suggest the ASCII character for full-width signs and letters.
        plain = unicodedata.normalize("NFKC", character)
        raise ProgramError(
            source,
            Span(position, position + 1),
            code="program.unexpected_character",
            expected="ASCII letters, digits, '_', '(', ')' or ','",
            received=f"U+{ord(character):04X} ({name})",
            suggestion=repr(plain) if plain != character and not _REFUSED.search(plain) else None,
        )
    for match in _TOKEN.finditer(source):
        text = match[0]
        yield Token(_SIGNS.get(text, "word"), text, Span(*match.span()))
    # The end is where something is missing, so it points behind the last word, not behind white
    # space.
    end = len(source.rstrip())
    yield Token("end", "", Span(end, end))


class _Parser:
    """The state of parsing one text. The docstring of each `_parse_*` is its rule in EBNF."""

    def __init__(self, source: str, vocabulary: Vocabulary) -> None:
        self._source = source
        self._vocabulary = vocabulary
        self._tokens = tokenize(source)
        self._token = next(self._tokens)
        self._nodes = 0
        moves_objects = vocabulary.moves_objects
        self._parse_first = self._parse_argument if moves_objects else self._parse_hand
        self._hand = (HAND.name,) if moves_objects else ()  # also as the second argument

    def parse_text(self) -> Goal:
        """text = goal end ;"""
        goal = self._parse_goal(1)
        if self._token.kind != "end":
            raise self._unexpected("the end of the text")
        return goal

    def _parse_goal(self, depth: int) -> Goal:
        """goal = program | ( "THEN" | "ALL" ) "(" goal "," goal { "," goal } ")" | avoid ;"""
        over_time = [name for name in OVER_TIME if name != "AVOID" or self._avoids]
        name = self._take_keyword(*self._vocabulary.relations, *over_time)
        if name.text not in OVER_TIME:
            return self._parse_program(name)
        if depth > MAX_GOAL_DEPTH:
            limit = f"{MAX_GOAL_DEPTH} of THEN, ALL and AVOID within each other"
            raise _too_large(self._source, name.span, "deep", limit, "more")
        if name.text == "AVOID":
            return self._parse_avoid(name, depth)
        goals, closing = self._parse_arguments(lambda: self._parse_goal(depth + 1))
        if len(goals) < 2:
            raise self._wrong_arity(name.text, name, len(goals), closing)
        if name.text == "THEN":
            return Then(goals)
        held = [one for one in goals if isinstance(one, Program) and one.relation == HOLD]
        if len(held) > 1:
            raise ProgramError(
                self._source,
                name.span,
                code="program.hand",
                expected="one HOLD in ALL, since the hand holds one thing at a time",
                received=" and ".join(map(str, held)),
            )
        return All(goals)

    def _parse_avoid(self, name: Token, depth: int) -> Goal:
        """avoid = "AVOID" "(" expression "," goal ")" ;"""
        self._take("(")
        if self._token.text == HAND.name:  # the hand is never apart from itself
            raise self._unexpected(self._words())
        avoided = self._parse_expression(ARGUMENT)
        self._take(",")
        goal = self._parse_goal(depth + 1)
        self._take(")")
        if isinstance(goal, Program) and goal.avoided is None:
            return replace(goal, avoided=avoided)
        return Avoid(avoided, goal)

    @property
    def _avoids(self) -> bool:
        return NEAR in self._vocabulary.relations

    def _parse_program(self, relation: Token) -> Program:
        """program = relation "(" argument "," argument ")" ;

        Unless programs may move objects, the arguments are "HAND" and an expression.
        """
        self._take("(")
        if self._token.kind == ")":
            raise self._wrong_arity(relation.text, relation, 0, self._token)
        first, moved = self._parse_first()
        targets, closing = self._parse_rest(self._parse_argument)
        if len(targets) != 1:
            raise self._wrong_arity(relation.text, relation, 1 + len(targets), closing)
        second, target = targets[0]
        self._check_hand(relation, moved, target, closing)
        return Program(target, relation.text, moved, chosen=(first, second))

    def _check_hand(
        self, relation: Token, moved: Expression, target: Expression, closing: Token
    ) -> None:
        """Reject a relation of the hand to itself, and one that it cannot be in, or alone can."""
        wrong, received = relation.span, str(moved)
        if HAND in (moved, target):
            at = self._source[: closing.span.start].rindex(HAND.name)
            wrong, received = Span(at, at + len(HAND.name)), HAND.name
        if moved == target == HAND:
            code, expected, received = "itself", "another object than the hand", "HAND twice"
        elif relation.text == ON and HAND in (moved, target):
            code, expected = "hand", "an object, since the hand rests on nothing"
        elif relation.text == HOLD and moved != HAND:
            code, expected = "hand", "HAND as the first argument, since nothing else holds"
        else:
            return
        raise ProgramError(
            self._source, wrong, code=f"program.{code}", expected=expected, received=received
        )

    def _parse_hand(self) -> tuple[str, Expression]:
        """argument = "HAND" ;"""
        if self._token.text in {*self._vocabulary.words, *OPERATORS, *COMPARISONS}:
            raise self._unexpected("HAND (programs of this world move the hand alone)")
        self._take_keyword(HAND.name)
        return "", HAND

    def _parse_argument(self) -> tuple[str, Expression]:
        """argument = "HAND" | [ comparison "(" ] expression [ ")" ] ;"""
        name = self._token
        if name.text not in self._vocabulary.comparisons:
            return "", self._parse_expression(ARGUMENT)
        self._advance()
        operands, closing = self._parse_arguments(lambda: self._parse_expression(ARGUMENT + 1))
        if len(operands) != 1:
            raise self._wrong_arity(name.text, name, len(operands), closing)
        return name.text, operands[0]

    def _parse_expression(self, depth: int) -> Expression:
        """expression = word | operation ;"""
        token = self._token
        if depth == ARGUMENT and token.text in self._hand:
            return Word(self._advance().text)
        self._check_word(token, depth)
        # Depth and size are checked while parsing, so that no larger tree is ever built.
        if depth > MAX_DEPTH:
            limit = f"{MAX_DEPTH} nested expressions"
            raise _too_large(self._source, token.span, "deep", limit, "more")
        self._nodes += 1
        if self._nodes > MAX_NODES:
            limit = f"{MAX_NODES} words and operators"
            raise _too_large(self._source, token.span, "large", limit, "more")
        self._advance()
        if token.text in OPERATORS:
            return self._parse_operation(token, depth)
        return Word(token.text)

    def _parse_operation(self, name: Token, depth: int) -> Expression:
        """operation = ( "AND" | "OR" ) "(" expression "," expression { "," expression } ")"
        | "NOT" "(" expression ")" ;
        """
        operands, closing = self._parse_arguments(lambda: self._parse_expression(depth + 1))
        if name.text == "NOT":
            if len(operands) != 1:
                raise self._wrong_arity("NOT", name, len(operands), closing)
            return Not(operands[0])
        if len(operands) < 2:
            raise self._wrong_arity(name.text, name, len(operands), closing)
        return And(operands) if name.text == "AND" else Or(operands)

    def _parse_arguments(self, part: Callable[[], Part]) -> tuple[tuple[Part, ...], Token]:
        """arguments = "(" [ part rest ] ")" ;"""
        self._take("(")
        if self._token.kind == ")":
            return (), self._take(")")
        first = part()
        rest, closing = self._parse_rest(part)
        return (first, *rest), closing

    def _parse_rest(self, part: Callable[[], Part]) -> tuple[tuple[Part, ...], Token]:
        """rest = { "," part } ")" ;"""
        items = []
        while self._token.kind == ",":
            self._advance()
            items.append(part())
        if self._token.kind != ")":
            raise self._unexpected("',' or ')'")
        return tuple(items), self._take(")")

    def _check_word(self, token: Token, depth: int) -> None:
        """Reject a token that cannot start an expression."""
        if token.kind == "word" and token.text in ("HAND", *self._vocabulary.relations):
            raise self._unexpected(f"{self._words()} ({token.text} is not a property)")
        if token.text in OVER_TIME:
            raise self._unexpected(f"{self._words()} ({token.text} is a goal, not a set)")
        if token.text in self._vocabulary.comparisons:
            raise self._unexpected(f"{self._words()} ({token.text} is an argument, not a set)")
        if token.kind != "word":
            raise self._unexpected(self._words(*(self._hand if depth == ARGUMENT else ())))
        known = (*self._vocabulary.words, *OPERATORS)
        if token.text not in known:
            raise unknown_word(self._source, token.span, token.text, known)

    def _words(self, *others: str) -> str:
        return one_of((*others, *self._vocabulary.words, *OPERATORS))

    def _take_keyword(self, *keywords: str) -> Token:
        known = {*self._vocabulary.words, *self._vocabulary.relations, *RESERVED}
        if self._token.kind == "word" and self._token.text not in known:
            raise unknown_word(self._source, self._token.span, self._token.text, keywords)
        if self._token.text not in keywords:
            raise self._unexpected(one_of(keywords))
        return self._advance()

    def _take(self, kind: Kind) -> Token:
        if self._token.kind != kind:
            raise self._unexpected(repr(kind))
        return self._advance()

    def _advance(self) -> Token:
        token = self._token
        if token.kind != "end":
            self._token = next(self._tokens)
        return token

    def _unexpected(self, expected: str) -> ProgramError:
        token = self._token
        return ProgramError(
            self._source, token.span, code="program.syntax", expected=expected, received=str(token)
        )

    def _wrong_arity(self, name: str, start: Token, received: int, closing: Token) -> ProgramError:
        takes = {
            **dict.fromkeys(("NOT", *COMPARISONS), "1 argument"),
            **dict.fromkeys(("AND", "OR", "THEN", "ALL"), SEVERAL),
        }
        return ProgramError(
            self._source,
            Span(start.span.start, closing.span.end),
            code="program.arity",
            expected=f"{takes.get(name, '2 arguments')} for {name}",
            received=str(received),
        )
