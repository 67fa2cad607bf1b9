"""Signals that ask a process to come to its end."""

from __future__ import annotations

import _thread
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

EXIT_INTERRUPTED = 130  # as a shell says of SIGINT
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
IMPORTING = "<frozen importlib._bootstrap>"  # file of the frames that import
IMPORTED_AFTER_S = 5.0  # longer than imports take; then they are interrupted after all
ASKED_AGAIN_S = 0.05
Handler = Callable[[int, FrameType | None], None]


class Interrupted(KeyboardInterrupt):
    """A signal asked for the end; `status`: what a shell says of it."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.status = 128 + number


@contextmanager
def on_ending(handle: Handler) -> Iterator[None]:
    """`handle` SIGINT, SIGTERM and SIGHUP. But what nohup has started stays deaf to the last.

    A SIGINT that came to a starting child (`interrupts_later`) comes now. Once its terminal is
    gone, what a process says goes nowhere: it still ends in order.
    """
    terminals = [descriptor for descriptor in (1, 2) if os.isatty(descriptor)]

    def handle_it(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            for gone in (one for one in terminals if not os.isatty(one)):
                _say_nowhere(gone)
        handle(number, frame)

    before = {
        number: signal.signal(number, handle_it)
        for number in ENDING
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
    }
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interrupts_later() -> Iterator[None]:
    """A child that is started meanwhile gets SIGINT when it can end in order (`on_ending`), and not
    in the midst of its imports."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _say_nowhere(descriptor: int) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


@contextmanager
def signals_noted() -> Iterator[Callable[[], bool]]:
    """Signals make the function yielded true instead of ending the process.

    The next one raises Interrupted, so that impatience is heard while things are stopped; but not
    SIGHUP: of a terminal that closes the shell and the kernel each say so.
    """
    noted: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        if len(noted) > 1 and number != signal.SIGHUP and _is_time(number, frame):
            raise Interrupted(number)

    with on_ending(handle):
        yield lambda: bool(noted)


@contextmanager
def signals_interrupt() -> Iterator[None]:
    """Signals raise Interrupted, so that whatever is under way is left in order, and SIGHUP does
    not disturb that."""
    raised: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        if raised and number == signal.SIGHUP:
            return
        if _is_time(number, frame):
            raised.append(number)
            raise Interrupted(number)

    if not _in_main_thread():
        yield  # signals are the main thread's
        return
    with on_ending(handle):
        yield


@contextmanager
def interruption_held() -> Iterator[Callable[[], bool]]:
    """Interrupted is raised at the end of the block, and not in the midst of it, of C++ perhaps.
    Yields whether it is to be raised, so that the block can come to its end."""
    if not _in_main_thread():
        yield lambda: False
        return
    _held.depth += 1
    try:
        yield lambda: _held.number is not None
    finally:
        _held.depth -= 1
    if _held.depth == 0 and _held.number is not None:
        number, _held.number = _held.number, None
        raise Interrupted(number)


@dataclass
class _Held:
    depth: int = 0  # blocks within each other
    number: int | None = None  # of the signal that waits for their end
    importing_since: float | None = None  # s, monotonic: when one came in the midst of an import


_held = _Held()


def _is_time(number: int, frame: FrameType | None) -> bool:
    """Whether to raise Interrupted in this frame. If not, it is raised later: at the end of what
    holds it, or of an import: modules in C lose it, or make an ImportError of it."""
    if _held.depth:
        _held.number = number
        return False
    if not _importing(frame):
        _held.importing_since = None
        return True
    now = time.monotonic()
    if _held.importing_since is None:
        _held.importing_since = now
    if now - _held.importing_since >= IMPORTED_AFTER_S:
        _held.importing_since = None
        return True
    _thread.start_new_thread(_send_again, (number,))  # threading's locks may be held in this frame
    return False


def _send_again(number: int) -> None:
    time.sleep(ASKED_AGAIN_S)
    os.kill(os.getpid(), number)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            return True
        frame = frame.f_back
    return False


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def end_with_parent() -> None:
    """In a process that `multiprocessing` started: end, as at SIGTERM, when whoever started it is
    gone. Killed, it can't end its children itself."""
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="parent", daemon=True).start()
