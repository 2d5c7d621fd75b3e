"""Sphinx settings of the site that ``losbench site`` builds; warnings are errors there."""

import shutil
from importlib.metadata import distribution
from pathlib import Path

from losbench import __version__
from losbench.resources import data_file
from losbench.workbench.reproduction.reference import write_commands, write_reference

HERE = Path(__file__).resolve().parent

project = "losbench"
author = "The losbench developers"
version = release = __version__
html_title = f"losbench {release}"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
exclude_patterns = ["_made"]
default_role = "py:obj"

nb_execution_mode = "off"
nb_merge_streams = True
# The pages hold pictures of the explorers, and nothing that would ask a network for widgets.
nb_ipywidgets_js = {}
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
# Words in the types of attributes that are also the names of several attributes.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_show_sourcelink = False
html_copy_source = False
html_show_copyright = False
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"

# One file, whole: formulas show from file:// and without a network.
mathjax_path = "tex-svg-full.js"
mathjax3_config = {"options": {"enableMenu": False}}

_mathjax = distribution("sphinx-mathjax-offline").locate_file(
    f"sphinx-mathjax-offline/static/mathjax/{mathjax_path}"
)
shutil.copy(str(_mathjax), HERE / "_static" / mathjax_path)
shutil.copy(data_file("pictures/explorer-centroid.png"), HERE / "_static" / "explorer.png")
write_reference(HERE / "api")
write_commands(HERE / "_made" / "commands.md")


def _level_of_captions(app, pagename, templatename, context, doctree):
    """Say of the sidebar's captions which level of heading they are: readers of screens need it."""
    tree = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = tree.replace(
        'role="heading"', 'role="heading" aria-level="2"'
    )


def setup(app):
    """Connect behind furo's own handler."""
    app.connect("html-page-context", _level_of_captions, priority=900)
