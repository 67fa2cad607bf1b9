"""Signals that ask a command to come to its end."""

import importlib
import os
import signal
import time
from collections.abc import Iterator

import pytest

from pa_ros.core.signals import Interrupted, interruption_held, signals_interrupt, signals_noted

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Those of a process that nohup hasn't started; afterwards what they were."""
    before = {number: signal.signal(number, signal.default_int_handler) for number in ENDING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("first", ENDING)
def test_a_signal_is_noted_and_the_next_one_interrupts(first) -> None:
    with signals_noted() as noted:
        assert not noted()
        os.kill(os.getpid(), first)
        assert noted()
        with pytest.raises(Interrupted) as interrupted:
            os.kill(os.getpid(), signal.SIGTERM)
    assert interrupted.value.status == 128 + signal.SIGTERM


@pytest.mark.parametrize("first", ENDING)
def test_a_terminal_that_closes_is_no_impatience(first) -> None:
    """A shell and the kernel each say so."""
    with signals_noted() as noted:
        os.kill(os.getpid(), first)
        os.kill(os.getpid(), signal.SIGHUP)
        assert noted()
    with signals_interrupt():
        with pytest.raises(Interrupted):
            os.kill(os.getpid(), first)
        os.kill(os.getpid(), signal.SIGHUP)


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_interrupts_what_notes_none(number) -> None:
    with signals_interrupt(), pytest.raises(Interrupted) as interrupted:
        os.kill(os.getpid(), number)
    assert interrupted.value.status == 128 + number


def test_who_logs_out_ends_nothing_that_nohup_has_started() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with signals_interrupt(), signals_noted() as noted:
        os.kill(os.getpid(), signal.SIGHUP)
        assert not noted()


def test_what_is_under_way_comes_to_its_end_before_a_signal_interrupts() -> None:
    done = []
    with signals_interrupt(), pytest.raises(Interrupted):
        with interruption_held() as outer:
            with interruption_held() as inner:
                os.kill(os.getpid(), signal.SIGTERM)
                done.append("inner")
                assert inner()
            done.append("outer")
            assert outer()
        done.append("never")
    assert done == ["inner", "outer"]
    with interruption_held() as again:
        assert not again()


def test_a_module_is_imported_before_a_signal_interrupts(tmp_path, monkeypatch) -> None:
    """Modules in C lose what is raised in them, or make another error of it."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "losing.py").write_text(
        "import os, signal, time\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    time.sleep(0.2)\n"
        "except BaseException as error:\n"
        "    raise ImportError('initialization failed')\n"
        "imported = True\n"
    )
    with signals_interrupt(), pytest.raises(Interrupted) as interrupted:
        losing = importlib.import_module("losing")
        assert losing.imported
        time.sleep(10)
    assert interrupted.value.status == 128 + signal.SIGTERM
