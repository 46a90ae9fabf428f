"""Figures of a run in the manner of the paper's figures 3, 4 and 5. Matplotlib is imported on first use.

Everything is told apart without colour, too: kept links are single lines, critical ones double
rails, removed ones dotted with a cross; robots bear their ids.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from contract.arena import Arena
from contract.messages import Target
from groundstation.connectivity import tree_floor
from groundstation.scenes import Film, Scene, clock, label

INK, INK2, FAINT, GRID = "#13202C", "#455563", "#8D9CA9", "#E3E8ED"
KEPT, CRITICAL, REMOVED, ACTIVE = "#2F6FB3", "#B45309", "#6B7884", "#0B5CAD"
ROBOTS = ("#0072B2", "#D55E00", "#117A65", "#AA3377", "#946C00", "#33739E", "#6A3FA0", "#555555")
STYLES = ("-", "--", "-.", (0, (5, 1.2, 1, 1.2, 1, 1.2)))
FORMATS = ("png", "pdf")


def draw(film: Film, folder: Path) -> list[Path]:
    """All figures as PNG and PDF into ``folder``; the files written."""
    folder.mkdir(parents=True, exist_ok=True)
    scenes = film.six()
    named = {
        "trajectories": trajectories(film),
        "topology": topology(film, scenes),
        "lambda2": lambda2_over_steps(film, scenes),
    }
    written = []
    for name, figure in named.items():
        for kind in FORMATS:
            path = folder / f"{name}.{kind}"
            metadata = {"CreationDate": None} if kind == "pdf" else {}
            figure.savefig(path, dpi=200, metadata=metadata)
            written.append(path)
    return written


def _figure(width_in: float, height_in: float) -> Any:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    matplotlib.rcParams.update(
        {
            "font.size": 8,
            "axes.edgecolor": FAINT,
            "axes.linewidth": 0.7,
            "axes.labelcolor": INK,
            "text.color": INK,
            "xtick.color": INK2,
            "ytick.color": INK2,
            "pdf.fonttype": 42,
            "svg.hashsalt": "ahdc",
        }
    )
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


class Sheet(NamedTuple):
    """How the arena lies on the paper: its long side across, as on the arena page (then y to the right, x down)."""

    turned: bool
    across_m: float
    down_m: float

    def at(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Arena metres to axes of the paper."""
        return (y, x) if self.turned else (x, y)


def sheet(arena: Arena) -> Sheet:
    width, height = arena.arena.size_m
    return Sheet(True, height, width) if height > width else Sheet(False, width, height)


def _floor(axes: Any, paper: Sheet, ticks: bool = True) -> None:
    axes.set_aspect("equal")
    axes.set_xlim(0, paper.across_m)
    axes.set_ylim(*((paper.down_m, 0) if paper.turned else (0, paper.down_m)))
    axes.set_xticks(np.arange(0, paper.across_m + 0.01, 1 if paper.across_m <= 8 else 2))
    axes.set_yticks(np.arange(0, paper.down_m + 0.01, 1 if paper.down_m <= 8 else 2))
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    if ticks:
        axes.set_xlabel("y, m" if paper.turned else "x, m")
        axes.set_ylabel("x, m" if paper.turned else "y, m")
    else:
        axes.tick_params(labelbottom=False, labelleft=False, length=0)


def _colour(i: int) -> str:
    return ROBOTS[i % len(ROBOTS)]


def _halo() -> list[Any]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=1.6, foreground="white")]


def _targets(axes: Any, paper: Sheet, targets: Sequence[Target], done: frozenset[int], size: float) -> None:
    for target in targets:
        x, y = paper.at(target.x_m, target.y_m)
        if target.index in done:
            axes.plot(x, y, "o", ms=size * 0.75, mfc="#D5DBE1", mec=FAINT, mew=0.6, zorder=2)
        else:
            axes.plot(x, y, "o", ms=size, mfc="white", mec=INK, mew=1.0, zorder=2)
        colour = FAINT if target.index in done else INK
        axes.annotate(
            str(target.index + 1), (x, y), (size * 0.55, size * 0.45), textcoords="offset points", fontsize=size + 0.5,
            color=colour, zorder=5, path_effects=_halo(),
        )  # fmt: skip


