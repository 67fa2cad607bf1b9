"""Arm and blocks in 3D: the arm drawn by mjviser, blocks with an outline and a label."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import trimesh
import viser
from mjviser import ViserMujocoScene

from pa_ros.bags.film import RecordedScene, looks
from pa_ros.console.moment import Moment
from pa_ros.world.relation import RELATIONS

HIDDEN_GROUP = 5  # mjviser does not draw geoms of this group
CAMERA_M = (0.85, -0.85, 1.3)  # of a page that was just opened
OUTLINE = (255, 170, 0)
LINE_HEIGHT_M = 0.004  # of lines above the table
LABEL_M, LABEL_STEP_M = 0.06, 0.06  # height of labels above blocks, and between two labels
CROWDED_M = 0.35  # blocks so close have their labels at different heights
_KINDS = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")): kind for kind in (
    "BOX", "SPHERE", "CYLINDER", "CAPSULE")}  # fmt: skip


@dataclass
class _Block:
    """Handles of one block."""

    name: str
    solid: Any
    outline: Any
    label: Any
    circle: Any


class ArenaScene:
    """The scene of one arena."""

    def __init__(self, server: viser.ViserServer, reflections: bool = True) -> None:
        self._server, self._reflections = server, reflections
        self._shown: RecordedScene | None = None
        self._arm: ViserMujocoScene | None = None
        self._blocks: list[_Block] = []
        self._of: tuple[str, bytes] | None = None  # arena, and looks of the blocks that are shown
        server.scene.set_up_direction("+z")
        server.initial_camera.position = CAMERA_M
        server.initial_camera.look_at = (0.1, -0.1, 0.0)

    @property
    def names(self) -> list[str]:
        """The blocks' true words, in the order of Ω without the hand."""
        return [block.name for block in self._blocks]

    @property
    def places(self) -> tuple[tuple[str, tuple[float, float, float]], ...]:
        """Each block's name, and where it is (m). May be read on any thread."""
        found = ((one.name, one.solid.position) for one in self._blocks)
        return tuple((name, (float(p[0]), float(p[1]), float(p[2]))) for name, p in found)

    def show(self, moment: Moment) -> None:
        """Draw a moment."""
        of = moment.arena.arena_id, looks(moment.observation)
        if of != self._of:
            self._rebuild(moment, of)
        assert self._shown is not None and self._arm is not None
        self._shown.show(moment.step)
        self._arm.update_from_mjdata(self._shown.task.simulation.data)
        self._place(moment, self._shown)

    def _rebuild(self, moment: Moment, of: tuple[str, bytes]) -> None:
        self._shown = RecordedScene(moment.arena, moment.step)
        model = self._shown.task.simulation.model
        # The arm is large to send and stays the same in an arena; only the blocks are made anew.
        if self._of is None or self._of[0] != of[0]:
            self._server.scene.reset()
            self._server.scene.set_up_direction("+z")
            self._blocks = []
            with self._server.atomic():  # a page must not begin with reflections that are removed
                self._arm = ViserMujocoScene(self._server, _without_blocks(model), num_envs=1)
                if not self._reflections:
                    self._server.scene.configure_environment_map(None)
            self._arm.camera_tracking_enabled = False
        for block in self._blocks:
            for handle in (block.solid, block.outline, block.label, block.circle):
                handle.remove()
        self._blocks = [self._block(model, i, name) for i, name in enumerate(moment.blocks)]
        self._of = of

    def _block(self, model: mujoco.MjModel, index: int, name: str) -> _Block:
        scene, path = self._server.scene, f"/blocks/{index}"
        geom = model.geom(f"block{index}")
        mesh, outline = _mesh(geom, 1.0), _mesh(geom, 1.12)
        color = tuple(int(255 * part) for part in geom.rgba[:3])
        opacity = float(geom.rgba[3])
        edges = _KINDS[int(geom.type[0])] in ("BOX", "CYLINDER")  # which smooth shading blackens
        shadow = bool(geom.contype[0])  # a place is so flat that it would lie in its own
        return _Block(
            name,
            scene.add_mesh_simple(
                f"{path}/solid", mesh.vertices, mesh.faces, color=color, flat_shading=edges,
                cast_shadow=shadow, receive_shadow=shadow, opacity=opacity if opacity < 1 else None,
            ),
            # Only the inside of a slightly larger block is drawn, which shows as an outline.
            scene.add_mesh_simple(
                f"{path}/outline", outline.vertices, outline.faces, color=OUTLINE, side="back",
                opacity=0.0, cast_shadow=False, receive_shadow=False,
            ),
            scene.add_label(f"{path}/label", name, anchor="bottom-center"),
            scene.add_line_segments(
                f"{path}/circle", np.zeros((1, 2, 3), np.float32), (255, 255, 255),
                thickness=2.0, thickness_units="screen", visible=False,
            ),
        )  # fmt: skip

    def _place(self, moment: Moment, shown: RecordedScene) -> None:
        data, found, objects = shown.task.simulation.data, moment.explanation, moment.block_rows
        heights = label_heights([data.geom(f"block{i}").xpos for i in range(len(self._blocks))])
        with self._server.atomic():
            for i, block in enumerate(self._blocks):
                geom = data.geom(f"block{i}")
                quaternion = np.zeros(4)
                mujoco.mju_mat2Quat(quaternion, geom.xmat)
                for handle in (block.solid, block.outline):
                    handle.position, handle.wxyz = geom.xpos, quaternion
                p = float(found.p[objects[i]]) if found is not None and len(found.p) else None
                block.outline.opacity = p or 0.0
                block.label.position = geom.xpos + np.array((0.0, 0.0, heights[i]))
                block.label.text = block.name if p is None else f"{block.name}  p {p:.2f}"
                named = objects[i] in shown.task.verifier.targets and shown.task.verifier.moved
                block.circle.visible = bool(named and moment.step.program)
                if block.circle.visible:
                    block.circle.points = _outline(shown, data.geom(f"block{i}").xpos)
        self._server.flush()


