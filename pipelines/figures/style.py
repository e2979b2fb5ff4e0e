"""A common style for every figure, and files whose bytes depend on the drawing alone.

Nothing here touches matplotlib's global state: figures are drawn and saved inside :func:`styled`, a context
that restores the caller's settings, and are plain ``Figure`` objects that pyplot does not know.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from types import MappingProxyType
from typing import Any, ParamSpec

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.text import Annotation

from pipelines.datasets.durable import make_folder, replace_file

Arguments = ParamSpec("Arguments")

FORMATS = ("png", "svg", "pdf")

# Okabe and Ito: distinguishable with every common kind of colour blindness, and in grey.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE, GREY = "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#7F7F7F"
# Of the same hues as PURPLE and SKY: a line that is dark in print without colour, and an area that stays
# behind.
DEEP_PURPLE, PALE_SKY = "#6A1B5D", "#E4F1FA"
CYCLE = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, BLACK, GREY)
BEARING_COLOURS = (BLUE, VERMILION)
# One bearing is drawn broad and pale, the other thin on top of it: of a symmetric machine both stay visible.
BEARING_WIDTHS, BEARING_ALPHAS = (3.0, 1.1), (0.4, 1.0)
PARAMETER_MAP = "viridis"

UNSTABLE = (0, (3.5, 1.8))  # dashes of what is not stable
DOUBLE_COLUMN = 7.2  # inches: the width of a journal page
NOTE_WIDTH = 120  # letters in a line of the note on the machine
TITLE_WIDTH = 72  # and of a title that is wider than the figure
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufffe\uffff]")

SETTINGS: MappingProxyType[Any, Any] = MappingProxyType(
    {
        "font.family": "DejaVu Sans",  # shipped with matplotlib, so it is the same everywhere
        "font.size": 8.0,
        "mathtext.fontset": "dejavusans",
        "axes.titlesize": 8.5,
        "axes.titlepad": 5.0,
        "axes.labelsize": 8.5,
        "axes.linewidth": 0.7,
        "axes.axisbelow": True,
        "axes.grid": True,
        "grid.color": "#DDDDDD",
        "grid.linewidth": 0.5,
        "lines.linewidth": 1.3,
        "lines.markersize": 4.0,
        "legend.fontsize": 7.5,
        "legend.frameon": False,
        "legend.handlelength": 2.4,
        "xtick.labelsize": 7.5,
        "ytick.labelsize": 7.5,
        "xtick.direction": "in",
        "ytick.direction": "in",
        "xtick.major.width": 0.7,
        "ytick.major.width": 0.7,
        "figure.dpi": 100.0,
        "savefig.dpi": 200.0,
        "figure.constrained_layout.use": True,
        "figure.constrained_layout.h_pad": 0.06,
        "figure.constrained_layout.w_pad": 0.06,
        "svg.hashsalt": "agfb",  # otherwise identifiers are drawn at random
        "svg.fonttype": "path",
        "pdf.fonttype": 42,
        "pdf.compression": 6,
    }
)

# What matplotlib would otherwise write by itself: its version and the time of day.
METADATA: MappingProxyType[str, dict[str, Any]] = MappingProxyType(
    {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }
)


@contextmanager
def styled() -> Iterator[None]:
    """Apply the settings of this project in a block, starting from matplotlib's own defaults.

    `matplotlib.rcdefaults` would load the user's styles too, and stop at one that cannot be read.
    """
    defaults = {key: value for key, value in mpl.rcParamsDefault.items() if "backend" not in key}
    with mpl.rc_context({**defaults, **SETTINGS}), warnings.catch_warnings():
        # such a letter of a user's own text is drawn as a box
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from font")
        yield


def in_style(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Run a drawing function inside :func:`styled`: many settings are read when an artist is made."""

    @wraps(draw)
    def drawn(*arguments: Arguments.args, **options: Arguments.kwargs) -> Figure:
        with styled():
            return draw(*arguments, **options)

    return drawn


def new_figure(height: float, width: float = DOUBLE_COLUMN) -> Figure:
    """An empty figure of ``width`` x ``height`` inches, drawn by Agg and unknown to pyplot."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(figure: Figure, title: str, note: str = "") -> Figure:
    """Give a figure its title and, if there is one, the note about the machine."""
    lines = [literal(line) for line in wrap(note, NOTE_WIDTH)]
    # Blank lines below the title keep the place of the note, which is set in another type.
    heading = figure.suptitle(title + "\n " * len(lines), fontsize=9.5, fontweight="bold")
    if heading.get_window_extent().width > figure.bbox.width:
        parts = [part for line in title.split("\n") for part in wrapped(line, TITLE_WIDTH)]
        heading.set_text("\n".join(parts) + "\n " * len(lines))
    if lines:
        figure.add_artist(
            Annotation(
                "\n".join(lines),
                (0.5, 0.0),
                xycoords=heading,
                ha="center",
                va="bottom",
                fontsize=7,
                color="#444444",
                fontstyle="italic",
                in_layout=False,
            )
        )
    # The layout is settled once: every further drawing would move things by a fraction of a pixel, and the
    # bytes of one format would depend on the formats saved before.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def literal(text: str) -> str:
    """A user's own text, escaped so that it is drawn as written.

    A dollar begins no formula, a leading underscore hides no legend entry, and a character that is
    neither a letter nor allowed in SVG is drawn as an unknown one.
    """
    escaped = _CONTROL.sub("\ufffd", text).replace("$", r"\$")
    return r"$\_$" + escaped[1:] if escaped.startswith("_") else escaped


def wrapped(line: str, width: int) -> list[str]:
    """A title line in pieces that fit, broken between words; a line with a formula is unchanged."""
    return [line] if "$" in line else wrap(line, width) or [line]


def legend_below(figure: FigureBase, handles: Sequence[Artist], columns: int = 5) -> None:
    """One legend for all panels, below them."""
    if handles:
        figure.legend(handles=list(handles), loc="outside lower center", ncols=min(columns, len(handles)))


def bearing_look(bearing: int) -> dict[str, Any]:
    """Line options of one bearing."""
    kind = bearing % len(BEARING_COLOURS)
    return {"color": BEARING_COLOURS[kind], "linewidth": BEARING_WIDTHS[kind], "alpha": BEARING_ALPHAS[kind]}


def placeholder(title: str, message: str, note: str = "") -> Figure:
    """A figure that says why there is nothing to draw yet."""
    with styled():
        figure = new_figure(1.8)
        axes = figure.subplots()
        axes.axis("off")
        axes.text(
            0.5, 0.5, message, ha="center", va="center", fontsize=11, color=GREY, transform=axes.transAxes
        )
        return finish(figure, title, note)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG, SVG or PDF (by the suffix); equal figures give equal bytes.

    The file appears at once and whole. Raises ValueError for any other suffix, and OSError, naming the file:
    some of matplotlib's formats would say something else about a full disk.
    """
    kind = path.suffix.removeprefix(".")
    if kind not in FORMATS:
        raise ValueError(
            f"cannot draw {path.name}: the format must be one of {', '.join(FORMATS)}, not {kind!r}"
        )
    drawn = figure_bytes(figure, kind)
    make_folder(path.parent, durable=False)
    replace_file(path, drawn, durable=False)
    return path


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """A figure as PNG, SVG or PDF; equal figures give equal bytes."""
    drawn = BytesIO()
    with styled():
        figure.savefig(drawn, format=kind, metadata=METADATA[kind])
    return drawn.getvalue()
