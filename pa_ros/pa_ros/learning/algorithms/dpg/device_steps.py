"""Updates on a GPU that the host only queues: it waits for none of them.

A batch is packed into page-locked memory and copied in one piece; slots take turns, so that the
host may be that many batches ahead. After a few updates the step is captured as a CUDA graph, and
from then on an update is one copy and one launch. Nothing here but `capture_cuda` needs a GPU:
on the CPU the same code runs without events, which is how it is tested.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable, Mapping
from math import prod

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Host = Mapping[str, NDArray[np.float32] | NDArray[np.int32]]
Outputs = tuple[Tensor, ...]
Replay = Callable[[], Outputs]
Capture = Callable[[Replay], Replay]

WARM_UP_UPDATES = 3  # before capture: lazily made workspaces and autograd's streams settle
SLOTS = 4  # batches that the host may be ahead by
_ALIGNMENT = 32  # floats: what cuBLAS likes its operands to begin at

log = logging.getLogger(__name__)


class Staging:
    """Arrays of fixed shapes at fixed addresses of a device, refilled without waiting.

    Float32 and int32 alone: both are four bytes, packed side by side.
    """

    def __init__(self, like: Host, device: torch.device, slots: int = SLOTS) -> None:
        self._on_gpu = device.type == "cuda"
        spans: dict[str, slice] = {}
        end = 0
        for name, array in like.items():
            spans[name] = slice(end, end + prod(array.shape))
            end = -(-spans[name].stop // _ALIGNMENT) * _ALIGNMENT
        self._there = torch.zeros(end, dtype=torch.float32, device=device)
        self.tensors = {
            name: self._there[spans[name]].view(torch.from_numpy(array).dtype).view(array.shape)
            for name, array in like.items()
        }
        self._slots = [torch.zeros(end, pin_memory=self._on_gpu) for _ in range(slots)]
        self._views = [
            {k: slot.numpy()[spans[k]].view(a.dtype).reshape(a.shape) for k, a in like.items()}
            for slot in self._slots
        ]
        event: Callable[[], torch.cuda.Event] = torch.cuda.Event
        self._copied = [event() if self._on_gpu else None for _ in self._slots]
        self._turn = 0

    def put(self, arrays: Host) -> None:
        """Queue a copy of the arrays into `tensors`; they may be changed at once."""
        slot, copied = self._slots[self._turn], self._copied[self._turn]
        if copied is not None:
            copied.synchronize()  # of SLOTS batches ago; returns at once if it was never recorded
        for name, view in self._views[self._turn].items():
            np.copyto(view, arrays[name], casting="no")
        self._there.copy_(slot, non_blocking=True)
        if copied is not None:
            copied.record()
        self._turn = (self._turn + 1) % len(self._slots)


class DeviceSteps:
    """Runs `step` on staged batches: first eagerly, then by replaying its capture.

    `step` computes from the tensors it is given and from memory that stays where it is, and never
    waits for the device. Its outputs are overwritten by the next call.
    """

    def __init__(
        self,
        step: Callable[[Mapping[str, Tensor]], Outputs],
        device: torch.device,
        capture: Capture | None = None,
    ) -> None:
        self._step, self._device = step, device
        self._capture = capture or capture_cuda
        self._key: Hashable = None
        self._staging: Staging | None = None
        self._replay: Replay | None = None
        self._eager_updates = 0

    def __call__(self, arrays: Host, version: Hashable) -> Outputs:
        """One step on `arrays`; made anew for other shapes, or another `version` of what else
        `step` reads.
        """
        staging = self._fitting(arrays, version)
        staging.put(arrays)
        if self._replay is not None:
            return self._replay()
        if self._eager_updates < WARM_UP_UPDATES:
            self._eager_updates += 1
            return self._aside(lambda: self._step(staging.tensors))
        self._replay = self._captured(lambda: self._step(staging.tensors))
        return self._replay()

    def _fitting(self, arrays: Host, version: Hashable) -> Staging:
        key = (version, *(array.shape for array in arrays.values()))
        if self._staging is None or key != self._key:
            self._key, self._replay, self._eager_updates = key, None, 0
            self._staging = Staging(arrays, self._device)
        return self._staging

    def _aside(self, run: Replay) -> Outputs:
        """Run on another stream than the current one, as autograd must have before a capture."""
        if self._device.type != "cuda":
            return run()
        new_stream: Callable[[torch.device], torch.cuda.Stream] = torch.cuda.Stream
        current, side = torch.cuda.current_stream(self._device), new_stream(self._device)
        side.wait_stream(current)
        with torch.cuda.stream(side):
            outputs = run()
        current.wait_stream(side)
        return outputs

    def _captured(self, run: Replay) -> Replay:
        try:
            return self._capture(run)
        except RuntimeError as error:
            log.warning("learner: no CUDA graph, going on without: %s", error)
            return run


def capture_cuda(run: Replay) -> Replay:
    """Record what `run` queues, without doing it; the answer does it, in one launch."""
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph, capture_error_mode="thread_local"):  # others may go on
        outputs = run()

    def replay() -> Outputs:
        graph.replay()
        return outputs

    return replay
