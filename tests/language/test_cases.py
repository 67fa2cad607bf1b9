"""Cases in files: the meaning of each valid text, and the error of each wrong one."""

import json
from pathlib import Path
from typing import Any

import pytest

from pa_ros.core.errors import PaError
from pa_ros.language import ProgramError, Vocabulary, parse, satisfying

CASES = Path(__file__).parent / "cases"
VALID = json.loads((CASES / "valid.json").read_text("utf-8"))
INVALID = json.loads((CASES / "invalid.json").read_text("utf-8"))


def vocabulary(cases: dict[str, Any]) -> Vocabulary:
    return Vocabulary.of(**{group: tuple(words) for group, words in cases["vocabulary"].items()})


@pytest.mark.parametrize("case", VALID["cases"], ids=lambda case: case["text"])
def test_valid(case: dict[str, Any]) -> None:
    program = parse(case["text"], vocabulary(VALID))
    assert str(program) == case["canonical"]
    assert parse(case["canonical"], vocabulary(VALID)) == program

    names = list(VALID["objects"])
    words = [frozenset(words) for words in VALID["objects"].values()]
    named = satisfying(program, words, names.index("hand"))
    assert [name for name, is_named in zip(names, named, strict=True) if is_named] == case["named"]


@pytest.mark.parametrize("case", INVALID["cases"], ids=lambda case: ascii(case["text"]))
def test_invalid(case: dict[str, Any]) -> None:
    with pytest.raises(ProgramError) as caught:
        parse(case["text"], vocabulary(INVALID))
    error = caught.value
    assert isinstance(error, PaError)
    assert (error.code, error.position) == (case["code"], case["position"])
    assert error.source == case["text"]
    part = error.source[slice(*error.span)]
    if error.code == "program.unexpected_character":
        assert error.received.startswith(f"U+{ord(part):04X} (")
    elif error.code == "program.arity":
        assert part.endswith(")")
    else:
        missing = "nothing" if error.code == "program.empty" else "the end of the text"
        assert error.received == (repr(part) if part else missing)
    for fragment in case["message"]:
        assert fragment in str(error)
    assert str(error).isascii()
