"""Draws the picture of every block's FMU: ``python fmus/pictures/make.py``.

A picture shows the block's characteristic, computed from the block's own equations, or its symbol where there is none. It
becomes model.png in the FMU and stands on its documentation page.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, FancyArrowPatch, Rectangle
from numpy.typing import NDArray

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent.parent))

# found through the line above when this file is run as a script
from fmus import registry  # noqa: E402
from fmus.compose import compose  # noqa: E402

INK, ACCENT, SOFT = "#1f2a35", "#0b6e99", "#a9b6c2"
Axes = Any
Array = NDArray[np.float64]


def play(name: str, rows: Array, h: float, **parameters: float) -> Array:
    """Outputs of a block after each row of inputs, SI."""
    block = registry.block(name)
    module = compose(block).module
    p = module.Parameters(**{n: v.start for n, v in block.parameters.items()} | parameters)
    first = module.Input(*rows[0])
    x, c = module.start(first, p), module.coefficients(p, h)
    m = module.begin(x, first, p, [np.zeros(buffer.length) for buffer in block.memory.values()])
    outputs = []
    for row in rows:
        u = module.Input(*row)
        x, m = module.advance(x, m, u, p, c)
        outputs.append(module.output(x, u, m, p))
    return np.array(outputs)


def axes_cross(ax: Axes, across: str, up: str) -> None:
    """Axes through the origin with their names at the ends."""
    ax.axhline(0, color=SOFT, lw=0.8, zorder=0)
    ax.axvline(0, color=SOFT, lw=0.8, zorder=0)
    plain = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    ax.annotate(
        across,
        (1, 0.02),
        xycoords="axes fraction",
        ha="right",
        va="bottom",
        color=INK,
        fontsize=9,
        bbox=plain,
    )
    ax.annotate(
        up, (0.02, 0.98), xycoords="axes fraction", ha="left", va="top", color=INK, fontsize=9, bbox=plain
    )


def dead_zone(ax: Axes) -> None:
    """Dead zone (2.2) and the smooth inverse (4.9)."""
    x = np.linspace(-1.2, 1.2, 481)[:, None]
    ax.plot(x, play("dead_zone", x, 1e-3, limit=2.0), color=ACCENT, lw=2.4)
    ax.plot(x, play("dead_zone", x, 1e-3, form=3.0, limit=2.0), color=INK, lw=1.2, ls="--")
    axes_cross(ax, "command", "demand")


def dcv(ax: Axes) -> None:
    """Spool after a step of the demand, with the stop."""
    t = np.arange(0, 0.45, 1e-3)
    ax.axhline(2.6, color=INK, lw=1.2, ls="--")
    ax.plot(t, 1e3 * play("dcv", np.ones((len(t), 1)), 1e-3)[:, 0], color=ACCENT, lw=2.4)
    ax.set_ylim(-0.2, 3.1)
    axes_cross(ax, "t", "spool and its stop")


def continuity(ax: Axes) -> None:
    """Load pressure after the spool opens."""
    t = np.arange(0, 0.6, 1e-3)
    opened = np.where(t < 0.05, 0.0, 1e-3)[:, None]
    ax.plot(t, opened * 5.28e8 / 1e5, color=INK, lw=1.2, ls="--")
    ax.plot(t, play("continuity", opened, 1e-3)[:, 0] / 1e5, color=ACCENT, lw=2.4)
    ax.set_ylim(-0.4, 6.6)
    axes_cross(ax, "t", "load pressure")


def continuity_physical(ax: Axes) -> None:
    """Both chambers' pressures while the spool opens to A and then to B."""
    t = np.arange(0, 2.0, 1e-3)
    spool = 2e-3 * np.sin(np.pi * t)
    found = play("continuity_physical", np.column_stack([spool, 0 * t]), 1e-3)
    ax.plot(t, found[:, 1] / 1e5, color=ACCENT, lw=2.4, label="A")
    ax.plot(t, found[:, 2] / 1e5, color=INK, lw=1.6, ls="--", label="B")
    ax.legend(frameon=False, fontsize=9, loc="lower left", ncols=2)
    ax.set_ylim(45, 125)
    axes_cross(ax, "t", "chamber pressures")


