"""Pictures of the arena: a top view without OpenGL, or a rendered view with it."""

from __future__ import annotations

from contextlib import closing, suppress

import numpy as np
from numpy.typing import NDArray

from pa_ros.arena.camera import CLOSE, Camera, Pictures
from pa_ros.arena.errors import RenderError
from pa_ros.arena.model import TABLE_SIDE_M
from pa_ros.arena.references import nearest_pair
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float64
from pa_ros.world.relation import RELATIONS

_INCH_PX = 100


def draw(task: ReachTask, width: int, rendered: bool | None = None) -> NDArray[np.uint8]:
    """A picture of the current scene: in perspective with a ring around each named object, [3/4
    width, width, 3] RGB (RenderError without OpenGL), or from above, [width, width, 3].

    :param rendered: None: in perspective if there is OpenGL.
    """
    if rendered is None:
        with suppress(RenderError):
            return draw(task, width, rendered=True)
    if not rendered:
        return top_view(task, width)
    size, looks = (width, width * 3 // 4), Pictures(shadows=True)
    with closing(Camera(task.simulation.model, CLOSE, *size, looks)) as camera:
        camera.look(task.simulation, task.verifier.named)
        return camera.picture()


def top_view(task: ReachTask, side_px: int = 480) -> NDArray[np.uint8]:
    """The table from above, [side, side, 3] RGB: the hand is a white ring, named objects have a
    black edge. A dotted line shows where the program's relation holds; for NEAR it is a circle."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(side_px / _INCH_PX, side_px / _INCH_PX), dpi=_INCH_PX)
    canvas, half = FigureCanvasAgg(figure), TABLE_SIDE_M / 2
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-half, half), ylim=(-half, half))
    axes.set(xticks=[], yticks=[], facecolor="#e8e0d8")
    simulation, size = task.simulation, 0.09 * side_px
    links = simulation.link_positions
    axes.plot(links[:, 0], links[:, 1], "-o", color="#555560", linewidth=size / 8, zorder=3)
    positions = simulation.positions
    for i, block in enumerate(task.episode.blocks, start=1):
        x, y = positions[i, :2]
        look = block.look
        edge = "black" if i in task.verifier.named else "none"
        side = look.scale * size / 3
        if not task.design.schema.has_body(block.kind):  # a ring under the blocks
            side, edge = 2 * side, "black" if edge != "none" else "white"
            axes.plot(x, y, look.marker, color=look.rgb, ms=side, mec=edge, mew=size / 20,
                      alpha=0.5, zorder=1)  # fmt: skip
            continue
        axes.plot(x, y, look.marker, color=look.rgb, ms=side, mec=edge, mew=size / 20)
    hand_x, hand_y = positions[0, :2].tolist()
    # Rings, so that an object under the hand is seen.
    for color, width in (("#555560", size / 8), ("white", size / 14)):
        axes.plot(hand_x, hand_y, "o", mfc="none", mec=color, mew=width, ms=size / 1.6, zorder=4)
    if task.verifier.moved and task.verifier.targets:
        axes.plot(*outline(task).T, ":", color="black", linewidth=1.0)
    picture, _ = canvas.print_to_buffer()  # type: ignore[no-untyped-call]
    return np.frombuffer(picture, dtype=np.uint8).reshape(side_px, side_px, 4)[..., :3].copy()


def outline(task: ReachTask) -> Float64:
    """The line around the places where the program's relation to the nearest target holds, from
    above: [M, 2] m. The program must name present objects."""
    program, positions = task.program, task.simulation.positions
    moved, target = (positions[i] for i in nearest_pair(task))
    threshold = task.scoring.threshold_of(program)
    return RELATIONS[program.relation].outline(moved, target, threshold)