def trajectories(film: Film) -> Any:
    """Fig. 3: where every robot went, over the targets."""
    history = film.history
    arena = history.arena
    paper = sheet(arena)
    figure = _figure(5.6, 5.2 * paper.down_m / paper.across_m + 0.7)
    axes = figure.add_subplot()
    _floor(axes, paper)
    if history.cloud is not None:
        _targets(axes, paper, history.cloud.targets, frozenset(), 5.5)
    for i, name in enumerate(history.robots):
        x, y = paper.at(film.poses[:, i, 0], film.poses[:, i, 1])
        if not len(x) or np.isnan(x).all():
            continue
        style = STYLES[(i // len(ROBOTS)) % len(STYLES)] if len(history.robots) > len(ROBOTS) else STYLES[i % 2]
        axes.plot(x, y, color=_colour(i), linewidth=1.3, linestyle=style, zorder=3, label=label(name))
        axes.plot(x[0], y[0], "s", ms=5, mfc="white", mec=_colour(i), mew=1.2, zorder=4)
        _robot(axes, x[-1], y[-1], label(name), _colour(i), 10)
    axes.plot([], [], "o", ms=5.5, mfc="white", mec=INK, mew=1.0, label="target")
    axes.plot([], [], "s", ms=5, mfc="white", mec=INK2, mew=1.2, label="start")
    columns = min(8, len(history.robots) + 2)
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, fontsize=7.5, handlelength=1.8)
    return figure


def _robot(axes: Any, x: float, y: float, text: str, colour: str, size: float) -> None:
    axes.plot(x, y, "o", ms=size, mfc=colour, mec="white", mew=0.8, zorder=6)
    axes.text(
        x, y, text, ha="center", va="center_baseline", color="white", fontsize=size * 0.62, fontweight="bold", zorder=7
    )


def _links(axes: Any, paper: Sheet, scene: Scene) -> None:
    def ends(edge: tuple[int, int]) -> tuple[Any, Any]:
        pair = scene.poses[list(edge), :2]
        return paper.at(pair[:, 0], pair[:, 1])

    for edge in scene.kept:
        axes.plot(*ends(edge), color=KEPT, linewidth=1.4, zorder=4, solid_capstyle="butt")
    for edge in scene.critical:
        axes.plot(*ends(edge), color=CRITICAL, linewidth=3.4, zorder=4, solid_capstyle="butt")
        axes.plot(*ends(edge), color="white", linewidth=1.4, zorder=4.1, solid_capstyle="butt")
    for edge in scene.removed:
        x, y = ends(edge)
        axes.plot(x, y, color=REMOVED, linewidth=0.9, linestyle=(0, (1, 2)), zorder=3.5)
        axes.plot(x.mean(), y.mean(), "x", color=REMOVED, ms=4.5, mew=1.2, zorder=3.6)


def topology(film: Film, scenes: Sequence[Scene]) -> Any:
    """Fig. 4: six snapshots of robots, links and targets."""
    arena = film.history.arena
    paper = sheet(arena)
    panel_in = 2.4
    figure = _figure(3 * panel_in, 2 * (0.967 * panel_in * paper.down_m / paper.across_m + 0.22) + 0.35)
    grid = figure.subplots(2, 3, squeeze=False)
    crowd = len(film.history.robots) > 20
    for k, axes in enumerate(grid.flat):
        if k >= len(scenes):
            axes.set_axis_off()
            continue
        scene = scenes[k]
        _floor(axes, paper, ticks=False)
        if film.history.cloud is not None:
            _targets(axes, paper, film.history.cloud.targets, scene.done, 4.5 if not crowd else 2.5)
        for i, name in enumerate(film.history.robots):
            axes.plot(*paper.at(*scene.trail[:, i].T), color="#9CC3E8", linewidth=1.0, zorder=1.5)
            x, y, heading = scene.poses[i]
            if np.isnan(x):
                continue
            nose = 0.04 * paper.across_m
            ends = paper.at(np.array([x, x + nose * np.cos(heading)]), np.array([y, y + nose * np.sin(heading)]))
            axes.plot(*ends, color=ACTIVE, linewidth=2.2, zorder=5.5)
            _robot(axes, *paper.at(x, y), label(name), ACTIVE, 9.5 if not crowd else 5)
        _links(axes, paper, scene)
        axes.set_title(f"({'abcdef'[k]})  {clock(scene.seconds, 1)}  {scene.caption}", fontsize=7, loc="left", pad=3)
    _topology_legend(figure)
    return figure


def _topology_legend(figure: Any) -> None:
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    rail = (Line2D([], [], color=CRITICAL, lw=3.4), Line2D([], [], color="white", lw=1.4))
    gone = (
        Line2D([], [], color=REMOVED, lw=0.9, ls=(0, (1, 2))),
        Line2D([], [], color=REMOVED, ls="", marker="x", ms=4.5, mew=1.2),
    )
    entries: dict[str, Any] = {
        "kept link": Line2D([], [], color=KEPT, lw=1.4),
        "critical link, kept": rail,
        "removed link": gone,
        "target": Line2D([], [], ls="", marker="o", ms=4.5, mfc="white", mec=INK),
        "target done": Line2D([], [], ls="", marker="o", ms=3.6, mfc="#D5DBE1", mec=FAINT),
        f"path, last {Film.TRAIL_S:.0f} s": Line2D([], [], color="#9CC3E8", lw=1.0),
    }
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=6, frameon=False, fontsize=7.5,
        handler_map={tuple: HandlerTuple(ndivide=1)}, handlelength=2.6, columnspacing=1.4,
    )  # fmt: skip


