"""Real time: the newest command holds until it is too old; then the arm holds still."""

from __future__ import annotations

from collections.abc import Iterator

from pa_ros.wire.step import Command
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
        oldest = self._oldest_ns()
        if self._command is not None:
            oldest = max(oldest, self._command.stamp_ns)
        if command.episode != stands.episode or not oldest <= command.stamp_ns <= stands.stamp_ns:
            raise StaleCommandError(
                f"joint_commands: expected episode {stands.episode} and a stamp from {oldest} to "
                f"{stands.stamp_ns} ns, got {command.episode} and {command.stamp_ns}"
            )
        self._command = command

    def forget(self) -> None:
        """What was commanded so far moves the arm no more."""
        self._command = None

    def tick(self) -> Iterator[Frame]:
        """Run one control period."""
        command, commanded = self._command, self._session.program is not None
        if commanded and command is not None and command.stamp_ns >= self._oldest_ns():
            return self._session.apply(command)
        self._command = None
        self.holds += commanded
        return self._session.advance(self._session.hold)

    def _oldest_ns(self) -> int:
        """Stamp of the oldest command that may move the arm now: of this episode, whatever number
        the one before had, and within the timeout."""
        stands = self._session.frame.observation
        since_reset = stands.step * self._session.arena.control_period_ns
        return stands.stamp_ns - min(self._timeout_ns, since_reset)
