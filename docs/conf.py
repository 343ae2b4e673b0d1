"""How Sphinx builds the documentation: `make docs`, warnings denied."""

import sys
from pathlib import Path

from trisquare import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

project = "trisquare"
release = version = __version__
copyright = "trisquare's authors"  # the licences ask for it

extensions = ["heading_levels", "mathml", "myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]

# The table of measured results is included by a page, and is none itself.
exclude_patterns = ["_build", "_extensions", "measured.md"]

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3

# The notebook has no outputs: they are made here, and an error in it ends the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True

# What single backticks in docstrings name, where it is documented.
default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say them, with shapes and units
add_module_names = False

html_theme = "furo"
html_title = f"trisquare {version}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["tables.css"]

GENERATED = HERE / "_generated"


def setup(app):
    """Write the page of all commands."""
    from commands_page import commands_page

    GENERATED.mkdir(exist_ok=True)
    (GENERATED / "commands.md").write_text(commands_page(), encoding="utf-8")
