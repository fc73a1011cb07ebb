"""Sphinx's settings: `make docs` builds these pages into docs/_build/html, and takes warnings for
errors.
"""

from __future__ import annotations

import os
import shutil
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "extensions"), str(HERE.parent)]
os.environ.setdefault("MPLBACKEND", "agg")

# Examples write files where they are run: in a copy that the build throws away, which begins
# without any.
RUN = HERE / "_build" / "examples"
shutil.rmtree(RUN, ignore_errors=True)
shutil.copytree(HERE / "examples", RUN)
(HERE / "_build" / "films").mkdir(exist_ok=True)

project = "Stancekit"
author = "the authors of Stancekit"
copyright = "the authors of Stancekit, Apache-2.0"
release = installed_version("stancekit")
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "tied",
    "generated",
    "pictures",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "gallery", "extensions", "examples", "sg_execution_times.rst"]
nitpicky = False  # types of other packages have no pages here

myst_enable_extensions = ["dollarmath", "attrs_inline", "colon_fence", "deflist"]
myst_heading_anchors = 4
html_math_renderer = "mathml"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_custom_sections = ["Source", "Proves"]

sphinx_gallery_conf = {
    "examples_dirs": "_build/examples",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"/plot_",
    "image_scrapers": ("scraper.written",),
    "first_notebook_cell": (
        "# Installs Stancekit where it is missing: from a wheel beside this notebook, else from the package index.\n"
        "from glob import glob\n"
        "from importlib.util import find_spec\n\n"
        "if find_spec('stancekit') is None:\n"
        "    source = next(iter(glob('./stancekit-*.whl')), 'stancekit')\n"
        "    %pip install -q '{source}[robots,terrain,rl,data]'"
    ),
    "abort_on_example_error": True,
    "min_reported_time": 1e9,
    "show_memory": False,
    "download_all_examples": False,
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
}

html_theme = "furo"
html_title = f"Stancekit {release}"
html_static_path = ["static", "gallery", "_build/films"]
html_css_files = ["stancekit.css"]
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False
