"""Messages that a relay drops, doubles, delays or puts in another order."""

from __future__ import annotations

from collections.abc import Callable

from chaos.faults import TROUBLE_S, Fault
from chaos.relay import DEEDS, RELAYED, SHARE, Deed
from chaos.stage import Stage

WORDS = {"drop": "dropped", "duplicate": "duplicated", "delay": "delayed", "reorder": "reordered"}
# What the protocol mends by itself is no trouble: an unanswered step or trajectory is sent again.
MENDED = "mended by sending again, or by numbers"


def message_faults() -> list[Fault]:
    """Each deed on each relayed topic."""
    return [
        Fault(
            f"{topic.name}: {SHARE:.0%} {WORDS[deed]}",
            _meddle(topic.name, deed),
            _leave(topic.name),
            TROUBLE_S,
            kind="relayed",
            silent=MENDED,
        )
        for topic, _ in RELAYED
        for deed in DEEDS
    ]


def _meddle(name: str, deed: Deed) -> Callable[[Stage], None]:
    def meddle(stage: Stage) -> None:
        assert stage.relay is not None
        stage.relay.deeds[name] = deed

    return meddle


def _leave(name: str) -> Callable[[Stage], None]:
    def leave(stage: Stage) -> None:
        assert stage.relay is not None
        stage.relay.deeds.pop(name)

    return leave
