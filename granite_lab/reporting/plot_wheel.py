"""Pictures of a single wheel: forces and sinkage over slip, and the stresses over its contact arc."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from granite_lab.reporting import canvas

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granite_lab.model.single_wheel import WheelPoint


def sweep_figure(points: Sequence[WheelPoint], title: str) -> Figure:
    """Draw drawbar pull, torque and sinkage over slip, three panels above each other."""
    figure, axes = canvas.stacked([1.5, 1.5, 1.5], [3, 0, 0], gap=0.14)
    slip = [p.slip for p in points]
    with canvas.styled():
        axes[0].axhline(0, color=canvas.INK, linewidth=0.6)
        axes[0].plot(slip, [p.drawbar_pull for p in points], color=canvas.SIMULATED,
                     label=f"drawbar pull F + R, {title}")  # fmt: skip
        axes[0].plot(slip, [p.thrust for p in points], color=canvas.SIMULATED_LIGHT, linestyle="--",
                     label="thrust F (14)")  # fmt: skip
        axes[0].plot(slip, [p.resistance for p in points], color=canvas.GREY, linestyle=":",
                     label="resistance R (13)")  # fmt: skip
        axes[0].set_ylabel("pull [N]")
        axes[1].axhline(0, color=canvas.INK, linewidth=0.6)
        axes[1].plot(slip, [p.torque for p in points], color=canvas.SIMULATED)
        axes[1].set_ylabel("torque [N m]")
        axes[2].plot(slip, [1000 * p.sinkage for p in points], color=canvas.SIMULATED)
        axes[2].set_ylabel("sinkage [mm]")
        axes[2].set_ylim(0, 1.1 * max(1000 * p.sinkage for p in points))
        axes[2].set_xlabel("slip ratio λ (1)")
        canvas.legend_above(axes[0], columns=1)
    canvas.align_labels(axes)
    return figure


def arc_figure(point: WheelPoint, title: str) -> Figure:
    """Draw normal and shear stress over the contact arc, the rear at the left."""
    figure, (axis,) = canvas.stacked([2.3], [2])
    angle = np.degrees(point.angle)
    with canvas.styled():
        axis.axhline(0, color=canvas.INK, linewidth=0.6)
        axis.axvline(0, color=canvas.INK, linewidth=0.6)
        axis.plot(angle, point.normal_stress / 1000, color=canvas.SIMULATED,
                  label=f"normal stress σ, {title}")  # fmt: skip
        axis.plot(angle, point.shear_stress / 1000, color=canvas.SIMULATED_LIGHT, linestyle="--",
                  label="shear stress τ")  # fmt: skip
        axis.set_xlabel("angle on the wheel ϑ [°], 0 at the lowest point, front at the right")
        axis.set_ylabel("stress [kPa]")
        canvas.legend_above(axis, columns=1)
    canvas.align_labels([axis])
    return figure
