"""The site: Sphinx with MyST and furo, built without a network.

python -m sphinx -W -b html docs docs/_build
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import site_parts
from pygments.lexers.special import TextLexer
from sphinx.domains.python import PyObject

from sonocal import __version__

project, author, copyright = "sonocal", "the sonocal authors", "the sonocal authors"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"sonocal {__version__}"
html_static_path = ["_static"]
html_css_files = ["sonocal.css"]
html_show_sourcelink = html_copy_source = False
nitpicky = True

# Anchors of headings are those that GitHub makes, so that links work in both places.
myst_heading_anchors = 4
myst_enable_extensions = ["tasklist"]
# Blocks that begin in the middle of a page are highlighted as what they say they are, or not at all.
highlight_language = "text"

autodoc_member_order = "groupwise"
autodoc_typehints = "signature"
autosummary_generate = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90
# One backtick in a docstring is a name: a link where the site has it, code where not.
default_role = "py:obj"
nitpick_ignore_regex = [(r"py:obj", r".*")]


def setup(app: Any) -> None:
    """What Sphinx is to do beside its own."""
    app.add_lexer("csv", TextLexer)
    for field in PyObject.doc_field_types:
        if field.name == "variable":  # what Google's docstrings call them
            field.label = "Attributes"
    app.connect("source-read", site_parts.inside)
    app.connect("missing-reference", site_parts.documented_elsewhere)
    app.connect("autodoc-process-docstring", site_parts.docstring)
    app.connect("autodoc-process-signature", site_parts.signature)
