"""Parts of every page: the scene and the panels, which take no input."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from pa_ros.console import markup
from pa_ros.console.moment import Moment
from pa_ros.console.scene import ArenaScene
from pa_ros.console.server import ConsoleServer
from pa_ros.core.errors import PaError

KEPT = 900  # points of a curve: a quarter of an hour
COLORS = ("#06c", "#c60")
CURVES = {  # plots, each with two curves: label, node, and key in its diagnostics
    "reward per step": (("training", "sim_node", "train.reward_per_step"),
                        ("held out", "sim_node", "eval.reward_per_step")),
    "losses": (("critic loss", "learner_node", "critic_loss"),
               ("mean Q", "learner_node", "mean_q")),
    "learner": (("updates/s", "learner_node", "updates_per_s"),
                ("weights version", "learner_node", "version")),
}  # fmt: skip
# Alarms come first: a person must not have to scroll to see them.
ORDER = {"Alarms": 1, "Program": 2, "Arena": 3, "State": 4, "History": 5, "Why": 6, "Seen": 7,
         "Φ and p": 8, "Learning": 9}  # fmt: skip


class Page:
    """The part that all open pages share."""

    def __init__(self, served: ConsoleServer, learning: bool = True) -> None:
        server = served.viser
        self._server = server
        self.scene = ArenaScene(server, served.reflections)
        self._shown: dict[str, str] = {}  # HTML by panel
        self._html = {
            name: _panel(server, name, name in ("State", "History", "Why", "Alarms"))
            for name in ("State", "History", "Why", "Φ and p", *["Alarms"] * learning)
        }
        self._seen: Any = None  # the picture, once there is one
        self._curves = _Curves(server) if learning else None

    def show(self, moment: Moment, remark: str = "") -> None:
        """Draw a moment. If the scene cannot show it, the state says why."""
        state = markup.state(moment, remark)
        try:
            self.scene.show(moment)
        except PaError as error:
            self.set_panel("State", state + markup.quiet(str(error)))
            return
        self.set_panel("State", state)
        self.set_panel("Why", markup.tree(moment, self.scene.names))
        self.set_panel("Φ and p", markup.words_by_objects(moment, self.scene.names))

    def show_state(self, moment: Moment, remark: str) -> None:
        """Say how a moment that is drawn already stands."""
        self.set_panel("State", markup.state(moment, remark))

    def set_panel(self, panel: str, html: str) -> None:
        """Put HTML into a panel; nothing is sent if it is there already."""
        if panel in self._html and self._shown.get(panel) != html:
            self._shown[panel] = self._html[panel].content = html

    def show_picture(self, picture: NDArray[np.uint8]) -> None:
        """Show what a camera sees, beside Φ; RGB."""
        if self._seen is None:
            with self._server.gui.add_folder("Seen", order=ORDER["Seen"]):
                self._seen = self._server.gui.add_image(picture)
        self._seen.image = picture

    def plot(self, at_s: float, value: Callable[[str, str], float | None]) -> None:
        """Add a point to each curve; `value(node, key)` returns what a node reports."""
        if self._curves is not None:
            self._curves.add(at_s, value)


class _Curves:
    """Three plots over time. A value that no node reports leaves a gap."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._points: deque[tuple[float, ...]] = deque(maxlen=KEPT)
        self._folder = server.gui.add_folder(
            "Learning", order=ORDER["Learning"], expand_by_default=False, visible=False
        )
        with self._folder:
            self._plots = [self._plot(server, title, curves) for title, curves in CURVES.items()]

    def add(self, at_s: float, value: Callable[[str, str], float | None]) -> None:
        reported = [value(node, key) for pair in CURVES.values() for _, node, key in pair]
        if all(found is None for found in reported):
            return
        self._folder.visible = True
        self._points.append((at_s, *(np.nan if v is None else v for v in reported)))
        columns = np.array(self._points, dtype=np.float64).T
        for i, plot in enumerate(self._plots):
            plot.data = (columns[0], columns[1 + 2 * i], columns[2 + 2 * i])

    def _plot(self, server: viser.ViserServer, title: str, curves: Any) -> Any:
        empty = np.zeros(0)
        # The two curves of a plot have different units, so each has its own axis.
        series = [
            {"label": label, "stroke": color, "scale": side, "width": 2}
            for (label, *_), color, side in zip(curves, COLORS, ("y", "right"), strict=True)
        ]
        if title == "reward per step":
            series[1]["scale"] = "y"
        right = {"scale": "right", "side": 1, "grid": {"show": False}}
        axes = ({}, {"scale": "y"}, *[right] * (title != "reward per step"))
        return server.gui.add_uplot(
            (empty, empty, empty), ({"label": "s"}, *series), title=title, height=150,
            scales={"x": {"time": False}}, axes=axes,
        )  # fmt: skip


def _panel(server: viser.ViserServer, name: str, expanded: bool) -> Any:
    with server.gui.add_folder(name, order=ORDER[name], expand_by_default=expanded):
        return server.gui.add_html("")
