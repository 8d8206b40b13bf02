"""What the site does beside Sphinx: links out of docs/, docstrings, names that are shown elsewhere than defined."""

from __future__ import annotations

import re
from typing import Any

from sphinx.ext.napoleon import Config, GoogleDocstring
from sphinx.util.nodes import make_refnode

# What pages link to beside docs/, and the page of the site that includes it.
BESIDE = {
    "../README.md#try-it": "install.md",
    "../README.md": "index.md",
    "../CONTRIBUTING.md": "contributing.md",
    "../CHANGELOG.md": "changelog.md",
    "../examples/README.md": "examples.md",
}
# Types that other libraries define: their sites are not at hand without a network.
THEIRS = re.compile(
    r"(numpy|np|collections|concurrent|pathlib|typing|dataclasses|datetime|msgspec|matplotlib|mpl_toolkits|distributed|socket|threading)\."
    r"|(NDArray|ArrayLike|Array|Path|Any|Axes|Axes3D|PolarAxes|DataFrame|optional)$|[a-z_\d]+$"
)
# Types of ours that are of no use but to be handed on.
HANDED_ON = {
    "Bytes",
    "Cell",
    "Centre",
    "Compounding",
    "Content",
    "CrosswireFit",
    "Detector",
    "Fan",
    "Fit",
    "Fixed",
    "Images",
    "Interpolation",
    "Keywords",
    "LagFit",
    "MappedRows",
    "MappedTargets",
    "Model",
    "Noise",
    "OnInvalid",
    "Peer",
    "PlaneSamples",
    "PointLineRows",
    "PointsKeywords",
    "Progress",
    "Said",
    "Shown",
    "SpannedRows",
    "Speckle",
    "Table",
    "TargetRows",
    "Weighting",
    "Workforce",
}
# Arrays as the source writes them, not as they are spelt out.
ARRAYS = [
    (
        re.compile(r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?numpy\.float64\]\]"),
        "Array",
    ),
    (
        re.compile(r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?([\w.]+)\]\]"),
        r"NDArray[\1]",
    ),
    # What NumPy calls ArrayLike: from "_Buffer" or "_SupportsArray" to "_NestedSequence[complex | bytes | str]".
    (
        re.compile(
            r"(~?[\w.]+\._Buffer \| )?~?[\w.]+\._SupportsArray\[.*?_NestedSequence\[complex \| bytes \| str\]"
        ),
        "ArrayLike",
    ),
    (re.compile(r", _\w+: .*? = <[^>]*>(?=[,)])"), ""),
    (re.compile(r"<factory>|<class '\w+'>"), "..."),
]
GOOGLE = Config(
    napoleon_google_docstring=True,
    napoleon_use_ivar=True,
    napoleon_use_rtype=False,
    napoleon_attr_annotations=False,
)


def inside(_app: Any, name: str, source: list[str]) -> None:
    """Links that lead out of docs/ lead to a page of the site."""
    up = "../" * name.count("/")
    for beside, page in BESIDE.items():
        source[0] = source[0].replace(f"]({up}{beside}", f"]({up}{page}")


def docstring(app: Any, what: str, name: str, one: Any, options: Any, lines: list[str]) -> None:  # noqa: PLR0917
    """Google's sections; a bar is that of a length, |n| = 1, and no substitution; names of one line stay together."""
    plain = [line if "``" in line else line.replace("|", r"\|") for line in lines]
    joined = [
        re.sub(r"^( +\w+(?:, \w+)+):", lambda m: m[0] if "Error" in m[0] else m[0].replace(", ", "/"), line)
        for line in plain
    ]
    kind = (
        "method" if what in ("property", "attribute", "data") else what
    )  # else a colon in its first line would end a type
    lines[:] = str(GoogleDocstring(joined, GOOGLE, app, kind, name, one, options)).splitlines()


def signature(
    _app: Any, _what: str, _name: str, _one: Any, _options: Any, arguments: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Arguments and what comes back, with short names of arrays and without what is private."""
    return as_written(arguments), as_written(returned)


def as_written(text: str | None) -> str | None:
    for pattern, short in ARRAYS:
        text = pattern.sub(short, text) if text else text
    return text


def documented_elsewhere(_app: Any, env: Any, node: Any, text: Any) -> Any:
    """A name is found by its last part, as rooms show what their files define; types of others stay words."""
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    last = target.rpartition(".")[2]
    objects = env.get_domain("py").objects
    places = sorted((name.count("."), name) for name in objects if name.rpartition(".")[2] == last)
    if places and places[0][0] <= 2:
        found = objects[places[0][1]]
        return make_refnode(env.app.builder, node["refdoc"], found.docname, found.node_id, text, target)
    return text if THEIRS.match(target) or last in HANDED_ON else None
