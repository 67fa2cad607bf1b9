"""Checkpoints of version 0.2: their one relation is NEAR."""

from __future__ import annotations

import re
from typing import Any

_NEAR_ALONE = re.compile(r"\bnear_threshold_m=([^,)]+)")


def scoring_of(values: dict[str, Any]) -> str:
    """The rule of a checkpoint's rewards, as `repr` gives it here."""
    return _NEAR_ALONE.sub(r"thresholds={'NEAR': \1}", str(values.get("scoring")))
