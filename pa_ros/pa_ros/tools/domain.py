"""Choose the ROS domain of a process and its children, one that nobody else uses here."""

from __future__ import annotations

import atexit
import os
import random
import socket

from pa_ros.core.errors import ConfigError

DOMAINS = range(1, 102)  # their ports are below those that Linux hands out to clients
FIRST_PORT, PORTS_PER_DOMAIN = 7400, 250
DISCOVERY, UNUSED = 0, 2  # offsets among a domain's ports: DDS listens on one, never on the other


class DomainClaim:
    """A domain without nodes, which no other claim on this machine gets; a context manager.

    The claim is a bound UDP port, so it ends with `close` or with the process. Raises ConfigError
    if every domain is in use.
    """

    def __init__(self) -> None:
        # In random order, so that processes that start together rarely try the same one.
        for number in random.SystemRandom().sample(list(DOMAINS), len(DOMAINS)):
            claim = _bound(number, UNUSED)
            if claim is None:
                continue
            listener = _bound(number, DISCOVERY)
            if listener is not None:
                listener.close()
                self.number, self._claim = number, claim
                return
            claim.close()
        raise ConfigError("ROS domain: every one is in use on this machine")

    def close(self) -> None:
        """Let others use the domain."""
        self._claim.close()

    def __enter__(self) -> DomainClaim:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def use_free_domain() -> int:
    """Put this process and its children into a ROS domain that nobody uses; call before ROS starts.

    Returns the domain's number. Raises ConfigError if every domain is in use.
    """
    claim = DomainClaim()
    atexit.register(claim.close)  # the domain stays ours until the process ends
    os.environ["ROS_DOMAIN_ID"] = str(claim.number)
    return claim.number


def _bound(domain_id: int, offset: int) -> socket.socket | None:
    """A socket bound to a port of a domain; None if the port is taken."""
    claim = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        claim.bind(("127.0.0.1", FIRST_PORT + PORTS_PER_DOMAIN * domain_id + offset))
    except OSError:
        claim.close()
        return None
    return claim
