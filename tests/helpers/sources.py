"""The source files of the packages, and which fields of ROS messages they access."""

from __future__ import annotations

import ast
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


# Calls that return a message, and calls that pass one to a callback.
SOURCES = {"Message", "deserialize", "deserialize_cdr", "deserialize_message", "take_message"}
CALLBACK_TAKERS = {"checked", "create_subscription", "create_service", "guard", "subscribe"}
# Parameters with these names are messages.
NAMES = {"message", "msg", "response"}
READERS = {"header_stamp", "is_evaluation", "arena_of"}  # and all that begin with decode_
BY_NAME = {"getattr", "setattr", "hasattr", "delattr", "vars"}


def accesses(source: str) -> list[tuple[int, str]]:
    """Line and code of every access to a field of a message.

    It finds messages typed Any, by where they come from; mypy finds those typed Message, which
    have no attributes.
    """
    tree = ast.parse(source)
    reader = _Reader(_callbacks(tree))
    reader.visit(tree)
    return sorted(set(reader.found))


def _callbacks(tree: ast.AST) -> set[str]:
    """Names of the functions that are called back with messages."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _called(node) in CALLBACK_TAKERS:
            for argument in node.args:
                parts = [*ast.walk(argument)] if isinstance(argument, ast.Call) else [argument]
                found |= {p.attr for p in parts if isinstance(p, ast.Attribute)}
                found |= {p.id for p in parts if isinstance(p, ast.Name)}
    return found


def _called(call: ast.Call) -> str:
    function = call.func
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


class _Reader(ast.NodeVisitor):
    """Follows messages through the names of each function."""

    def __init__(self, callbacks: set[str]) -> None:
        self.found: list[tuple[int, str]] = []
        self._callbacks = callbacks
        self._names: set[str] = set()  # that are messages
        self._lambdas: set[ast.Lambda] = set()  # that are called back with messages

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._function(node, node.name in self._callbacks)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self._function(node, node in self._lambdas)

    def _function(self, node: ast.FunctionDef | ast.Lambda, called_back: bool) -> None:
        outer, parameters = self._names, [*node.args.args, *node.args.kwonlyargs]
        self._names = outer - {one.arg for one in parameters}
        self._names |= {one.arg for one in parameters if one.arg in NAMES and _untyped(one)}
        if called_back and node.args.args and _untyped(last := node.args.args[-1]):
            self._names.add(last.arg)
        for inner in ast.walk(node):
            if isinstance(inner, ast.Call) and (
                _called(inner).startswith("decode_") or _called(inner) in READERS
            ):
                self._names |= {a.id for a in inner.args[:1] if isinstance(a, ast.Name)}
        self.generic_visit(node)
        self._names = outer

    def visit_Assign(self, node: ast.Assign) -> None:
        if self._is_message(node.value):
            self._names |= {t.id for t in node.targets if isinstance(t, ast.Name)}
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        if _called(node) in CALLBACK_TAKERS:
            self._lambdas |= {a for a in node.args if isinstance(a, ast.Lambda)}
        if _called(node) in BY_NAME and node.args and self._is_message(node.args[0]):
            self.found.append((node.lineno, ast.unparse(node)))
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if self._is_message(node.value):
            self.found.append((node.lineno, ast.unparse(node)))
        self.generic_visit(node)

    def _is_message(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Name):
            return node.id in self._names
        if isinstance(node, ast.Subscript):  # a message of several
            return self._is_message(node.value)
        if isinstance(node, ast.Call):
            name = _called(node)
            return name in SOURCES or name.startswith("encode_")
        return False


def _untyped(parameter: ast.arg) -> bool:
    """Whether a parameter may be a message, as far as its annotation says."""
    note = parameter.annotation
    if parameter.arg == "self":
        return False
    return note is None or ast.unparse(note) in ("Any", "object", "Message")