def mechanical(ax: Axes) -> None:
    """A rack that turns a column with its boom, from above."""
    ax.add_patch(Arc((0, 0), 1.0, 1.0, color=ACCENT, lw=2.4))
    for angle, ink, width in ((0.0, SOFT, 1.5), (0.75, ACCENT, 5.0)):
        ax.plot(
            [0, 1.9 * np.cos(angle)], [0, 1.9 * np.sin(angle)], color=ink, lw=width, solid_capstyle="round"
        )
    ax.add_patch(Arc((0, 0), 2.6, 2.6, theta1=0, theta2=43, color=INK, lw=1.2))
    ax.text(1.42, 0.5, r"$\theta$", color=INK, fontsize=13)
    ax.add_patch(Rectangle((-1.3, -0.78), 2.6, 0.22, color=INK))
    ax.add_patch(FancyArrowPatch((-0.7, -1.1), (0.7, -1.1), arrowstyle="-|>", mutation_scale=14, color=INK))
    ax.text(0, -1.55, r"$A\,p_L$", color=INK, fontsize=11, ha="center")
    ax.set_xlim(-1.9, 2.1)
    ax.set_ylim(-1.7, 1.7)
    ax.set_aspect("equal")


def simplified(ax: Axes) -> None:
    """Angle while the command steps up and back."""
    t = np.arange(0, 4.0, 5e-3)
    u = np.where((t > 0.3) & (t < 2.3), 1.0, 0.0)[:, None]
    ax.plot(t, u, color=INK, lw=1.2, ls="--")
    ax.plot(t, np.degrees(play("simplified", u, 5e-3)[:, 0]), color=ACCENT, lw=2.4)
    ax.set_ylim(-0.4, 5.6)
    axes_cross(ax, "t", "angle")


def linear_drive(ax: Axes) -> None:
    """Angle while the command steps up and back, of a drive on a springy base."""
    t = np.arange(0, 4.0, 5e-3)
    u = np.where((t > 0.3) & (t < 2.3), 1.0, 0.0)[:, None]
    ax.plot(t, u, color=INK, lw=1.2, ls="--")
    swing = {"b0_2": 0.5, "a0_2": 90.0, "a1_2": 1.5, "delay": 0.1}
    ax.plot(t, np.degrees(play("linear_drive", u, 5e-3, **swing)[:, 0]), color=ACCENT, lw=2.4)
    ax.set_ylim(-0.6, 5.6)
    axes_cross(ax, "t", "angle")


def linear_speed(ax: Axes) -> None:
    """Speed while the command steps up and back, of a motor with a springy coupling."""
    t = np.arange(0, 4.0, 5e-3)
    u = np.where((t > 0.3) & (t < 2.3), 1.0, 0.0)[:, None]
    ax.plot(t, u, color=INK, lw=1.2, ls="--")
    swing = {"b0_1": 3.0, "a1_1": 4.0, "a0_1": 4.0, "b0_2": 20.0, "a0_2": 150.0, "a1_2": 2.5, "delay": 0.1}
    ax.plot(t, play("linear_speed", u, 5e-3, **swing)[:, 0], color=ACCENT, lw=2.4)
    ax.set_ylim(-0.3, 1.4)
    axes_cross(ax, "t", "speed")


def sensor(ax: Axes) -> None:
    """Reading against angle: a straight line."""
    x = np.linspace(-0.2, 1.0, 3)
    ax.plot(x, x, color=ACCENT, lw=2.4)
    ax.plot([0.6, 0.6, 0.0], [0.0, 0.6, 0.6], color=INK, lw=1.2, ls="--")
    axes_cross(ax, "angle", "reading")


def stimulus(ax: Axes) -> None:
    """Samples, held."""
    t = np.linspace(0, 2, 21)
    u = np.sin(2.2 * t) * np.exp(-0.3 * t)
    ax.step(t, u, where="post", color=ACCENT, lw=2.0)
    ax.plot(t, u, "o", color=INK, ms=3.5)
    axes_cross(ax, "t", "command")


