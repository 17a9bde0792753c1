"""How Sphinx builds the site: `make docs`. Nothing is fetched while building or reading; it opens
from the file system.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "making"))

project = "ibrid"
author = "the ibrid developers"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "house_docstrings",
    "mathml",
    "pictures",
    "notebook_pages",
]
html_math_renderer = "mathml"
exclude_patterns = ["making"]

html_theme = "furo"
html_title = "ibrid"
html_static_path = ["look"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {"sidebar_hide_name": False}

# the dashes of options and the quotes of programs mean themselves
smartquotes = False
# blocks without a language are terminal output and programs of diagrams
highlight_language = "none"
myst_heading_anchors = 3
# formulas as GitHub shows them: $..$ in lines, ```math between them
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