def label_heights(places: list[Any]) -> list[float]:
    """The height of each block's label, so that labels of close blocks don't overlap.

    Blocks near the camera have the lower labels.
    """
    levels: dict[int, int] = {}
    for i in sorted(range(len(places)), key=lambda i: np.linalg.norm(places[i] - CAMERA_M)):
        close = (j for j in levels if np.linalg.norm((places[i] - places[j])[:2]) < CROWDED_M)
        taken = {levels[j] for j in close}
        levels[i] = next(level for level in range(len(places)) if level not in taken)
    return [LABEL_M + LABEL_STEP_M * levels[i] for i in range(len(places))]


def _without_blocks(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of the model whose blocks are not drawn; bodies keep their numbers."""
    model = copy.copy(model)
    for index in range(model.ngeom):
        if model.geom(index).name.startswith("block"):
            model.geom_group[index] = HIDDEN_GROUP
    return model


def _mesh(geom: Any, factor: float) -> Any:
    """A geom's shape in its own frame, larger by a factor."""
    size, kind = geom.size * factor, _KINDS[int(geom.type[0])]
    if kind == "BOX":
        return trimesh.creation.box(extents=2 * size)
    if kind == "CYLINDER":
        return trimesh.creation.cylinder(radius=size[0], height=2 * size[1])
    if kind == "CAPSULE":
        mesh = trimesh.creation.capsule(radius=size[0], height=2 * size[1])
        mesh.apply_translation(-mesh.bounding_box.centroid)
        return mesh
    return trimesh.creation.icosphere(subdivisions=3, radius=size[0])


def _outline(shown: RecordedScene, block: Any) -> Any:
    """Where the program's relation to a block begins to hold, as line segments [S, 2, 3]."""
    program = shown.task.program
    threshold = shown.task.scoring.threshold_of(program)
    moved = shown.task.simulation.positions[shown.task.verifier.moved[0]]
    line = RELATIONS[program.relation].outline(moved, np.array(block), threshold)
    points = np.column_stack([line, np.full(len(line), LINE_HEIGHT_M)])
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
