"""One look for all figures: few colours that the colour-blind tell apart and that print in grey."""

from __future__ import annotations

from typing import Any

FITTED = "#1f5fa8"
HELD_OUT = "#d9730d"
OUTLIER = "#8a8f98"
INK = "#20242b"
FAINT = "#c9ced6"
# On images, which are grey: as bright as can be.
DETECTED, TRACKED, UNUSED = "#35e06f", "#ff4136", "#ffb000"
ERROR_MAP = "YlOrBr"
# On the map, which is bright in every look.
ON_MAP = "#101215"
# Before, in and behind the image plane: dark in the middle, so that no arrow fades into the page.
ACROSS = (FITTED, "#50555d", HELD_OUT)
# The axes x, y, z of a frame.
AXES = ("#c0392b", "#2e8b57", "#1f5fa8")

# In a page a figure follows its light or dark look: variables of style.html.
ON_PAGE = {
    INK: "var(--ink)",
    FAINT: "var(--line)",
    FITTED: "var(--mark)",
    HELD_OUT: "var(--other)",
    OUTLIER: "var(--outlier)",
}

RC: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Helvetica", "Arial"],
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
}
