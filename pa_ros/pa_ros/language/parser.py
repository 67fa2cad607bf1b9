"""Tokens to tree: recursive descent, one token ahead. Knows the grammar and no semantics."""

from __future__ import annotations

from pa_ros.language.errors import (
    ArityError,
    EmptyProgramError,
    ProgramSyntaxError,
    ProgramTooDeepError,
    ProgramTooLargeError,
    ProgramTooLongError,
    one_of,
    refuse_word,
)
from pa_ros.language.limits import MAX_DEPTH, MAX_LENGTH, MAX_NODES
from pa_ros.language.span import Span
from pa_ros.language.syntax import And, Expression, Not, Or, Program, Word
from pa_ros.language.tokens import Kind, Token, tokenize
from pa_ros.language.vocabulary import RESERVED, Vocabulary

OPERATORS = ("AND", "OR", "NOT")


def parse(text: str, vocabulary: Vocabulary) -> Program:
    """Read a program over the words of `vocabulary`; free ASCII white space.

    Raises a ProgramError: for length and characters first, then for the first fault from the left.
    """
    if len(text) > MAX_LENGTH:
        raise _too_long(text, Span(MAX_LENGTH, MAX_LENGTH + 1), f"{len(text)}")
    if not text or text.isspace():
        example = f"{vocabulary.relations[0]}(HAND, {vocabulary.words[0]})"
        raise EmptyProgramError(
            text, Span(0, 0), expected=f"a program such as {example}", received="nothing"
        )
    program = _Parser(text, vocabulary).parse_program()
    if (length := len(str(program))) > MAX_LENGTH:
        raise _too_long(text, program.span, f"{length} in canonical form")
    return program


def _too_long(text: str, span: Span, received: str) -> ProgramTooLongError:
    return ProgramTooLongError(
        text, span, expected=f"at most {MAX_LENGTH} characters", received=received
    )


class _Parser:
    """One reading of one text. The docstring of each `_parse_*` is its rule in EBNF."""

    def __init__(self, source: str, vocabulary: Vocabulary) -> None:
        self._source = source
        self._vocabulary = vocabulary
        self._tokens = tokenize(source)
        self._token = next(self._tokens)
        self._nodes = 0

    def parse_program(self) -> Program:
        """program = relation "(" "HAND" "," expression ")" end ;"""
        relation = self._take_keyword(*self._vocabulary.relations)
        self._take("(")
        if self._token.kind == ")":
            raise self._wrong_arity(relation.text, relation, 0, self._token)
        self._take_keyword("HAND")
        targets, closing = self._parse_rest(depth=1)
        if len(targets) != 1:
            raise self._wrong_arity(relation.text, relation, 1 + len(targets), closing)
        if self._token.kind != "end":
            raise self._unexpected("the end of the text")
        return Program(targets[0], relation.text, Span(relation.span.start, closing.span.end))

    def _parse_expression(self, depth: int) -> Expression:
        """expression = word | operation ;"""
        token = self._token
        self._check_word(token)
        if depth > MAX_DEPTH:
            raise ProgramTooDeepError(
                self._source,
                token.span,
                expected=f"at most {MAX_DEPTH} nested expressions",
                received="more",
            )
        self._nodes += 1
        if self._nodes > MAX_NODES:
            raise ProgramTooLargeError(
                self._source,
                token.span,
                expected=f"at most {MAX_NODES} words and operators",
                received="more",
            )
        self._advance()
        if token.text in OPERATORS:
            return self._parse_operation(token, depth)
        return Word(token.text, token.span)

    def _parse_operation(self, name: Token, depth: int) -> Expression:
        """operation = ( "AND" | "OR" ) "(" expression "," expression { "," expression } ")"
        | "NOT" "(" expression ")" ;
        """
        operands, closing = self._parse_arguments(depth + 1)
        span = Span(name.span.start, closing.span.end)
        if name.text == "NOT":
            if len(operands) != 1:
                raise self._wrong_arity("NOT", name, len(operands), closing)
            return Not(operands[0], span)
        if len(operands) < 2:
            raise self._wrong_arity(name.text, name, len(operands), closing)
        return And(operands, span) if name.text == "AND" else Or(operands, span)

    def _parse_arguments(self, depth: int) -> tuple[tuple[Expression, ...], Token]:
        """arguments = "(" [ expression rest ] ")" ;"""
        self._take("(")
        if self._token.kind == ")":
            return (), self._take(")")
        first = self._parse_expression(depth)
        rest, closing = self._parse_rest(depth)
        return (first, *rest), closing

    def _parse_rest(self, depth: int) -> tuple[tuple[Expression, ...], Token]:
        """rest = { "," expression } ")" ;"""
        items = []
        while self._token.kind == ",":
            self._advance()
            items.append(self._parse_expression(depth))
        if self._token.kind != ")":
            raise self._unexpected("',' or ')'")
        return tuple(items), self._take(")")

    def _check_word(self, token: Token) -> None:
        """Refuse a token that starts no expression."""
        if token.kind == "word" and token.text in ("HAND", *self._vocabulary.relations):
            raise self._unexpected(f"{self._words()} ({token.text} is not a property)")
        if token.kind != "word":
            raise self._unexpected(self._words())
        known = (*self._vocabulary.words, *OPERATORS)
        if token.text not in known:
            raise refuse_word(self._source, token.span, token.text, known)

    def _words(self) -> str:
        return one_of((*self._vocabulary.words, *OPERATORS))

    def _take_keyword(self, *keywords: str) -> Token:
        known = {*self._vocabulary.words, *self._vocabulary.relations, *RESERVED}
        if self._token.kind == "word" and self._token.text not in known:
            raise refuse_word(self._source, self._token.span, self._token.text, keywords)
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

    def _unexpected(self, expected: str) -> ProgramSyntaxError:
        return ProgramSyntaxError(
            self._source, self._token.span, expected=expected, received=str(self._token)
        )

    def _wrong_arity(self, name: str, start: Token, received: int, closing: Token) -> ArityError:
        takes = {"NOT": "1 argument", "AND": "2 arguments or more", "OR": "2 arguments or more"}
        return ArityError(
            self._source,
            Span(start.span.start, closing.span.end),
            expected=f"{takes.get(name, '2 arguments')} to {name}",
            received=str(received),
        )
