"""Motion of a transient: waterfall, spectrum, Poincare points and energies of the rotor's modes."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipelines.figures import style
from pipelines.figures.axes import add_right, add_top, clearance_circle, limits, seconds
from pipelines.figures.contents import CaseView
from pipelines.figures.runs import AXIS_COLOURS, AXIS_LABELS, RunView, bearing_title, label_along

VERTICAL = 1
DECADES = 4.0  # below the largest amplitude
ORBIT_PERIODS = 20  # of the motion behind the Poincare points, and of the points where none are judged
EVIDENCE_WIDTH = 75  # letters in a line below the title
NEGLIGIBLE = 1e-9  # energies below this part of the largest are left out
FREQUENCY_LABEL = r"frequency $\bar{\omega}$ [–]"


@style.in_style
def draw_waterfall(case: CaseView, run: RunView) -> Figure:
    """Amplitude of the vertical motion over frequency and speed (or time), with rotation and rings."""
    amplitude = run.needed("waterfall")[..., VERTICAL]
    along, frequency = run.along("piece"), run.needed("piece_frequency")
    largest = float(amplitude.max())
    smallest = largest * 10.0**-DECADES
    norm = LogNorm(smallest, largest)
    figure = style.new_figure(4.6)
    panels = np.atleast_1d(figure.subplots(1, case.bearings, sharey=True))
    for bearing, axes in enumerate(panels):
        shown = np.maximum(amplitude[:, :, bearing], smallest)
        mesh = axes.pcolormesh(
            frequency, along, shown, norm=norm, cmap=style.PARAMETER_MAP, shading="nearest", rasterized=True
        )
        axes.grid(False)
        axes.plot(run.needed("piece_speed"), along, color="white", linestyle="--", linewidth=0.9)
        if run.excitation_frequency is not None:
            axes.axvline(run.excitation_frequency, color="white", linestyle=":", linewidth=0.9)
        axes.set(xlim=(0.0, _highest(frequency, amplitude, smallest)), ylim=(along[0], along[-1]))
        axes.set_xlabel(FREQUENCY_LABEL)
        axes.set_title(bearing_title(bearing))
        add_top(axes, case.scales.hertz, "frequency [Hz]")
    panels[0].set_ylabel(r"rotating speed $\bar{\Omega}$ [–]" if run.over_speed else r"time $\tau$ [–]")
    twin = (case.scales.rpm, "rotating speed [rpm]") if run.over_speed else (seconds(case.scales), "time [s]")
    add_right(panels[-1], *twin)
    bar = figure.colorbar(mesh, ax=list(panels), location="bottom", aspect=50, pad=0.02)
    bar.set_label(r"amplitude of $\bar{y}_j$ [–]; dashed: rotation, dotted: rings")
    return style.finish(figure, f"{case.name}: waterfall of {run.title}", case.note)


def _highest(frequency: NDArray[np.float64], amplitude: NDArray[np.float64], smallest: float) -> float:
    """A little above the highest frequency with a visible amplitude."""
    seen = np.flatnonzero((amplitude > smallest).any(axis=(0, 2)))
    return float(min(frequency[-1], 1.1 * frequency[seen[-1]]))


@style.in_style
def draw_spectrum(case: CaseView, run: RunView) -> Figure:
    """Amplitudes of the journals over the frequency at the steady end of the transient."""
    frequency, amplitude = run.needed("frequency"), run.needed("spectrum")
    figure = style.new_figure(1.3 + 2.1 * case.bearings)
    panels = np.atleast_1d(figure.subplots(case.bearings, 1, sharex=True))
    largest = float(amplitude.max())
    lines = _frequencies(run)
    for bearing, axes in enumerate(panels):
        for axis in (0, VERTICAL):
            axes.semilogy(
                frequency,
                np.maximum(amplitude[:, bearing, axis], 1e-300),
                color=AXIS_COLOURS[axis],
                linewidth=1.0,
                label=AXIS_LABELS[axis],
            )
        for label, (value, colour) in lines.items():
            axes.axvline(value, color=colour, linestyle=":", linewidth=1.1, label=label, zorder=0)
        axes.set_ylim(0.3 * largest * 10.0 ** (-DECADES - 2.0), 3.0 * largest)
        axes.set(ylabel="amplitude [–]", title=bearing_title(bearing), xlim=(0.0, frequency[-1]))
        case.add_micrometres(axes, "amplitude", bearing)
    panels[-1].set_xlabel(FREQUENCY_LABEL)
    add_top(panels[0], case.scales.hertz, "frequency [Hz]")
    style.legend_below(figure, panels[0].get_legend_handles_labels()[0], 4)
    return style.finish(figure, f"{case.name}: spectrum of {run.title}{_motion_in_title(run)}", case.note)


def _frequencies(run: RunView) -> dict[str, tuple[float, str]]:
    """Rotation and rings at the end of the run, with their colours."""
    lines = {r"rotation $\bar{\Omega}$": (float(run.run["speed"][-1]), style.GREEN)}
    if run.run["ring_displacement"][-1] > 0.0 and run.excitation_frequency is not None:
        lines[r"rings $\bar{\Omega}_{ex}$"] = (run.excitation_frequency, style.PURPLE)
    return lines


def _motion_in_title(run: RunView) -> str:
    return f": {run.motion}" if run.motion else ""


@style.in_style
def draw_poincare(case: CaseView, run: RunView) -> Figure:
    """The last motion of each journal with its points at the start of every ring period and of every turn."""
    sections = [by for by in ("ring", "rotation") if f"{by}_section_time" in run.analysis]
    run.needed(f"{sections[0] if sections else 'ring'}_section_time")
    figure = style.new_figure(1.0 + 3.1 * len(sections), 0.5 + 3.1 * case.bearings)
    panels = figure.subplots(len(sections), case.bearings, squeeze=False)
    colours = {"ring": style.BLUE, "rotation": style.VERMILION}
    names = {"ring": "once per period of the rings", "rotation": "once per turn of the rotor"}
    for by, row in zip(sections, panels, strict=True):
        for bearing, axes in enumerate(row):
            points = _late_points(run, by)[:, bearing]
            _draw_orbit(axes, run, bearing)
            axes.plot(*points.T, "o", color=colours[by], markersize=2.6, markeredgewidth=0.0)
            axes.set_title(f"{bearing_title(bearing)}, {len(points)} points")
            axes.set(xlabel=r"$\bar{x}_j$ [–]", ylabel=r"$\bar{y}_j$ [–]")
    handles = [Line2D([], [], color="#BBBBBB", label=f"last {ORBIT_PERIODS} reference periods")]
    handles += [
        Line2D([], [], marker="o", linestyle="none", markersize=4, color=colours[by], label=names[by])
        for by in sections
    ]
    style.legend_below(figure, handles, 3)
    return style.finish(figure, f"{case.name}: {run.title}\n{_evidence(run)}", case.note)


def _late_points(run: RunView, by: str) -> NDArray[np.float64]:
    """Points (points, bearing, 2) from which the motion was classified, or the last ones."""
    times, points = run.analysis[f"{by}_section_time"], run.analysis[f"{by}_section_journal"]
    if "stretch_begin" in run.analysis:
        return np.asarray(points[times >= run.analysis["stretch_begin"][0]])
    return np.asarray(points[-ORBIT_PERIODS:])


def _draw_orbit(axes: Axes, run: RunView, bearing: int) -> None:
    time, period = run.run["time"], float(run.run.attributes["reference_period"])
    late = time >= time[-1] - ORBIT_PERIODS * period
    motion = run.run["journal"][late, bearing]
    axes.plot(*motion.T, color="#BBBBBB", linewidth=0.6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    if float(np.max(np.hypot(*motion.T))) > 0.7:
        clearance_circle(axes)


def _evidence(run: RunView) -> str:
    """The kind of motion and the evidence for it."""
    if not run.motion:
        reason = f"motion not judged: {run.skipped.get('motion', 'no reason stored')}"
        return "\n".join(wrap(reason, EVIDENCE_WIDTH))
    if run.motion == "equilibrium":
        return run.motion
    returns = ", ".join(f"{value:.2g}" for value in run.analysis["return_distance"][0])
    chaos = float(run.analysis["chaos"][0])
    text = run.motion + (f", 0–1 test {chaos:.2f}" if np.isfinite(chaos) else "")
    return f"{text}\nreturns after 1, 2, 4, 8 periods: {returns}"


@style.in_style
def draw_modal_energy(case: CaseView, run: RunView) -> Figure:
    """Kinetic and strain energy of the modes of the free rotor along the transient."""
    kinetic, strain = run.needed("kinetic_energy"), run.needed("strain_energy")
    frequency = run.needed("mode_frequency")
    along = run.along("window")
    figure = style.new_figure(5.4)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, energy, label in zip(
        panels, (kinetic, strain), ("kinetic energy", "strain energy"), strict=True
    ):
        largest = float(energy.max())
        shown = [mode for mode in range(len(frequency)) if energy[:, mode].max() > NEGLIGIBLE * largest]
        for mode in shown:
            axes.semilogy(along, energy[:, mode], color=style.CYCLE[mode % len(style.CYCLE)])
        axes.set_ylabel(f"{label} [–]")
        axes.set_ylim(*_decades(energy[:, shown]))
        add_right(axes, float(run.analysis.attributes["energy_joules"]), f"{label} [J]")
    panels[0].set_xlim(*limits(along, 0.01))
    panels[0].set_title(r"means over windows, in units of $p_0 R L_b c$ of bearing 1")
    label_along(panels[0], run.over_speed, case.scales, bottom=False)
    label_along(panels[-1], run.over_speed, case.scales, top=False)
    handles = [
        Line2D([], [], color=style.CYCLE[mode % len(style.CYCLE)], label=_mode_label(float(value)))
        for mode, value in enumerate(frequency)
        if max(kinetic[:, mode].max() / kinetic.max(), strain[:, mode].max() / strain.max()) > NEGLIGIBLE
    ]
    style.legend_below(figure, handles, 4)
    return style.finish(figure, f"{case.name}: energies of the free rotor's modes, {run.title}", case.note)


def _mode_label(frequency: float) -> str:
    return "rigid body" if frequency == 0.0 else rf"bending, $\bar{{\omega}}$ = {frequency:.3g}"


def _decades(energy: NDArray[np.float64]) -> tuple[float, float]:
    """Limits of a logarithmic axis."""
    positive = energy[energy > 0.0]
    if positive.size == 0:
        return 1e-12, 1.0
    return 0.5 * max(float(positive.min()), NEGLIGIBLE * float(positive.max())), 2.0 * float(positive.max())
