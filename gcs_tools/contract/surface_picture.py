"""Draws a contract surface: from above with the safe side marked, and in 3D as in the paper.

Loads matplotlib: import this module only to draw.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D

from gcs_tools.console.errors import CommandError
from gcs_tools.contract.surface_grid import Axis, Surface

_COLOURS = "viridis"
_UNSAFE = "#c62828"
_LEVELS = 12
# The contract's own point: seen on the light and on the dark of the colours.
_OWN: dict[str, Any] = {
    "marker": "o",
    "markersize": 10,
    "markerfacecolor": "white",
    "markeredgecolor": "black",
    "markeredgewidth": 2.5,
    "linestyle": "none",
    "clip_on": False,
}

# Most lines per direction of a 3D surface; more take time and do not show.
_LINES_3D = 60


def save_picture(surface: Surface, path: Path) -> None:
    """Draw a surface; the suffix of ``path`` chooses the format.

    Raises:
        CommandError: the file cannot be written, or its format is unknown.
    """
    try:
        draw(surface).savefig(path, dpi=150)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error
    except ValueError as error:
        raise CommandError(f"{path}: {error}") from error


def draw(surface: Surface) -> Figure:
    """Return the picture."""
    figure = Figure(figsize=(13.0, 5.6), layout="constrained")
    _draw_from_above(figure.add_subplot(1, 2, 1), surface)
    raised: Any = figure.add_subplot(1, 2, 2, projection="3d")
    _draw_raised(raised, surface)
    figure.suptitle(
        f"{_titled(surface.quantity.label)}: {surface.reading} vehicle, "
        f"{surface.input_set} acceleration set",
        fontsize=13,
    )
    return figure


def _draw_from_above(axes: Any, surface: Surface) -> None:
    x, y, z = surface.x.values, surface.y.values, surface.values
    filled = axes.contourf(x, y, z, levels=_LEVELS, cmap=_COLOURS)
    lines = axes.contour(x, y, z, levels=filled.levels, colors="white", linewidths=0.5, alpha=0.7)
    axes.clabel(lines, fontsize=7, fmt="%g")
    axes.figure.colorbar(filled, ax=axes, label=_label_z(surface))
    axes.set(xlabel=_label(surface.x), ylabel=_label(surface.y), title="seen from above")
    unsafe = (~surface.safe).astype(float)
    if unsafe.any():
        axes.contourf(x, y, unsafe, levels=[0.5, 1.5], colors=["white"], alpha=0.6)
        hatched = axes.contourf(x, y, unsafe, levels=[0.5, 1.5], colors="none", hatches=["///"])
        hatched.set_edgecolor(_UNSAFE)
        hatched.set_linewidth(0.0)
    if unsafe.any() and not unsafe.all():
        axes.contour(x, y, surface.margin, levels=[0.0], colors=_UNSAFE, linewidths=2.2)
    if surface.own is not None and surface.own_safe is not None:
        axes.plot(*surface.own, **_OWN)
        axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    axes.legend(handles=_legend(surface), loc="upper left", fontsize=8, framealpha=0.9)


def _legend(surface: Surface) -> list[Any]:
    limit = "limit of what complies"
    if surface.declared is not None:
        limit = f"limit: {surface.declared:g} {surface.quantity.unit} declared"
    return [
        Patch(facecolor=colormaps[_COLOURS](0.35), label="safe: complies"),
        Line2D([], [], color=_UNSAFE, linewidth=2.2, label=limit),
        Patch(facecolor="white", edgecolor=_UNSAFE, hatch="///", label="does not comply"),
        *([] if surface.own is None else [Line2D([], [], label=_own_label(surface), **_OWN)]),
    ]


def _own_label(surface: Surface) -> str:
    words = {True: "safe", False: "not safe", None: "outside"}
    return f"values of this contract: {words[surface.own_safe]}"


def _draw_raised(axes: Axes3D, surface: Surface) -> None:
    x, y = np.meshgrid(surface.x.values, surface.y.values)
    axes.plot_surface(
        x,
        y,
        surface.values,
        cmap=_COLOURS,
        rcount=_LINES_3D,
        ccount=_LINES_3D,
        linewidth=0.0,
        alpha=0.95,
    )
    axes.set_xlabel(_label(surface.x), fontsize=8)
    axes.set_ylabel(_label(surface.y), fontsize=8)
    axes.set_zlabel(_label_z(surface), fontsize=8)
    axes.view_init(elev=24.0, azim=-128.0)
    if surface.quantity.clause:
        axes.set_title("safe: what is declared lies above the surface")


def _label(axis: Axis) -> str:
    names = [key.path.partition(".")[2] for key in axis.keys]
    words = " = ".join(_titled(name.rpartition("_")[0] or name) for name in names)
    return f"{words} [{axis.unit}]" if axis.unit else words


def _label_z(surface: Surface) -> str:
    unit = surface.quantity.unit
    label = _titled(surface.quantity.label)
    return f"{label} [{unit}]" if unit else label


def _titled(name: str) -> str:
    text = name.replace("_", " ")
    return text[:1].upper() + text[1:]
