"""A link that loses, delays and reorders Ethernet frames between two interfaces.

A process forwards the frames, because not every kernel has `tc netem`. It needs root and the
namespace of the switch:

    python tests/helpers/bad_link.py port2 up2 --loss 0.02 --delay-ms 20 --jitter-ms 10
"""

import argparse
import fcntl
import heapq
import random
import select
import socket
import struct
import time
from array import array
from itertools import count

EVERY_PROTOCOL = 0x0003
OUTGOING = 4  # our own frame, received again
SIOCETHTOOL, SET_TX_CHECKSUM, SET_GSO, SET_TSO = 0x8946, 0x17, 0x24, 0x1F
MOST = 65_536 + 18


def raw(name: str) -> socket.socket:
    """A socket for all frames of an interface."""
    opened = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(EVERY_PROTOCOL))
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
    opened.bind((name, 0))
    opened.setblocking(False)
    return opened


def no_offload(name: str) -> None:
    """Make the sender compute checksums: a veth leaves them to a network card that it lacks."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        for command in (SET_TX_CHECKSUM, SET_GSO, SET_TSO):
            value = array("B", struct.pack("II", command, 0))
            request = struct.pack("16sP", name.encode(), value.buffer_info()[0])
            fcntl.ioctl(control, SIOCETHTOOL, request)


class BadLink:
    """Frames wait in a heap until they are due, so that one with a shorter delay overtakes."""

    def __init__(self, loss: float, delay_s: float, jitter_s: float, seed: int) -> None:
        self._loss, self._delay_s, self._jitter_s = loss, delay_s, jitter_s
        self._rng, self._numbers = random.Random(seed), count()
        self._waiting: list[tuple[float, int, socket.socket, bytes]] = []
        self.carried = self.lost = 0

    def take(self, frame: bytes, towards: socket.socket) -> None:
        if self._rng.random() < self._loss:
            self.lost += 1
            return
        due = time.monotonic() + self._delay_s + self._rng.uniform(-1, 1) * self._jitter_s
        heapq.heappush(self._waiting, (due, next(self._numbers), towards, frame))

    def hand_on(self) -> float:
        """Send the frames that are due; the seconds until the next one."""
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            *_, towards, frame = heapq.heappop(self._waiting)
            try:
                towards.send(frame)
                self.carried += 1
            except OSError:  # the cable is unplugged, or its queue is full
                self.lost += 1
        return max(0.0, self._waiting[0][0] - time.monotonic()) if self._waiting else 0.1

    def run(self, one: socket.socket, other: socket.socket) -> None:
        """Forward frames until the process ends."""
        across = {one: other, other: one}
        while True:
            ready, _, _ = select.select(list(across), [], [], self.hand_on())
            for arrived in ready:
                self._drain(arrived, across[arrived])

    def _drain(self, arrived: socket.socket, towards: socket.socket) -> None:
        for _ in range(200):
            try:
                frame, about = arrived.recvfrom(MOST)
            except BlockingIOError:
                return
            except OSError:  # the interface is down
                time.sleep(0.05)
                return
            if about[2] != OUTGOING:
                self.take(frame, towards)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("interfaces", nargs=2)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--delay-ms", type=float, default=0.0)
    parser.add_argument("--jitter-ms", type=float, default=0.0)
    options = parser.parse_args()
    link = BadLink(options.loss, options.delay_ms / 1e3, options.jitter_ms / 1e3, seed=0)
    try:
        link.run(*map(raw, options.interfaces))
    except KeyboardInterrupt:
        print(f"carried {link.carried}, lost {link.lost}")


if __name__ == "__main__":
    main()
