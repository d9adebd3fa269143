"""The site that `make docs` builds: pages in Markdown, options and API from the code."""

import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

project = "vlnpe"
author = "The authors of vlnpe"
project_copyright = "2026, the authors of vlnpe; Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "vlnpe"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
highlight_language = "text"
default_role = "code"  # of `this` in docstrings
myst_heading_anchors = 4
smartquotes = False  # `--option` stays as it is
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}

NUMPY = r"~?(?:numpy\.)?"
ARRAY = re.compile(rf"{NUMPY}ndarray\[tuple\[[^\]]*\], {NUMPY}dtype\[{NUMPY}(\w+)\]\]")


def _with_options(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the placeholder of the command reference by the options that the code defines."""
    if page == "reference/cli":
        from command_reference import command_reference

        source[0] = source[0].replace("<!-- commands -->", command_reference())


def _with_examples(
    app: Sphinx, what: str, name: str, module: object, options: object, lines: list[str]
) -> None:
    """Mark the indented blocks of a module's docstring as code."""
    if what != "module":
        return
    for number in range(len(lines) - 1, 0, -1):
        if lines[number].startswith("    ") and not lines[number - 1]:
            before = next((line for line in reversed(lines[:number]) if line), "")
            if not before.startswith("    "):
                lines[number:number] = ["::", ""]


def _with_whole_sentences(
    app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Keep napoleon from taking a property's sentence up to its first colon for a type."""
    if what in ("property", "attribute"):
        lines.insert(0, "\\ ")  # which shows nothing


def _with_short_types(app: Sphinx, doctree: nodes.document) -> None:
    """Write `ndarray[float32]` for the array of a property, which has no signature."""
    for annotation in doctree.findall(addnodes.desc_annotation):
        parts = annotation.findall(nodes.Text)
        # Each name stands there twice, with its module and without.
        text = "".join(p for p in parts if p.parent.get("condition") != "*")
        if ARRAY.search(text):
            annotation.children = [nodes.Text(ARRAY.sub(r"ndarray[\1]", text))]


def _with_short_arrays(
    app: Sphinx,
    what: str,
    name: str,
    value: object,
    options: object,
    signature: str | None,
    returns: str | None,
) -> tuple[str | None, str | None]:
    """Write `ndarray[float32]` for an array; docstrings give the shapes."""
    short = [text and ARRAY.sub(r"ndarray[\1]", text) for text in (signature, returns)]
    return short[0], short[1]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the hooks with Sphinx."""
    app.connect("source-read", _with_options)
    app.connect("autodoc-process-docstring", _with_examples)
    app.connect("autodoc-process-docstring", _with_whole_sentences, priority=400)
    app.connect("autodoc-process-signature", _with_short_arrays)
    app.connect("doctree-read", _with_short_types)
    return {"parallel_read_safe": True}
