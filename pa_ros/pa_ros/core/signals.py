"""Signals that ask a process to end: SIGINT (Ctrl-C), SIGTERM, and SIGHUP (a closed terminal)."""

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

EXIT_INTERRUPTED = 130  # the status that a shell gives for SIGINT
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
IMPORTING = "<frozen importlib._bootstrap>"  # file name of the frames that import
LONGEST_IMPORT_S = 5.0  # after this an import is interrupted, too
RETRY_S = 0.05
Handler = Callable[[int, FrameType | None], None]


class Interrupted(KeyboardInterrupt):
    """A signal asked the process to end; `status` is what a shell reports for it."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.status = 128 + number


@contextmanager
def on_ending(handle: Handler) -> Iterator[None]:
    """Call `handle` for SIGINT, SIGTERM and SIGHUP within the block.

    SIGHUP stays ignored in a process that nohup started. A SIGINT that was blocked while the
    process started (`interrupts_later`) is delivered now. After the terminal was closed, output is
    discarded, so that the process can still end in order.
    """
    terminals = [descriptor for descriptor in (1, 2) if os.isatty(descriptor)]

    def handle_signal(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            for gone in (one for one in terminals if not os.isatty(one)):
                _discard_output(gone)
        handle(number, frame)

    before = {
        number: signal.signal(number, handle_signal)
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
    """Block SIGINT in child processes started within the block, until their `on_ending`.

    A child that is interrupted during its imports would end with a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _discard_output(descriptor: int) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


@contextmanager
def signals_noted() -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether a signal arrived; the caller then ends in order.

    A second signal raises Interrupted, for users who do not want to wait. SIGHUP never does: when a
    terminal closes, the shell and the kernel both send it.
    """
    noted: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        if len(noted) > 1 and number != signal.SIGHUP and _may_raise(number, frame):
            raise Interrupted(number)

    with on_ending(handle):
        yield lambda: bool(noted)


@contextmanager
def signals_interrupt() -> Iterator[None]:
    """Raise Interrupted for a signal, so that `with` and `finally` blocks end in order.

    A later SIGHUP does not disturb them.
    """
    raised: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        # A closing terminal sends SIGHUP after the signal that already ends this process.
        if raised and number == signal.SIGHUP:
            return
        if _may_raise(number, frame):
            raised.append(number)
            raise Interrupted(number)

    if not _in_main_thread():
        yield  # only the main thread receives signals
        return
    with on_ending(handle):
        yield


@contextmanager
def interruption_held() -> Iterator[Callable[[], bool]]:
    """Delay Interrupted until the end of the block, which may be in the middle of C++ code.

    Yields a function that says whether it will be raised, so that the block can end early.
    """
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
    depth: int = 0  # number of nested blocks
    number: int | None = None  # the signal that waits for their end
    importing_since: float | None = None  # s, monotonic: when a signal arrived during an import


_held = _Held()


def _may_raise(number: int, frame: FrameType | None) -> bool:
    """Whether Interrupted may be raised in this frame; otherwise it is raised later.

    During an import it is delayed, since C modules lose the exception or turn it into ImportError.
    """
    if _held.depth:
        _held.number = number
        return False
    if not _importing(frame):
        _held.importing_since = None
        return True
    now = time.monotonic()
    if _held.importing_since is None:
        _held.importing_since = now
    if now - _held.importing_since >= LONGEST_IMPORT_S:
        _held.importing_since = None
        return True
    # Not threading.Thread: this frame may hold the locks that it needs.
    _thread.start_new_thread(_send_again, (number,))
    return False


def _send_again(number: int) -> None:
    time.sleep(RETRY_S)
    os.kill(os.getpid(), number)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            return True
        frame = frame.f_back
    return False


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
