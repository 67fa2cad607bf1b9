"""ROS domains: the one that a process and its children are in, shared with nobody else here."""

from __future__ import annotations

import atexit
import os
import random
import socket
from contextlib import ExitStack

from pa_ros.core.errors import ConfigError

DOMAINS = range(1, 102)  # whose ports are below Linux's ephemeral ones
_FIRST_PORT, _PORTS_PER_DOMAIN = 7400, 250
_DISCOVERY, _CLAIM = 0, 2  # a domain's ports: where DDS listens, and one that DDS never uses


class DomainClaim:
    """A domain in which nobody listens, and that no other claim on this machine is for.

    It is claimed until `close` or the end of the process, however that ends: by binding a UDP port
    of the domain, so that graphs that are yet to start don't meet. A context manager.
    Raises ConfigError if there is none left.
    """

    def __init__(self) -> None:
        candidates = list(DOMAINS)
        random.SystemRandom().shuffle(candidates)
        for number in candidates:
            held = _bound(number, _CLAIM)
            if held is None:
                continue
            discovery = _bound(number, _DISCOVERY)
            if discovery is not None:
                discovery.close()
                self.number, self._held = number, held
                return
            held.close()
        raise ConfigError("ROS domain: every one is in use on this machine")

    def close(self) -> None:
        """Let others have it."""
        self._held.close()

    def __enter__(self) -> DomainClaim:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_claim = ExitStack()  # what this process has claimed last, if anything
atexit.register(_claim.close)


def use_domain(domain_id: int | None) -> int:
    """Put this process and its children into a ROS domain; None: one that nobody uses here, which
    is then claimed until the process ends or chooses again.

    Call before ROS is up. Raises ConfigError for a number outside DOMAINS (0 is allowed too).
    """
    if domain_id is None:
        claim = DomainClaim()
        _claim.close()
        domain_id = _claim.enter_context(claim).number
    if domain_id != 0 and domain_id not in DOMAINS:
        raise ConfigError(f"ROS domain: expected 0 to {DOMAINS[-1]}, got {domain_id}")
    os.environ["ROS_DOMAIN_ID"] = str(domain_id)
    return domain_id


def _bound(domain_id: int, offset: int) -> socket.socket | None:
    """A socket that holds a domain's port; None if somebody has it."""
    port = _FIRST_PORT + _PORTS_PER_DOMAIN * domain_id + offset
    held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        held.bind(("127.0.0.1", port))  # taken where somebody listens on every address, too
    except OSError:
        held.close()
        return None
    return held
