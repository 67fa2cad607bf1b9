"""One DPG update on the CPU in C++ with manual gradients, and the same code as an actor.

The formulas are those of docs/DESIGN.md, "Networks" and "Learning"; see native/trunk.h for how
they are rearranged. Float32; deterministic for given inputs, threads and instruction set.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable
from ctypes import byref
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import ARM_FEATURES, JOINTS, OBJECT_FEATURES, Float32
from pa_ros.core.update import HAND_INDEX, Batch, UpdateValues
from pa_ros.language import Program, compile_program, parse
from pa_ros.learning.algorithms.dpg.config import LearnerConfig
from pa_ros.native import library as fused_library
from pa_ros.native.library import FusedError
from pa_ros.native.tensors import FlatNetwork, describe
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import (
    GEOMETRY,
    Shapes,
    Tensors,
    actor_shapes,
    check_shapes,
    check_tensors,
    critic_shapes,
)
from pa_ros.networks.slots import target_one_hots
from pa_ros.world.programs import ProgramTable

Arrays = dict[str, NDArray[np.generic]]
Int32 = NDArray[np.int32]
log = logging.getLogger(__name__)

_BATCH_ARRAYS = (  # in the order of fused_library.Batch
    *("objects", "arm", "action", "next_objects", "next_arm"),
    *("program", "reward", "discount"),
)


def fused_available() -> tuple[bool, str]:
    """Whether the library is there; if not, why."""
    try:
        fused_library.library()
    except FusedError as error:
        return False, str(error)
    return True, ""


def why_not(network: NetworkConfig, config: LearnerConfig) -> str:
    """Empty where the fused update applies to a learner, else the reason."""
    if config.device != "cpu" or config.dtype != "float32":
        return f"it is for float32 on the CPU, not {config.dtype} on {config.device}"
    return why_not_network(network)


def why_not_network(network: NetworkConfig) -> str:
    """Empty where the fused code can compute a network, else the reason."""
    if len(network.vocabulary.words) > fused_library.MAX_WORDS:
        return f"it takes {fused_library.MAX_WORDS} words, not {len(network.vocabulary.words)}"
    return fused_available()[1]


class _Trained:
    """One network: parameters, target, gradient and moments, each a flat buffer."""

    def __init__(self, flat: FlatNetwork, tensors: Tensors) -> None:
        self.flat = flat
        self.parameters, self.target, self.gradient, self.m, self.v = (
            flat.buffer() for _ in range(5)
        )
        self.step = 0
        flat.write(self.parameters, tensors)
        self._detectors = flat.view(self.parameters, "detectors.weight")
        self.copy_target()

    def copy_target(self) -> None:
        self.target[:] = self.parameters

    def forget_geometry(self, share: float) -> None:
        """Take away a share of what the detectors make of all but the one-hots."""
        for weight in self._detectors:
            weight[:, GEOMETRY] *= np.float32(1.0 - share)

    def pointers(self) -> fused_library.Tensors:
        buffers = (self.parameters, self.target, self.gradient, self.m, self.v)
        return fused_library.Tensors(*(buffer.ctypes.data for buffer in buffers))

    def named_buffers(self, name: str) -> dict[str, Float32]:
        """Buffers by the prefixes of `Engine.tensors`."""
        return {
            f"{name}.": self.parameters,
            f"target_{name}.": self.target,
            f"adam.{name}.m.": self.m,
            f"adam.{name}.v.": self.v,
        }


class FusedEngine:
    """`Engine` by the native library; see `pa_ros.core.update` for the contract.

    Raises FusedError when the library is missing or a batch does not fit it.
    """

    name = "fused"

    def __init__(
        self,
        network: NetworkConfig,
        config: LearnerConfig,
        table: ProgramTable,
        actor: Tensors,
        critic: Tensors,
    ) -> None:
        if reason := why_not(network, config):
            raise FusedError(f"fused update: {reason}")
        check_tensors(actor, actor_shapes(network), "actor")
        check_tensors(critic, critic_shapes(network), "critic")
        self._table = table
        self._codes = _Codes(network, table)
        self._config = config
        self._settings = fused_library.Settings(
            beta1=config.adam_beta1,
            beta2=config.adam_beta2,
            epsilon=config.adam_epsilon,
            clip=config.action_gradient_clip,
            detector_gain=config.detector_gain,
            detector_decay_updates=np.inf,
        )
        self._trained = {
            "actor": _Trained(FlatNetwork(describe(network, critic=False)), actor),
            "critic": _Trained(FlatNetwork(describe(network, critic=True)), critic),
        }
        self._sizes = fused_library.Sizes()
        self._handle: int | None = None
        self._release: Callable[[], object] | None = None
        self._metrics: fused_library.Metrics | None = None
        self._warned = False

    def update(self, batch: Batch, values: UpdateValues) -> None:
        """One DPG update of critic and actor, both gradients at the parameters before it."""
        transitions, objects, programs = _check_batch(batch, len(self._table))
        op, a, b = self._codes.arrays()
        self._fit(transitions, objects, programs, op.shape[1])
        given = fused_library.Batch(
            *(transitions, objects, programs, HAND_INDEX),
            *(getattr(batch, name).ctypes.data for name in _BATCH_ARRAYS),
            *op.shape,
            *(array.ctypes.data for array in (op, a, b)),
        )
        metrics = fused_library.Metrics()
        actor, critic = self._trained["actor"], self._trained["critic"]
        settings = self._settings
        settings.actor_rate, settings.critic_rate = values.actor_rate, values.critic_rate
        settings.action_l2, settings.detector_decay = values.action_l2, values.detector_decay
        actor.step += 1
        critic.step += 1
        fused_library.library().pa_fused_update(
            self._handle, byref(given), actor.step, critic.step, byref(metrics)
        )
        if values.geometry_decay:
            actor.forget_geometry(values.geometry_decay)
            critic.forget_geometry(values.geometry_decay)
        self._metrics = metrics
        self._warn_if_clamped(metrics.largest_part)

    def copy_targets(self) -> None:
        """Hard copy of both networks to their targets (paper, appendix)."""
        for trained in self._trained.values():
            trained.copy_target()

    def actor_tensors(self) -> Tensors:
        """The actor's weights now, float32, owned by the caller."""
        actor = self._trained["actor"]
        return actor.flat.read(actor.parameters)

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""
        if self._metrics is None:
            return {}
        return {
            "critic_loss": self._metrics.critic_loss,
            "mean_q": self._metrics.mean_q,
            "actor_gradient_norm": self._metrics.actor_gradient_norm,
        }

    def gradients(self) -> Tensors:
        """Of the latest update, `actor.*` and `critic.*`: what Adam was given."""
        return {
            f"{name}.{key}": value
            for name, trained in self._trained.items()
            for key, value in trained.flat.read(trained.gradient).items()
        }

    def tensors(self) -> Arrays:
        """Everything an update depends on; see `Engine.tensors` for the names."""
        tensors: Arrays = {}
        for name, trained in self._trained.items():
            for prefix, buffer in trained.named_buffers(name).items():
                tensors |= {prefix + k: v for k, v in trained.flat.read(buffer).items()}
            tensors[f"adam.{name}.step"] = np.array(trained.step, np.int64)
        return tensors

    def load_tensors(self, tensors: Arrays) -> None:
        """The inverse of `tensors`; TensorError when names or shapes differ."""
        expected: Shapes = {name: value.shape for name, value in self.tensors().items()}
        check_shapes(tensors, expected, "engine")
        for name, trained in self._trained.items():
            for prefix, buffer in trained.named_buffers(name).items():
                own = {
                    k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)
                }
                trained.flat.write(buffer, cast(Tensors, own))
            trained.step = int(tensors[f"adam.{name}.step"])

    def _warn_if_clamped(self, largest: float) -> None:
        limit = fused_library.LARGEST_PART
        if largest > limit and not self._warned:
            self._warned = True
            log.warning(
                "fused update: a first layer reaches %.1f, and sums of two such are exact only to "
                "%.1f; use the torch engine if weights are meant to be this large",
                *(largest, limit),
            )

    def _fit(self, transitions: int, objects: int, programs: int, length: int) -> None:
        """Make the library's workspace anew unless the present one is large enough."""
        now = self._sizes
        same = (now.objects, now.programs) == (objects, programs)
        if self._handle and same and transitions <= now.transitions and length <= now.length:
            return
        self._sizes = fused_library.Sizes(
            transitions, objects, programs, length, self._config.threads
        )
        actor, critic = self._trained["actor"], self._trained["critic"]
        handle = fused_library.library().pa_fused_create(
            *(byref(x.flat.network) for x in (actor, critic)),
            *(byref(x.pointers()) for x in (actor, critic)),
            *(byref(self._settings), byref(self._sizes)),
        )
        if not handle:
            raise FusedError("fused update: not enough memory")
        if self._release:
            self._release()
        self._release = weakref.finalize(self, fused_library.library().pa_fused_destroy, handle)
        self._handle = handle


