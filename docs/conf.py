"""Configuration of the documentation site: `make docs` builds it with Sphinx, without a network.

Pages that a program writes are made before the sources are read: the reference from the public names, the scene file
and the command line from the tables that voxgran itself uses, the methods from their registries, the changelog and the
guide for contributors from the files at the root of the repository. They are not kept by git.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

import gallery
import methods_pages
import site_inventories
import site_links
import site_reference
from numpydoc.xref import DEFAULT_LINKS

import voxgran

project = "voxgran"
author = "the voxgran developers"
copyright = author
version = release = voxgran.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary"]
extensions += ["sphinx.ext.intersphinx", "numpydoc", "sphinx_gallery.gen_gallery"]
exclude_patterns = ["**/README.*"]
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}

# GitHub's anchors of headings, so that one link works there and here
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist"]

# every class and function has a page of its own, written by site_reference
autosummary_generate = False
autodoc_typehints = "none"  # the section Parameters has the types
autodoc_member_order = "bysource"
numpydoc_class_members_toctree = False
numpydoc_show_class_members = False
# types that are classes of voxgran lead to their pages
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
# types of Python, NumPy and xarray lead to the sites of these projects
intersphinx_mapping = site_inventories.write_inventories(DOCS / "inventories")
DEFAULT_LINKS.clear()  # the words of numpydoc, of which many lead to what the inventories do not hold
numpydoc_xref_aliases = (
    {name: f"voxgran.{name}" for name in voxgran.__all__ if name[0].isupper()}
    | site_inventories.WORDS
    | {
        "SizeDistribution": "voxgran.sizes.SizeDistribution",
        "OrientationLaw": "voxgran.orientations.OrientationLaw",
        "Clump": "voxgran.clumps.Clump",
    }
)

# the gallery's configuration holds functions, which Sphinx cannot keep between builds
suppress_warnings = ["config.cache"]

html_theme = "pydata_sphinx_theme"
html_title = f"voxgran {version}"
html_static_path = ["static"]
html_css_files = ["custom.css"]
html_show_sourcelink = False
html_copy_source = False
html_sidebars = {"index": [], "glossary": [], "changelog": []}
html_theme_options = {
    "logo": {"text": "voxgran"},
    "header_links_before_dropdown": 6,
    "navbar_end": ["theme-switcher"],
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}

sphinx_gallery_conf = gallery.SPHINX_GALLERY_CONF


def write_pages(app):
    """Write the pages that are made by a program."""
    del app
    site_reference.write_pages(DOCS / "reference")
    site_links.write_root_pages(DOCS)
    methods_pages.write_pages(DOCS / "methods")


def setup(app):
    """Connect what this site does beside its extensions."""
    app.connect("builder-inited", write_pages, priority=100)
    app.connect("source-read", site_links.on_source)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