def observer(ax: Axes) -> None:
    """An estimate that starts wrong and finds the angle."""
    h = 2e-3
    t = np.arange(0, 1.2, h)
    u = np.ones((len(t), 1))
    slew = play("simplified", u, h)[:, 0] + 0.03
    rows = np.column_stack([u[:, 0], np.where(t < 0.12, 0.0, slew)])
    estimate = play("observer", rows, h)[:, 0]
    ax.plot(t, np.degrees(slew), color=INK, lw=1.2, ls="--")
    ax.plot(t, np.degrees(estimate), color=ACCENT, lw=2.4)
    ax.set_ylim(-0.4, 5.0)
    axes_cross(ax, "t", "angle and its estimate")


def observer_extended(ax: Axes) -> None:
    """A torque that comes from nowhere, and its estimate."""
    h = 1e-3
    t = np.arange(0, 1.6, h)
    torque = np.where((t > 0.3) & (t < 1.0), 100.0, 0.0)
    slew = play("mechanical", (torque / 8.4193e-4)[:, None], h)[:, 0]
    found = play("observer_extended", np.column_stack([0 * t, slew, 0 * t, 0 * t - 1.0]), h)[:, 2]
    ax.plot(t, torque, color=INK, lw=1.2, ls="--")
    ax.plot(t, found, color=ACCENT, lw=2.4)
    ax.set_ylim(-12.0, 125.0)
    axes_cross(ax, "t", "torque and its estimate")


def reference(ax: Axes) -> None:
    """A target that jumps, and the reference that goes there."""
    h = 2e-3
    t = np.arange(0, 5.0, h)
    command = np.where(t < 0.4, 0.0, 0.5)
    found = play("reference", np.column_stack([command, 0 * t, t]), h)
    ax.plot(t, 10.0 * command, color=INK, lw=1.2, ls="--")
    ax.plot(t, np.degrees(found[:, 0]), color=ACCENT, lw=2.4)
    ax.set_ylim(-0.5, 6.2)
    axes_cross(ax, "t", "target and reference")


def controller(ax: Axes) -> None:
    """The command while automatic takes over from manual and gives it back: no jump."""
    h = 2e-3
    t = np.arange(0, 6.0, h)
    automatic = np.where((t > 1.5) & (t < 4.0), 1.0, 0.0)
    rows = np.column_stack([0 * t + 0.0105, 0 * t, 0 * t, 0 * t, 0 * t + 0.2, automatic])
    ax.plot(t, np.where(automatic > 0.0, 0.6, 0.2), color=INK, lw=1.2, ls="--")
    ax.plot(t, play("controller", rows, h)[:, 0], color=ACCENT, lw=2.4)
    ax.set_ylim(-0.08, 0.8)
    axes_cross(ax, "t", "law and command")


DRAWINGS: dict[str, Callable[[Axes], None]] = {
    f.__name__: f
    for f in (
        stimulus,
        dead_zone,
        dcv,
        continuity,
        continuity_physical,
        mechanical,
        simplified,
        linear_drive,
        linear_speed,
        sensor,
        observer,
        observer_extended,
        reference,
        controller,
    )
}


def make(folder: Path = FOLDER) -> list[Path]:
    """Write one PNG a block into `folder`; the files' paths."""
    made = []
    for name, draw in DRAWINGS.items():
        figure, ax = plt.subplots(figsize=(3.2, 2.4), dpi=100)
        ax.set_xticks([])
        ax.set_yticks([])
        for side in ax.spines.values():
            side.set_visible(False)
        draw(ax)
        figure.tight_layout(pad=0.6)
        made.append(folder / f"{name}.png")
        # no date and no version in the file, so that the same drawing gives the same bytes
        figure.savefig(made[-1], metadata={"Software": None}, pil_kwargs={"optimize": True})
        plt.close(figure)
    return made


if __name__ == "__main__":
    for path in make():
        print(path.name, path.stat().st_size)