class FusedActor:
    """`pa_ros.networks.inference.Inference` by the native library; one thread at a time."""

    def __init__(self, config: NetworkConfig, tensors: Tensors) -> None:
        if reason := why_not_network(config):
            raise FusedError(f"fused actor: {reason}")
        check_tensors(tensors, actor_shapes(config), "actor")
        self._config = config
        self._flat = FlatNetwork(describe(config, critic=False))
        self._parameters = self._flat.buffer()
        self._flat.write(self._parameters, tensors)
        self._size = (0, 0)
        self._handle: int | None = None
        self._release: Callable[[], object] | None = None

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """Action in [-1, 1], [6], for objects [N, 16] and arm [18]."""
        objects, arm = (np.ascontiguousarray(x, np.float32) for x in (objects, arm))
        code = _code(program, self._config)
        _check_observation(objects, arm, hand_index)
        length = code.shape[1]
        self._fit(len(objects), length)
        action = np.empty(JOINTS, np.float32)
        start, step = code.ctypes.data, code.strides[0]
        fused_library.library().pa_fused_act(
            *(self._handle, objects.ctypes.data, arm.ctypes.data, hand_index),
            *(start, start + step, start + 2 * step, length, action.ctypes.data),
        )
        return action

    def _fit(self, objects: int, length: int) -> None:
        if self._handle and self._size[0] == objects and self._size[1] >= length:
            return
        library = fused_library.library()
        handle = library.pa_fused_actor_create(
            byref(self._flat.network), self._parameters.ctypes.data, objects, length
        )
        if not handle:
            raise FusedError("fused actor: not enough memory")
        if self._release:
            self._release()
        self._release = weakref.finalize(self, library.pa_fused_actor_destroy, handle)
        self._handle, self._size = handle, (objects, length)


