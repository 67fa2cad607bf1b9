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


# What hands out a message, by the name called; and what calls back with one.
SOURCES = {"Message", "deserialize", "deserialize_cdr", "deserialize_message", "take_message"}
CALLBACK_TAKERS = {
    "checked",
    "create_subscription",
    "create_service",
    "guard",
    "subscribe",
    "through",
}
NAMES = {"message", "msg", "response"}  # parameters that are called so are messages
READERS = {"header_stamp", "is_evaluation", "arena_of"}  # and whatever begins with decode_
BY_NAME = {"getattr", "setattr", "hasattr", "delattr", "vars"}
FROM_CONTAINER = {"get", "items", "pop", "popleft", "values"}

Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda


def accesses(source: str) -> list[tuple[int, str]]:
    """(line, access) of every field of a message that the source reads or writes."""
    tree = ast.parse(source)
    reader = _Reader(_attributes(tree), _callbacks(tree))
    reader.visit(tree)
    return sorted(set(reader.found))


def _attributes(tree: ast.AST) -> dict[str, bool]:
    """Attributes annotated as messages; True: as something that holds messages."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            held = _annotated(node.annotation)
            name = node.target.attr if isinstance(node.target, ast.Attribute) else None
            if isinstance(node.target, ast.Name):
                name = node.target.id
            if held is not None and name is not None:
                found[name] = held
    return found


def _annotated(annotation: ast.expr | None) -> bool | None:
    """False: a message; True: a container of them; None: neither."""
    names = {n.id for n in ast.walk(annotation) if isinstance(n, ast.Name)} if annotation else set()
    if "Message" not in names or "Callable" in names:
        return None
    return not isinstance(annotation, (ast.Name, ast.BinOp))


def _callbacks(tree: ast.AST) -> set[str]:
    """Names of functions that are called back with messages."""
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

    def __init__(self, attributes: dict[str, bool], callbacks: set[str]) -> None:
        self.found: list[tuple[int, str]] = []
        self._attributes = attributes
        self._callbacks = callbacks
        self._names: dict[str, bool] = {}  # as in _annotated
        self._lambdas: set[ast.Lambda] = set()  # that are called back with messages

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._function(node, node.name in self._callbacks)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self._function(node, node in self._lambdas)

    def _function(self, node: Function, called_back: bool) -> None:
        outer, self._names = self._names, dict(self._names)
        for parameter in [*node.args.args, *node.args.kwonlyargs]:
            held = _annotated(parameter.annotation)
            self._names.pop(parameter.arg, None)
            if held is not None:
                self._names[parameter.arg] = held
            elif parameter.arg in NAMES:
                self._names[parameter.arg] = False
        if called_back and node.args.args and not self._spared(node.args.args[-1]):
            self._names[node.args.args[-1].arg] = False
        for inner in ast.walk(node):  # whatever is given to a decoder is a message
            if isinstance(inner, ast.Call) and self._decodes(inner):
                self._names |= {a.id: False for a in inner.args[:1] if isinstance(a, ast.Name)}
        self.generic_visit(node)
        self._names = outer

    @staticmethod
    def _spared(parameter: ast.arg) -> bool:
        """`self`, or annotated as something of ours."""
        note = parameter.annotation
        if parameter.arg == "self":
            return True
        return note is not None and ast.unparse(note) not in ("Any", "object", "Message")

    @staticmethod
    def _decodes(call: ast.Call) -> bool:
        name = _called(call)
        return name.startswith("decode_") or name in READERS

    def visit_Assign(self, node: ast.Assign) -> None:
        held = self._holds(node.value)
        for target in node.targets:
            self._bind(target, held)
        self.generic_visit(node)

    def visit_For(self, node: ast.For) -> None:
        self._bind(node.target, None if self._holds(node.iter) is None else False)
        self.generic_visit(node)

    def _bind(self, target: ast.expr, held: bool | None) -> None:
        names = target.elts if isinstance(target, (ast.Tuple, ast.List)) else [target]
        for name in names:
            if isinstance(name, ast.Name) and held is not None:
                self._names[name.id] = held

    def visit_Call(self, node: ast.Call) -> None:
        if _called(node) in CALLBACK_TAKERS:
            self._lambdas |= {a for a in node.args if isinstance(a, ast.Lambda)}
        if _called(node) in BY_NAME and node.args and self._holds(node.args[0]) is False:
            self.found.append((node.lineno, ast.unparse(node)))
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if self._holds(node.value) is False:
            self.found.append((node.lineno, ast.unparse(node)))
        self.generic_visit(node)

    def _holds(self, node: ast.expr) -> bool | None:
        """What an expression's value is, as in _annotated."""
        if isinstance(node, ast.Name):
            return self._names.get(node.id)
        if isinstance(node, ast.Attribute):
            return self._attributes.get(node.attr)
        if isinstance(node, ast.Subscript):
            return None if self._holds(node.value) is None else False
        if isinstance(node, ast.Call):
            name = _called(node)
            if name in SOURCES or name.startswith("encode_"):
                return False
            if name in FROM_CONTAINER and isinstance(node.func, ast.Attribute):
                return False if self._holds(node.func.value) else None
        return None
