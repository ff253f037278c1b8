"""Labels of points in a picture that keep clear of each other, of the lines drawn and of the picture's edge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.text import Annotation, Text

from seatrial.acquisition.core.quantities import Floats

_FAR_PT = (4.0, 12.0, 22.0, 34.0, 48.0)  # from a point to the nearest edge of its label
_SIDES = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=float)
_PAD_PT = 1.5


def label_points(
    axes: Axes, points: Sequence[tuple[float, float]], texts: Sequence[str], clear_of: Floats, **look: object
) -> list[Annotation]:
    """Annotate ``points`` [N] of the axes' data with ``texts`` [N] where there is room, with a faint line to the
    point where that is not beside it.

    ``clear_of`` [M, 2] are points that a label should not hide, NaN between lines. Places are chosen when the
    picture is drawn, since only then the axes have their scale; ``look`` is that of the texts.
    """
    line = {"arrowstyle": "-", "color": "#8A8A8A", "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 1.0}
    labels = [
        axes.annotate(text, point, xytext=(0.0, 0.0), textcoords="offset points", ha="center", va="center",
                      arrowprops=line, **look)  # type: ignore[arg-type]
        for point, text in zip(points, texts, strict=True)
    ]  # fmt: skip
    for each in labels:
        each.set_in_layout(False)
    axes.add_artist(_KeepClear(axes, labels, clear_of))
    return labels


class _KeepClear(Artist):
    """Draws nothing: it is drawn before the labels of its axes and puts them where they are clear."""

    def __init__(self, frame: Axes, labels: Sequence[Annotation], clear_of: Floats) -> None:
        super().__init__()
        self.frame, self.labels, self.clear_of = frame, labels, clear_of
        self.set_zorder(-1.0)
        self.set_in_layout(False)

    def draw(self, renderer: RendererBase) -> None:
        """Move the labels, one after the other."""
        scale = float(renderer.points_to_pixels(1.0))  # type: ignore[arg-type]
        to_pixels = self.frame.transData.transform
        hidden = to_pixels(self.clear_of[np.isfinite(self.clear_of).all(axis=1)])
        taken: list[Floats] = []
        for label in self.labels:
            point = np.asarray(to_pixels(label.xy))
            extent = Text.get_window_extent(label, renderer)
            half = np.array([extent.width, extent.height]) / 2.0 + _PAD_PT * scale
            box, offset, ring = self._place(point, half, scale, taken, hidden)
            taken.append(box)
            label.set_position(tuple(offset / scale))
            if label.arrow_patch is not None:
                label.arrow_patch.set_visible(ring > 0)

    def _place(
        self, point: Floats, half: Floats, scale: float, taken: Sequence[Floats], hidden: Floats
    ) -> tuple[Floats, Floats, int]:
        """The nearest place that is clear, or the best: its box [px], offset [px] and ring about the point."""
        best, least = (np.zeros((2, 2)), np.zeros(2), 0), (np.inf,) * 3
        for ring, far in enumerate(_FAR_PT):
            for offset in _SIDES * (half + far * scale):
                box = np.stack([point + offset - half, point + offset + half])
                cost = self._cost(box, taken, hidden)
                if cost < least:
                    best, least = (box, offset, ring), cost
                if not any(cost):
                    return best
        return best

    def _cost(self, box: Floats, taken: Sequence[Floats], hidden: Floats) -> tuple[float, float, float]:
        """What a place [low, high; x, y] is over: other labels [px2], the edge [px], points of lines."""
        low, high = box
        over = sum(float(np.prod(np.maximum(np.minimum(high, b) - np.maximum(low, a), 0.0))) for a, b in taken)
        (x0, y0), (x1, y1) = np.asarray(self.frame.bbox)
        outside = max(0.0, x0 - low[0], y0 - low[1], high[0] - x1, high[1] - y1)
        return over, outside, float(((hidden > low) & (hidden < high)).all(axis=1).sum())
