"""Which command moves the arm. Without ROS.

In lockstep each command must answer the current step. In real time the newest command is repeated
until it is too old; then the arm holds still.
"""

from __future__ import annotations

from pa_ros.core.experience import Step
from pa_ros.wire.step import Command
from sim_node.session import Session, SimError


def check_answer(session: Session, command: Command) -> None:
    """Raise SimError unless a command answers the current step (lockstep)."""
    if session.program is None:
        raise _no_program()
    current = session.current.observation
    expected = (current.episode, current.step, current.stamp_ns)
    received = (command.episode, command.step, command.stamp_ns)
    if received != expected:
        raise SimError(
            f"joint_commands: expected (episode, step, stamp) {expected}, got {received}",
            code="command.stale",
        )


class Watchdog:
    """Chooses what moves the arm in each control period (real time).

    Ages are in simulation time, so that a slow machine doesn't make commands old.
    """

    def __init__(self, session: Session, timeout_s: float) -> None:
        self.holds = 0  # periods without a fresh command although a program was active
        self._session = session
        self._timeout_ns = int(timeout_s * 1e9)
        self._command: Command | None = None

    def offer(self, command: Command) -> None:
        """Accept a command for the coming periods.

        Raises SimError for another episode, and for a command that is too old, or older than the
        last accepted one.
        """
        if self._session.program is None:
            raise _no_program()
        current = self._session.current.observation
        oldest = self._oldest_ns()
        if self._command is not None:
            oldest = max(oldest, self._command.stamp_ns)
        if command.episode != current.episode or not oldest <= command.stamp_ns <= current.stamp_ns:
            raise SimError(
                f"joint_commands: expected episode {current.episode} and a stamp from {oldest} to "
                f"{current.stamp_ns} ns, got {command.episode} and {command.stamp_ns}",
                code="command.stale",
            )
        self._command = command

    def forget(self) -> None:
        """Drop the last command, so that the arm holds until the next one."""
        self._command = None

    def tick(self) -> Step:
        """Run one control period; the step it led to."""
        session, command = self._session, self._command
        if session.program is not None:
            if command is not None and command.stamp_ns >= self._oldest_ns():
                return session.apply(command)
            self.holds += 1
        self._command = None
        return session.advance(session.hold)

    def _oldest_ns(self) -> int:
        """The oldest stamp that may still move the arm: within the timeout, and of this episode.

        The episode is recognized by its time, not its number, because a training and an evaluation
        episode may have the same number.
        """
        current = self._session.current.observation
        since_reset = current.step * self._session.arena.control_period_ns
        return current.stamp_ns - min(self._timeout_ns, since_reset)


def _no_program() -> SimError:
    text = "joint_commands: expected a program first, got none"
    return SimError(text, code="arena.no_program")
