"""How soft truths are taken and joined, by AND and by OR. NOT is 1 - x in each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import mul
from typing import Any

from pa_ros.core.errors import ConfigError


@dataclass(frozen=True)
class Logic:
    """AND and OR of degrees in [0, 1], of numbers a number, of arrays an array.

    On 0 and 1 all logics agree. Detectors' logits are multiplied by `sharpness`, the inverse of a
    softmax's temperature: what is known becomes nearly certain, and where no logit stands out, as
    of a property never seen, nothing does.
    """

    name: str
    both: Callable[[Any, Any], Any]
    either: Callable[[Any, Any], Any]
    sharpness: float = 1.0


def _sum(x: Any, y: Any) -> Any:
    return x + y - x * y


def _least(x: Any, y: Any) -> Any:
    return x * (x <= y) + y * (x > y)


def _most(x: Any, y: Any) -> Any:
    return x * (x >= y) + y * (x < y)


PRODUCT = Logic("product", mul, _sum)
"""xy and x + y - xy (paper, eq. logic): smooth in all operands, so learning differentiates it.
AND(e, e) squares e, though, so equal programs need not have equal degrees."""

MIN_MAX = Logic("min_max", _least, _most, sharpness=2.5)
"""The smaller and the greater (Zadeh 1965): every law of a distributive lattice holds exactly, De
Morgan's and double negation to rounding, and the excluded middle doesn't."""

LOGICS = {logic.name: logic for logic in (PRODUCT, MIN_MAX)}


def logic_named(name: str) -> Logic:
    """Look up a logic; ConfigError names the known ones."""
    if name not in LOGICS:
        raise ConfigError(f"logic: expected one of {tuple(LOGICS)}, got {name!r}")
    return LOGICS[name]
