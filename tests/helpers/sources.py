"""The source files of the packages, and which fields of ROS messages they access."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "pa_ros": ROOT / "pa_ros/pa_ros",
    "sim_node": ROOT / "sim_node/sim_node",
    "agent_node": ROOT / "agent_node/agent_node",
    "learner_node": ROOT / "learner_node/learner_node",
}


def files() -> list[tuple[str, Path]]:
    """(module, path) of every source file."""
    found = []
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found.append((".".join([package, *(p for p in parts if p != "__init__")]), path))
    return found


# Beginnings of functions that return a message, and names of parameters that are messages.
SOURCES = ("encode_", "deserialize", "take_message")
NAMES = {"message", "msg", "response"}
BY_NAME = {"getattr", "setattr", "hasattr", "delattr", "vars"}


def accesses(source: str) -> list[str]:
    """The code of every access to a field of a message that is typed Any.

    mypy finds the others: a Message has no attributes.
    """
    functions = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef)]
    return [code for function in functions for code in _accesses(function)]


def _accesses(function: ast.FunctionDef) -> Iterator[str]:
    parameters = [*function.args.args, *function.args.kwonlyargs]
    messages = {one.arg for one in parameters if one.arg in NAMES}
    nodes = list(ast.walk(function))
    for node in nodes:
        if isinstance(node, ast.Assign) and _called(node.value).startswith(SOURCES):
            messages |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.Call) and _called(node).startswith("decode_"):
            messages |= {given.id for given in node.args[:1] if isinstance(given, ast.Name)}
    for node in nodes:
        if isinstance(node, ast.Attribute):
            read = node.value
        elif isinstance(node, ast.Call) and _called(node) in BY_NAME and node.args:
            read = node.args[0]
        else:
            continue
        if isinstance(read, ast.Subscript):  # a message of several
            read = read.value
        known = isinstance(read, ast.Name) and read.id in messages
        if known or _called(read).startswith(SOURCES):
            yield ast.unparse(node)


def _called(node: ast.AST) -> str:
    """The name of the function that a node calls."""
    if not isinstance(node, ast.Call):
        return ""
    return str(getattr(node.func, "attr", getattr(node.func, "id", "")))
