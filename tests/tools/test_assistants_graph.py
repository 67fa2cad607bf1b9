"""Assistants' tools by the Model Context Protocol: what is offered, and scripted calls to a graph.

The calls go through the SDK's own client: in memory to a stand-in, over stdio to `pa_ros mcp`.
"""

import io
import json
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import anyio
import pytest
from PIL import Image

from pa_ros.core.errors import PaError

mcp = pytest.importorskip("mcp", reason="the extra `mcp` is not installed")
from pa_ros.tools.assistants import Table, make_server  # noqa: E402

if TYPE_CHECKING:
    from pa_ros import Arm

LOOKING = {"scene", "check", "status", "picture"}
REACHABLE = "NEAR(HAND, AND(RED, CUBE))"


class StandIn:
    """An arm whose program ends only when it is cancelled."""

    def __init__(self) -> None:
        self.began, self.cancelled = threading.Event(), threading.Event()

    def execute(self, program: str, timeout: float) -> SimpleNamespace:
        self.began.set()
        assert self.cancelled.wait(60)
        return SimpleNamespace(
            program=program, success=False, distance=float("inf"), reached_s=None, reason="stopped"
        )

    def cancel(self) -> None:
        self.cancelled.set()


def run_apart(run) -> None:
    """Run a coroutine in another thread: other tests' browser leaves an event loop in this one."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(anyio.run, run).result()


def ask(table: Table, allow_execute: bool, script) -> None:
    """Run a script with a client of a server in this process."""

    async def run() -> None:
        async with mcp.Client(make_server(table, allow_execute)) as client:
            await script(client)

    run_apart(run)


def test_without_permission_only_looking_is_offered():
    async def script(client) -> None:
        tools = (await client.list_tools()).tools
        assert {tool.name for tool in tools} == LOOKING
        assert all(tool.annotations.read_only_hint and tool.description for tool in tools)
        assert "take them (HOLD)" in client.instructions and "nothing moves" in client.instructions
        assert (await client.call_tool("execute", {"program": REACHABLE})).is_error

    ask(Table(lambda: pytest.fail("no tool was called")), False, script)


def test_cancel_is_heard_while_a_program_is_executed():
    arm = StandIn()

    async def script(client) -> None:
        results = []

        async def execute() -> None:
            results.append(await client.call_tool("execute", {"program": REACHABLE}))

        async with anyio.create_task_group() as group:
            group.start_soon(execute)
            await anyio.to_thread.run_sync(arm.began.wait, 30)
            await client.call_tool("cancel")
        assert results[0].structured_content["reason"] == "stopped"
        assert results[0].structured_content["distance"] is None
        refused = await client.call_tool("execute", {"program": REACHABLE, "timeout_s": 1e6})
        assert refused.is_error and "timeout_s: expected 0.1 to 60" in refused.content[0].text

    ask(Table(lambda: arm), True, script)  # type: ignore[arg-type, return-value]


def test_a_call_that_is_withdrawn_cancels_the_program():
    arm = StandIn()

    async def script(client) -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(client.call_tool, "execute", {"program": REACHABLE})
            await anyio.to_thread.run_sync(arm.began.wait, 30)
            group.cancel_scope.cancel()
        assert await anyio.to_thread.run_sync(arm.cancelled.wait, 30)

    ask(Table(lambda: arm), True, script)  # type: ignore[arg-type, return-value]


def test_without_a_graph_each_call_says_what_to_do():
    def nobody():
        raise PaError("no arena within 10 s: start one (`pa_ros launch`)")

    async def script(client) -> None:
        answer = await client.call_tool("scene")
        assert answer.is_error and "start one (`pa_ros launch`)" in answer.content[0].text

    ask(Table(nobody), False, script)


@pytest.fixture(scope="module")
def other(module_domain: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator["Arm"]:
    from pa_ros import Arm

    logs: Path = tmp_path_factory.mktemp("assistants")
    with Arm.simulated(speed=5.0, domain=int(module_domain), logs=logs) as other:
        yield other


@pytest.mark.graph
def test_an_assistant_looks_checks_executes_and_sees_the_result(other: "Arm"):
    server = mcp.StdioServerParameters(
        command=sys.executable,
        args=["-m", "pa_ros", "mcp", "--allow-execute"],
        env={**os.environ, "ROS_DOMAIN_ID": str(other.graph.domain)},
    )

    async def run() -> None:
        async with mcp.Client(server, read_timeout_seconds=90) as client:
            assert {t.name for t in (await client.list_tools()).tools} == {
                *LOOKING, "execute", "cancel",
            }  # fmt: skip

            async def call(name: str, **given):
                answer = await client.call_tool(name, given)
                assert not answer.is_error, answer.content
                return json.loads(answer.content[0].text)

            status = await call("status")
            assert status["an_agent_takes_programs"] and not status["executing"]
            goal = other.start(REACHABLE, timeout=0, hold=10_000)
            while not (await call("status"))["executing"]:
                await anyio.sleep(0.1)
            goal.cancel()

            scene = await call("scene")
            assert "RED CUBE" in scene["blocks"] and REACHABLE in scene["programs_that_make_sense"]
            assert not scene["can_push"] and not scene["can_grasp"]
            wrong = await call("check", program="NEAR(HAND, AND(RED, CUB))")
            assert not wrong["valid"] and "did you mean CUBE" in wrong["error"]
            assert (await call("check", program=REACHABLE))["valid"]
            result = await call("execute", program=REACHABLE, timeout_s=30)
            assert result["success"] and result["distance"] <= 0.2
            status = await call("status")
            assert status["an_agent_takes_programs"] and not status["executing"]
            picture = await client.call_tool("picture")
            import base64

            image = Image.open(io.BytesIO(base64.b64decode(picture.content[0].data)))
            assert image.size == (480, 480) and len(image.getcolors(480 * 480)) > 4
            absent = await client.call_tool("execute", {"program": "NEAR(HAND, BLUE)"})
            assert absent.is_error and "no such object" in absent.content[0].text

    run_apart(run)
