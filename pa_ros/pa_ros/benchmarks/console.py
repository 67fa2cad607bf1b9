"""What an open page costs the graph: `pa_ros bench console`."""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pa_ros.benchmarks.graph import PARAMETERS, TIMEOUT_S, BenchError
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

SETTLE_S = 2.0  # after a page has come or gone
SLICE_S = 5.0
LOAD_S = 30.0  # between two looks at the memory, of the long load


def bench_console(rounds: int = 10, minutes: float = 0.0) -> dict[str, float | str]:
    """Lockstep steps per second of sim_node and agent_node beside a console, with a page open and
    without one, by turns; medians. Other processes on the machine hit both alike. What share of a
    core the console's process takes, they hardly change. Then a page is open for `minutes`.

    The page takes everything and draws nothing: what a browser costs is its machine's affair.
    """
    use_domain(None)
    figures = GraphFigures()
    open_, closed, resident, shares = [], [], [], []
    load: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder, Supervisor(Path(folder)) as supervisor:
        with client_node("bench") as node, _console() as (process, address):
            watch_diagnostics(node, figures)
            start_nodes(supervisor, PARAMETERS, Path(folder))

            def rate() -> float:
                """Mean of what the arena reports during a slice."""
                seen: list[float] = []

                def sample() -> None:
                    seen.append(figures.value("sim_node", "steps_per_s") or 0.0)

                watch(node, supervisor, lambda: None, lambda: False, SETTLE_S)
                watch(node, supervisor, sample, lambda: False, SLICE_S)
                return statistics.fmean(seen)

            started = time.monotonic()
            while rate() == 0.0:
                if time.monotonic() - started > TIMEOUT_S:
                    raise BenchError(f"console: expected steps within {TIMEOUT_S:g} s, got none")
            for _ in range(rounds):
                closed.append(rate())
                with _page(address):
                    before, began = _cpu_s(process.pid), time.monotonic()
                    open_.append(rate())
                    used, passed = _cpu_s(process.pid) - before, time.monotonic() - began
                    shares.append(used / passed)
                    resident.append(_resident_mb(process.pid))
            if minutes:
                with _page(address):
                    load = _load(rate, process.pid, minutes)
    cost = [1.0 - with_page / without for with_page, without in zip(open_, closed, strict=True)]
    return {
        "console.steps_per_s": statistics.median(closed),
        "console.steps_per_s_page_open": statistics.median(open_),
        "console.cost": statistics.median(cost),
        "console.cost_least": min(cost),
        "console.cost_most": max(cost),
        "console.core_share_page_open": statistics.median(shares),
        "console.resident_mb_first": resident[0],
        "console.resident_mb_last": resident[-1],
        "console.rounds": float(rounds),
        **load,
    }


def _load(rate: Callable[[], float], pid: int, minutes: float) -> dict[str, float]:
    """A page that stays open: rate and memory at the beginning and in the end."""
    until = time.monotonic() + 60 * minutes
    rates, resident = [rate()], [_resident_mb(pid)]
    while time.monotonic() < until:
        time.sleep(max(0.0, min(LOAD_S - SETTLE_S - SLICE_S, until - time.monotonic())))
        rates.append(rate())
        resident.append(_resident_mb(pid))
    half = len(rates) // 2
    return {
        "console.load_minutes": minutes,
        "console.load_steps_per_s_first_half": statistics.median(rates[:half] or rates),
        "console.load_steps_per_s_second_half": statistics.median(rates[half:]),
        "console.load_resident_mb_first": resident[0],
        "console.load_resident_mb_last": resident[-1],
        "console.load_resident_mb_most": max(resident),
    }


@contextmanager
def _console() -> Iterator[tuple[subprocess.Popen[str], str]]:
    command = [sys.executable, "-m", "pa_ros", "console", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ.copy())
    try:
        assert process.stdout is not None
        found = re.search(r"websocket=(\S+)", process.stdout.readline())
        if found is None:
            raise BenchError("console: expected its address, got none")
        yield process, found[1]
    finally:
        process.terminate()
        process.wait(timeout=TIMEOUT_S)


@contextmanager
def _page(address: str) -> Iterator[None]:
    """A page of viser's that takes what comes, for as long as the context lasts."""
    import msgspec
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    camera = {
        "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [1.0, 1.0, 1.0],
        "fov": 1.0, "near": 0.1, "far": 10.0, "image_height": 600, "image_width": 800,
        "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0],
    }  # fmt: skip
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with connect(address, subprotocols=[protocol], max_size=None, compression=None) as socket:
        socket.send(msgspec.msgpack.encode(camera))
        reader = threading.Thread(target=lambda: [None for _ in socket], daemon=True)
        reader.start()
        yield
    reader.join()


def _cpu_s(pid: int) -> float:
    """Time that all threads of a process have had on a core."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
