"""Real time: the newest command holds until it is too old; then the arm holds still."""

from __future__ import annotations

from collections.abc import Iterator

from pa_ros.wire.records import Command
from sim_node.errors import NoProgramError, StaleCommandError
from sim_node.session import Frame, Session


class Watchdog:
    """Decides, once per control period, what moves the arm. Ages are of simulation time."""

    def __init__(self, session: Session, timeout_s: float) -> None:
        self.holds = 0  # periods in which no fresh command was there, although a program was
        self._session = session
        self._timeout_ns = int(timeout_s * 1e9)
        self._command: Command | None = None

    def offer(self, command: Command) -> None:
        """Take a command for the coming periods; StaleCommandError if it is of another episode,
        too old, or older than one taken before."""
        if self._session.program is None:
            raise NoProgramError("joint_commands: expected a program first, got none")
        stands = self._session.frame.observation
        oldest = stands.stamp_ns - self._timeout_ns
        if self._command is not None:
            oldest = max(oldest, self._command.stamp_ns)
        if command.episode != stands.episode or not oldest <= command.stamp_ns <= stands.stamp_ns:
            raise StaleCommandError(
                f"joint_commands: expected episode {stands.episode} and a stamp from {oldest} to "
                f"{stands.stamp_ns} ns, got {command.episode} and {command.stamp_ns}"
            )
        self._command = command

    def tick(self) -> Iterator[Frame]:
        """Run one control period."""
        stands, command = self._session.frame.observation, self._command
        fresh = (
            command is not None
            and self._session.program is not None
            and command.episode == stands.episode
            and command.stamp_ns >= stands.stamp_ns - self._timeout_ns
        )
        if fresh and command is not None:
            return self._session.apply(command)
        self._command = None
        self.holds += self._session.program is not None
        return self._session.advance(self._session.hold)
