"""The shared library of the fused update: loading it, and its structures (native/layout.h)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, byref, c_char_p, c_double, c_float, c_int32, c_int64, c_void_p
from functools import cache
from pathlib import Path

import pa_ros.native as package
from pa_ros.core.errors import PaError

NAME = "_fused.so"  # in the package's folder; an editable installation has two
INTERFACE = 19  # of native/layout.h
MAX_WORDS, MAX_OBJECTS, MAX_PROGRAMS, MAX_GROUPS, MAX_SLOTS = 128, 64, 64, 8, 32
LARGEST_PART = 43.6


class FusedError(PaError):
    """The fused update cannot be loaded, or cannot take what it was given."""

    code = "native.fused"


class Network(ctypes.Structure):
    """One network; see native/layout.h."""

    _fields_ = [
        *((name, c_int32) for name in ("hidden", "attention", "words", "groups")),
        ("group_size", c_int32 * MAX_GROUPS),
        ("detectors", c_int32),
        ("hide_properties", c_int32),
        ("critic", c_int32),
        ("truth", c_int32 * MAX_WORDS),
        ("position_scale", c_float),
        ("self_weight", c_float),
        ("canonical", c_int32),
        ("slots", c_int32),
        ("slot_shape", c_int32 * MAX_SLOTS),
        ("slot_color", c_int32 * MAX_SLOTS),
    ]


class Layout(ctypes.Structure):
    """Offsets and sizes within a network's flat buffer, in floats; see native/layout.h."""

    hidden: int
    attention: int
    columns: int
    local: int
    receiver: int
    sender: int
    query: int
    context: int
    detectors: int
    first: int
    attention_weight: int
    second: int
    second_bias: int
    action: int
    output: int
    output_bias: int
    size: int
    inputs: int  # canonical networks alone
    _fields_ = [
        (name, c_int64)
        for name in (
            *("hidden", "attention", "columns"),
            *("local", "receiver", "sender", "query", "context", "detectors"),
            *("first", "attention_weight", "second", "second_bias"),
            *("action", "output", "output_bias", "size", "inputs"),
        )
    ]


class Tensors(ctypes.Structure):
    """Buffers of one trained network."""

    _fields_ = [
        (name, c_void_p)
        for name in ("parameters", "target", "gradient", "first_moment", "second_moment")
    ]


class Settings(ctypes.Structure):
    """Learning rates, Adam's constants, the clip of ∂Q/∂a and the rest of LearnerConfig."""

    _fields_ = [
        (name, c_double)
        for name in (
            *("actor_rate", "critic_rate", "beta1", "beta2", "epsilon"),
            *("clip", "action_l2", "detector_gain"),
            *("detector_decay", "detector_decay_updates"),
        )
    ]


class Sizes(ctypes.Structure):
    """The most of each that a learner will be given; objects and programs exactly."""

    _fields_ = [
        (name, c_int32) for name in ("transitions", "objects", "programs", "length", "threads")
    ]


class Batch(ctypes.Structure):
    """One batch and the program table it points into."""

    _fields_ = [
        *((name, c_int32) for name in ("transitions", "objects", "programs", "hand_index")),
        *((name, c_void_p) for name in ("object", "arm", "action", "next_object", "next_arm")),
        *((name, c_void_p) for name in ("program", "reward", "discount")),
        *((name, c_int32) for name in ("table_rows", "table_length")),
        *((name, c_void_p) for name in ("op", "a", "b")),
    ]


class Metrics(ctypes.Structure):
    """What one update reports."""

    critic_loss: float
    mean_q: float
    actor_gradient_norm: float
    largest_part: float  # |x| or |y| of the sums x + y under tanh; exact up to LARGEST_PART
    _fields_ = [
        (name, c_double)
        for name in ("critic_loss", "mean_q", "actor_gradient_norm", "largest_part")
    ]


@cache
def library() -> ctypes.CDLL:
    """The library, its functions typed; FusedError when it is not there or not loadable."""
    try:
        loaded = ctypes.CDLL(str(_path()))
        interface = loaded.pa_fused_interface()
        _declare(loaded)
    except (OSError, AttributeError) as error:
        raise FusedError(f"fused update: expected a library {NAME}: {error}") from error
    if interface != INTERFACE:
        raise FusedError(f"fused update: expected interface {INTERFACE}, got {interface}: rebuild")
    return loaded


def _path() -> Path:
    """The library that was built last; the bare name, which no loader finds, if there is none."""
    paths = [path for folder in package.__path__ if (path := Path(folder, NAME)).exists()]
    return max(paths, key=lambda path: path.stat().st_mtime, default=Path(NAME))


def level() -> str:
    """The instruction set in use: "x86-64-v4", "x86-64-v3" or "generic"."""
    name: bytes = library().pa_fused_level()
    return name.decode("ascii")


def layout_of(network: Network) -> Layout:
    """Where a network's tensors lie."""
    layout = Layout()
    library().pa_fused_layout(byref(network), byref(layout))
    return layout


def _declare(loaded: ctypes.CDLL) -> None:
    network = POINTER(Network)
    signatures = {
        "level": (c_char_p, []),
        "layout": (None, [network, POINTER(Layout)]),
        "create": (
            c_void_p,
            [network, network, *[POINTER(Tensors)] * 2, POINTER(Settings), POINTER(Sizes)],
        ),
        "destroy": (None, [c_void_p]),
        "update": (None, [c_void_p, POINTER(Batch), c_int64, c_int64, POINTER(Metrics)]),
        "actor_create": (c_void_p, [network, c_void_p, c_int32, c_int32]),
        "actor_destroy": (None, [c_void_p]),
        "act": (
            None,
            [c_void_p, c_void_p, c_void_p, c_int32, *[c_void_p] * 3, c_int32, c_void_p],
        ),
        "elementwise": (None, [c_int32, *[c_void_p] * 3, c_int64, c_int64]),
        "product": (None, [*[c_int64] * 3, *[c_void_p] * 3]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(loaded, f"pa_fused_{name}")
        function.restype, function.argtypes = result, arguments
