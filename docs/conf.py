"""How `make docs` builds the site: MyST pages, equations as MathML, nothing from the network."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_extensions")]

project = "Seatrial"
author = "the Seatrial authors"
copyright = author
try:
    release = version_of("seatrial")
except PackageNotFoundError:
    release = "unreleased"
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "command_line", "inputs", "signatures"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "_extensions"]

myst_enable_extensions = ["dollarmath"]
myst_dmath_double_inline = True
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # a page that is included may begin at its second level

autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("Bools", "Examples", "Floats", "Ints")}
autodoc_default_options = {"exclude-members": "__init__, __new__"}
add_module_names = False
python_maximum_signature_line_length = 88
nitpicky = True
# Types of other packages and aliases of ours have no page here.
nitpick_ignore_regex = [("py:.*", r".*")]

html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = "Seatrial"
html_static_path = ["_static"]
html_css_files = ["seatrial.css"]
html_show_sourcelink = False
html_copy_source = False
html_last_updated_fmt = None
html_sidebars = {name: [] for name in ("index", "install", "tutorial", "limits")}
html_theme_options = {
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button"],
    "header_links_before_dropdown": 7,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "back_to_top_button": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

linkcheck_timeout = 15
linkcheck_workers = 2