class _Codes:
    """What the library is told of each program of a table: `op`, `a`, `b`, each [P, L]."""

    def __init__(self, network: NetworkConfig, table: ProgramTable) -> None:
        self._network, self._table = network, table
        self._made: tuple[Int32, Int32, Int32] | None = None

    def arrays(self) -> tuple[Int32, Int32, Int32]:
        """The same arrays until a program is added; UnsupportedProgramError as `_code` has it."""
        if self._network.kind != "canonical":
            return self._table.arrays()
        if self._made is None or len(self._made[0]) != len(self._table):
            programs = [parse(text, self._table.vocabulary) for text in self._table.texts]
            op, a, b = np.stack([_code(program, self._network) for program in programs], axis=1)
            self._made = op, a, b
        return self._made


@lru_cache(maxsize=1024)
def _code(program: Program, network: NetworkConfig) -> Int32:
    """`op`, `a`, `b` of the flat form as rows, [3, L].

    Canonical networks are told the two words of the target instead, as `a` and `b` of one row;
    UnsupportedProgramError for a program that has no such target.
    """
    if network.kind == "canonical":
        shape, color = np.flatnonzero(target_one_hots(program, network.vocabulary))
        return np.array([[0], [shape], [color]], np.int32)
    flat = compile_program(program, network.vocabulary)
    return np.array([flat.op, flat.a, flat.b], np.int32)


def _check_batch(batch: Batch, rows: int) -> tuple[int, int, int]:
    """B, N and K; FusedError for shapes, dtypes, strides or program rows that do not fit."""
    if batch.objects.ndim != 3 or batch.program.ndim != 2:
        raise FusedError(
            "fused update: expected objects [B, N, 16] and program [B, K], got "
            f"{batch.objects.shape} and {batch.program.shape}"
        )
    (transitions, objects, _), programs = batch.objects.shape, batch.program.shape[1]
    shapes = {
        "objects": (transitions, objects, OBJECT_FEATURES),
        "next_objects": (transitions, objects, OBJECT_FEATURES),
        "arm": (transitions, ARM_FEATURES),
        "next_arm": (transitions, ARM_FEATURES),
        "action": (transitions, JOINTS),
        "program": (transitions, programs),
        "reward": (transitions, programs),
        "discount": (transitions,),
    }
    for name, shape in shapes.items():
        array, dtype = getattr(batch, name), np.int32 if name == "program" else np.float32
        if array.shape != shape or array.dtype != dtype or not array.flags.c_contiguous:
            raise FusedError(
                f"fused update: {name}: expected contiguous {np.dtype(dtype)} {shape}, "
                f"got {array.dtype} {array.shape}"
            )
    _check_range("transitions", transitions, 1 << 20)
    _check_range("objects", objects, fused_library.MAX_OBJECTS)
    _check_range("programs", programs, fused_library.MAX_PROGRAMS)
    if batch.program.min() < 0 or batch.program.max() >= rows:
        raise FusedError(f"fused update: expected programs below {rows}, got {batch.program.max()}")
    return transitions, objects, programs


def _check_range(name: str, size: int, most: int) -> None:
    if not 1 <= size <= most:
        raise FusedError(f"fused update: {name}: expected 1 … {most}, got {size}")


def _check_observation(objects: Float32, arm: Float32, hand_index: int) -> None:
    _check_range("objects", len(objects), fused_library.MAX_OBJECTS)
    if objects.shape[1:] != (OBJECT_FEATURES,) or arm.shape != (ARM_FEATURES,):
        raise FusedError(
            f"fused actor: expected objects [N, 16] and arm [18], got {objects.shape}, {arm.shape}"
        )
    if not 0 <= hand_index < len(objects):
        raise FusedError(
            f"fused actor: hand_index: expected below {len(objects)}, got {hand_index}"
        )
