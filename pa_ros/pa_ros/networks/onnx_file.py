"""Actors as ONNX files: weights, and what inputs and outputs mean, for programs without pa_ros.

The graph is that of `pa_ros.networks.programmable`, with programs joined by MIN_MAX. A Loop
executes a program's instructions, so programs of any length are inputs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError, needs_extra
from pa_ros.core.files import written_beside
from pa_ros.language import MIN_MAX, Program
from pa_ros.language.flat import AND, NOT, OR, compile_program
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.detectors import sharpened
from pa_ros.networks.parameters import LITTLE, NOTHING, Tensors

OPSET, IR_VERSION = 17, 8  # of 2022, so that older runtimes read the files


def program_inputs(program: Program, network: NetworkConfig) -> dict[str, Any]:
    """A model's inputs for one program: lists by input name, without the batch axis.

    Raises ProgramError for a word or relation that the network does not know.
    """
    vocabulary = network.vocabulary
    code = compile_program(program, vocabulary)
    inputs: dict[str, Any] = {
        "program": [*map(list, zip(code.op, code.a, code.b, strict=True))],
        "relation": code.relation,
        "roles": [code.moved, code.target],
    }
    return {name: inputs[name] for name in meanings(network) if name in inputs}


def meanings(network: NetworkConfig) -> dict[str, tuple[tuple[str | int, ...], str]]:
    """Shape and meaning of each input, in order, and of the outputs `action` and `relevance`."""
    world, vocabulary = network.world, network.vocabulary
    joints, words = world.joints, len(vocabulary.words)
    found: dict[str, tuple[tuple[str | int, ...], str]] = {
        "objects": (
            ("batch", "objects", world.object_features),
            "the hand (position 0, quaternion 0 0 0 1, properties 0), then the blocks in any "
            f"order; columns {' '.join(world.schema.feature_names)}; position in m and "
            "orientation (qw >= 0) in the frame of the hand",
        ),
        "joint_position": (("batch", joints), "rad"),
        "joint_velocity": (("batch", joints), "rad/s"),
    }
    if world.sees_hand_pose:
        pose = "x y z qx qy qz qw, m, in the base's frame" + "; 1 if it holds" * world.gripper
        found["hand_pose"] = (("batch", world.hand_features), pose)
    found["program"] = (
        ("batch", "instructions", 3),
        "int64 operation (0 NOT, 1 AND, 2 OR, 3 COPY: for padding), register a, register b; "
        f"registers 0 to {words - 1} are {' '.join(vocabulary.words)}, {words} is HAND, and "
        f"instruction k writes {words + 1} + k; see the metadata `programs`",
    )
    if vocabulary.relation_inputs:
        found["relation"] = (("batch",), f"int64 number of {' '.join(vocabulary.relations)}")
    if vocabulary.moves_objects:
        found["roles"] = (("batch", 2), "int64 registers of what is moved and of the target")
    action = "a share in [-1, 1] of each joint's speed limit"
    if world.controller is not None:
        action = (
            "the hand's velocity away from the base's axis, about it and up, shares in [-1, 1] "
            f"of {world.controller.hand_speed:g} m/s; pa_ros.world.controller makes joint "
            "velocities of it"
        )
    action += "; then the gripper, on above 0" * world.gripper
    found["action"] = (("batch", world.actions), action)
    found["relevance"] = (("batch", "objects"), "p: the degree to which the program means each")
    return found


def write_onnx(
    path: Path,
    network: NetworkConfig,
    tensors: Tensors,
    programs: Iterable[Program],
    about: Mapping[str, str],
) -> None:
    """Write an actor that is greedy and acts by MIN_MAX.

    The file's metadata contains `about` and `programs`: compiled inputs by text, of these programs.
    Raises ConfigError without the extra onnx, or for networks that take no programs, or
    that avoid.
    """
    if network.actor != "programmable":
        raise ConfigError(
            f"export: onnx: expected programmable networks of this package, got {network.family}"
        )
    if "avoid.0.weight" in tensors:
        raise ConfigError(
            "export: onnx: expected networks without AVOID, got ones that learned it, which are "
            "not exported"
        )
    with needs_extra("onnx", "export"):
        from onnx import TensorProto, checker, helper, save
    graph = _Graph()
    action, relevance = _actor(graph, network, sharpened(tensors, MIN_MAX))
    inputs: list[Any] = []
    outputs: list[Any] = []
    for name, (shape, meaning) in meanings(network).items():
        output = name in ("action", "relevance")
        integers = name in ("program", "relation", "roles")
        kind = TensorProto.INT64 if integers else TensorProto.FLOAT
        described = helper.make_tensor_value_info(name, kind, shape, meaning)
        (outputs if output else inputs).append(described)
    graph.nodes.append(helper.make_node("Identity", [action], ["action"]))
    graph.nodes.append(helper.make_node("Identity", [relevance], ["relevance"]))
    body = helper.make_graph(
        graph.nodes, "actor", inputs, outputs, graph.constants, "docs/tools.md of pa_ros"
    )
    opset = helper.make_opsetid("", OPSET)
    model = helper.make_model(body, opset_imports=[opset], ir_version=IR_VERSION)
    compiled = {str(program): program_inputs(program, network) for program in programs}
    helper.set_model_props(model, {**about, "programs": json.dumps(compiled)})
    checker.check_model(model, full_check=True)
    with written_beside(path) as beside:
        save(model, str(beside))


class _Graph:
    """Nodes so far. Calling it adds one and returns the name of its output."""

    def __init__(self, prefix: str = "") -> None:
        self.prefix = prefix  # a loop's body sees the names outside, so its own must differ
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def __call__(self, op: str, *inputs: Any, outputs: int = 1, **attributes: Any) -> Any:
        """Add a node; inputs that are no names become constants."""
        from onnx import helper

        names = [x if isinstance(x, str) else self.constant(x) for x in inputs]
        made = [f"{self.prefix}{op.lower()}_{len(self.nodes)}_{k}" for k in range(outputs)]
        self.nodes.append(helper.make_node(op, names, made, **attributes))
        return made[0] if outputs == 1 else made

    def constant(self, value: Any) -> str:
        """A constant: integers as int64, other numbers as float32."""
        from onnx import numpy_helper

        array = np.asarray(value)
        array = array.astype(np.int64 if array.dtype.kind == "i" else np.float32)
        name = f"{self.prefix}constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(array, name))
        return name


def _actor(g: _Graph, network: NetworkConfig, tensors: Tensors) -> tuple[str, str]:
    """The action and p; the names and comments are those of `programmable.Trunk`."""

    def linear(name: str, x: str) -> str:
        return str(g("Add", g("MatMul", x, tensors[f"{name}.weight"].T), tensors[f"{name}.bias"]))

    def tanh_linear(name: str, x: str) -> str:
        return str(g("Tanh", linear(name, x)))

    world = network.world
    joints = [g("Sin", "joint_position"), g("Cos", "joint_position"), "joint_velocity"]
    arm = g("Concat", *joints, *["hand_pose"] * world.sees_hand_pose, axis=-1)  # [B, A]
    batch, count = g("Shape", "objects", start=0, end=1), g("Shape", "objects", start=1, end=2)
    shape = g("Concat", batch, count, [world.arm_features], axis=0)
    arms = g("Expand", g("Unsqueeze", arm, [1]), shape)
    columns = g("Concat", g("Mul", "objects", network.input_scales), arms, axis=-1)  # ω, [B, N, C]
    registers = _registers(g, network, linear("detectors", columns), batch, count)
    p = g("Gather", registers, np.int64(-1), axis=1)  # [B, N]

    seen = np.ones(world.columns, np.float32)
    if not network.relations_see_properties:
        seen[world.schema.properties] = 0.0
    columns = g("Mul", columns, seen)
    queries = g("Unsqueeze", linear("query", columns), [2])
    pairs = g("Add", queries, g("Unsqueeze", linear("context", columns), [1]))
    scores = g("MatMul", g("Tanh", pairs), tensors["attention.weight"])  # [B, N, N]
    numbers = g("Range", np.int64(0), g("Squeeze", count), np.int64(1))  # [N]
    own = g("Equal", numbers, g("Unsqueeze", numbers, [1]))  # the diagonal, [N, N]
    own = g("Where", own, np.float32(network.self_weight), np.float32(1))
    if "roles" in meanings(network):
        moved, target = _sets(g, network, registers)
        most = g("ReduceMax", scores, axes=[1, 2], keepdims=1)
        weights = g("Mul", g("Exp", g("Sub", scores, most)), own)
        pairs = g("Mul", g("Unsqueeze", moved, [2]), g("Unsqueeze", target, [1]))
        weights = g("Mul", pairs, weights)
        total = g("Add", g("ReduceSum", weights, [1, 2], keepdims=1), np.float32(LITTLE))
        weights = g("Div", weights, total)  # [B, N, N]
        receivers = g("ReduceSum", weights, [2], keepdims=0)
    else:
        most = g("ReduceMax", scores, axes=[-1], keepdims=1)
        weights = g("Mul", g("Exp", g("Sub", scores, most)), own)
        weights = g("Mul", g("Unsqueeze", p, [1]), weights)
        total = g("ReduceSum", weights, [-1], keepdims=1)
        alpha = g("Div", weights, g("Max", total, np.float32(NOTHING)))
        receivers, weights = p, g("Mul", g("Unsqueeze", p, [2]), alpha)  # p_i α_ij, [B, N, N]

    receiving, sending = np.hsplit(tensors["message.0.weight"], 2)
    received = g("Add", g("MatMul", columns, receiving.T), tensors["message.0.bias"])
    sent = g("MatMul", columns, sending.T)
    sums = g("Add", g("Unsqueeze", received, [2]), g("Unsqueeze", sent, [1]))  # [B, N, N, H]
    if "relation.weight" in tensors:
        added = g("Gather", tensors["relation.weight"].T, "relation", axis=0)  # [B, H]
        sums = g("Add", sums, g("Unsqueeze", added, [1, 2]))
    messages = g("Mul", g("Tanh", sums), g("Unsqueeze", weights, [3]))
    r = g("ReduceSum", messages, [1, 2], keepdims=0)  # [B, H]
    local = g("Mul", tanh_linear("local.0", columns), g("Unsqueeze", receivers, [2]))
    f = g("ReduceSum", local, [1], keepdims=0)
    h = g(
        "Sum",
        g("MatMul", f, tensors["local.1.weight"].T),
        g("MatMul", r, tensors["message.1.weight"].T),
        g(
            "Mul",
            g("ReduceSum", receivers, [1], keepdims=1),
            tensors["local.1.bias"] + tensors["message.1.bias"],
        ),
    )
    z = g("Tanh", h)
    for layer in range(network.upper_layers):
        z = tanh_linear(f"upper.{layer}", z)
    return tanh_linear("output", z), p


def _registers(g: _Graph, network: NetworkConfig, logits: str, batch: str, count: str) -> str:
    """All registers of each program, [B, V + 1 + L, N], of the detectors' logits [B, N, V]."""
    from onnx import TensorProto, helper

    sizes = network.vocabulary.group_sizes
    groups = g("Split", logits, np.array(sizes), axis=-1, outputs=len(sizes))
    softmax = [g("Softmax", group, axis=-1) for group in ([groups] if len(sizes) == 1 else groups)]
    phi = g("Transpose", g("Concat", *softmax, axis=-1), perm=[0, 2, 1])
    one = g("Constant", value=helper.make_tensor("", TensorProto.FLOAT, [1], [1.0]))
    zeros = g("Sub", count, [1])
    others = g("ConstantOfShape", zeros)
    hand = g("Expand", g("Concat", one, others, axis=0), g("Concat", batch, [1], count, axis=0))
    start = g("Concat", phi, hand, axis=1)  # [B, V + 1, N]

    body = _Graph("body_")
    code = body("Gather", "program", "k", axis=1)  # [B, 3]
    wanted = body("Concat", batch, [2], count, axis=0)
    sources = body("Unsqueeze", body("Slice", code, [1], [3], [1]), [2])
    both = body("GatherElements", "registers", body("Expand", sources, wanted), axis=1)
    x, y = body("Split", both, [1, 1], axis=1, outputs=2)
    op = body("Unsqueeze", body("Slice", code, [0], [1], [1]), [2])  # [B, 1, 1]
    result = body("Where", body("Equal", op, np.int64(NOT)), body("Sub", np.float32(1), x), x)
    result = body("Where", body("Equal", op, np.int64(AND)), body("Min", x, y), result)
    result = body("Where", body("Equal", op, np.int64(OR)), body("Max", x, y), result)
    body.nodes += [
        helper.make_node("Concat", ["registers", result], ["registers_after"], axis=1),
        helper.make_node("Identity", ["condition"], ["condition_after"]),
    ]
    rows = ("batch", None, "objects")
    flag, number, numbers = TensorProto.BOOL, TensorProto.INT64, TensorProto.FLOAT
    info = helper.make_tensor_value_info
    before = [info("k", number, []), info("condition", flag, []), info("registers", numbers, rows)]
    after = [info("condition_after", flag, []), info("registers_after", numbers, rows)]
    step = helper.make_graph(body.nodes, "instruction", before, after, body.constants)
    length = g("Squeeze", g("Shape", "program", start=1, end=2))
    return str(g("Loop", length, "", start, body=step))


def _sets(g: _Graph, network: NetworkConfig, registers: str) -> tuple[str, str]:
    """Degrees of the two sets of programs that move objects, moved and target: [B, N] each."""
    roles = g("Unsqueeze", "roles", [2])  # [B, 2, 1]
    count = g("Shape", registers, start=2, end=3)
    shape = g("Concat", g("Shape", registers, start=0, end=1), [2], count, axis=0)
    chosen = g("GatherElements", registers, g("Expand", roles, shape), axis=1)  # [B, 2, N]
    other = g("Greater", g("Range", np.int64(0), g("Squeeze", count), np.int64(1)), np.int64(0))
    kept = g("Or", other, g("Equal", roles, np.int64(len(network.vocabulary.words))))
    sets = g("Where", kept, chosen, np.float32(0))
    moved, target = g("Split", sets, [1, 1], axis=1, outputs=2)
    return str(g("Squeeze", moved, [1])), str(g("Squeeze", target, [1]))