def lambda2_over_steps(film: Film, scenes: Sequence[Scene]) -> Any:
    """Fig. 5: lambda_2 of the disk graph over run-steps, log scale, with the floor of any connected graph."""
    history = film.history
    values = film.lambda2()
    n = len(history.robots)
    floor = tree_floor(n) or 0.1
    figure = _figure(7.2, 2.5)
    axes = figure.add_subplot()
    busiest = max((t.step_ns for t in history.tracks.values()), key=len)
    stamps = np.sort(np.array(busiest, dtype=np.int64))
    start = int(np.searchsorted(stamps, film.mission.start_ns))

    def step(at_ns: Any) -> Any:
        """Control steps taken since the start; the frame number where none were recorded."""
        return np.searchsorted(stamps if len(stamps) else film.exposure_ns, at_ns) - (start if len(stamps) else 0)

    steps = step(film.exposure_ns)
    low = floor * 0.55
    axes.step(steps, np.maximum(values, low * 1.12), where="post", color=ACTIVE, linewidth=1.4, zorder=3)
    axes.axhspan(low, floor, facecolor="white", edgecolor="#C9D1D8", hatch="////", linewidth=0, zorder=1)
    axes.axhline(floor, color=INK, linewidth=0.9, zorder=2)
    split = values <= 0
    if split.any():
        axes.plot(steps[split], np.full(split.sum(), low * 1.12), "|", color="#B4182D", ms=9, zorder=4, label="split")
    axes.set_yscale("log")
    top = max(float(n), float(values.max(initial=0)) * 1.3)
    axes.set_ylim(low, top)
    ticks = [floor, *(t for t in (0.5, 1, 2, 5, 10, 20, 50) if floor * 1.25 < t < top)]
    axes.set_yticks(ticks, [f"{floor:.3f}", *(f"{t:g}" for t in ticks[1:])])
    axes.minorticks_off()
    axes.set_ylabel(r"$\lambda_2$")
    axes.set_xlabel("run-step")
    axes.set_xlim(0, max(1, int(steps[-1]) if len(steps) else 1))
    for k, scene in enumerate(scenes):
        at = step(film.mission.start_ns + round(scene.seconds * 1e9))
        axes.axvline(at, color=FAINT, linewidth=0.7, linestyle=(0, (2, 2)), zorder=1.5)
        axes.annotate("abcdef"[k], (at, 1), (2, -9), xycoords=("data", "axes fraction"), textcoords="offset points",
                      fontsize=8, fontweight="bold")  # fmt: skip
    done = [o.stamp_ns for o in history.occupations.values() if o.stamp_ns <= film.mission.end_ns + 2_000_000]
    axes.plot(
        step(np.array(sorted(done), dtype=np.int64)), np.full(len(done), low * 1.3), "o", ms=3.2, color=INK, zorder=4
    )
    axes.spines[["top", "right"]].set_visible(False)
    return figure
