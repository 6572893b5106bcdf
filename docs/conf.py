"""The site: ``make docs`` builds it from these pages, the examples and the docstrings.

The pages are plain Markdown for GitHub; what Sphinx needs beyond that is put in here as the pages are read.
"""

from __future__ import annotations

import html
import os
import re
import shutil
from dataclasses import fields, is_dataclass
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import ziamath
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

from polish_sim import Scenario

ROOT = Path(__file__).resolve().parent.parent
# They are run there: they write files. Trainings, which take long, and clients of a robot are left out.
EXAMPLES = ROOT / "build" / "examples"
shutil.rmtree(EXAMPLES, ignore_errors=True)
shutil.copytree(
    ROOT / "examples", EXAMPLES, ignore=shutil.ignore_patterns("train_*.py", "ur_rtde_*.py", "results")
)
project = "polish-sim"
copyright = "polish-sim contributors, MIT licence"
version = release = version_of("polish-sim")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["tutorials/README.md"]
default_role = "literal"
nitpicky = False
highlight_language = "text"
autodoc_type_aliases = {name: name for name in ("Array", "Ints", "Indices", "Bools")}
ziamath.config.precision = 2
COLON = "\ue000"  #: Stands for a colon while napoleon reads

# Markdown: headings are link targets, ```math is an equation, as on GitHub.
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

html_theme = "furo"
html_title = "polish-sim"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "drawn"  # as curves in the page: no script, no font, no network
html_copy_source = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "monokai"

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False

sphinx_gallery_conf = {
    "examples_dirs": str(EXAMPLES),
    "gallery_dirs": "tutorials",
    "filename_pattern": r"/\d\d_",
    "plot_gallery": os.environ.get("DOCS_QUICK", "") == "",  # a quick build runs no example
    "abort_on_example_error": True,
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "default_thumb_file": str(ROOT / "results" / "gallery" / "plan_freeform.png"),
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    "reset_modules": (),
    "write_computation_times": False,
    "capture_repr": (),
}

MIRRORS = {
    "changelog": "CHANGELOG.md",
    "run_folder": "results/README.md",
    "model_sources": "models/README.md",
}
"""Pages that are another file of the repository; what lies in docs/ under their name is one line for
GitHub."""
LINKS = {
    r"(?:\.\./)?docs/": "",
    r"(?:\.\./)?results/README\.md": "run_folder.md",
    r"(?:\.\./)?models/README\.md": "model_sources.md",
    r"(?:\.\./)?CHANGELOG\.md": "changelog.md",
    r"(?:\.\./)?README\.md": "index.md",
    r"(?:\.\./)?examples/README\.md": "tutorials/index.rst",
    r"(?:\.\./)?examples/(?P<name>\d\d_\w+)\.py": r"tutorials/\g<name>.rst",
    r"(?:\.\./)?examples/train_\w+\.py": "tutorials/13_environment.rst",
    r"(?:\.\./)?(?:results/)?gallery/": "../results/gallery/",
}
"""Links as GitHub follows them, and as the site does."""


def read_page(app: Sphinx, name: str, source: list[str]) -> None:
    """Put a mirrored file in its page's place, point links into the site, and make the glossary's table a
    glossary."""
    if Path(app.env.doc2path(name)).suffix != ".md":
        return
    if name in MIRRORS:
        source[0] = (ROOT / MIRRORS[name]).read_text(encoding="utf-8")
    for pattern, replacement in LINKS.items():
        source[0] = re.sub(r"(\]\()" + pattern, r"\g<1>" + replacement, source[0])
    if name == "settings":
        source[0] += settings_text()
    if name == "glossary":
        rows = re.findall(r"^\| (?!term \|)([^|]+) \| ([^|]+) \|$", source[0], flags=re.MULTILINE)
        head = source[0].partition("\n|")[0]
        entries = "\n".join("\n".join(term.split(", ")) + f"\n  {meaning}\n" for term, meaning in rows)
        source[0] = f"{head}\n```{{glossary}}\n{entries}```\n"


def settings_text(section: Any = None, name: str = "") -> str:
    """Tables of all keys of the scenario: default, meaning with its unit, option of the command line."""
    section = section or Scenario()
    rows, deeper = [], ""
    for field in fields(section):
        value, about = getattr(section, field.name), field.metadata
        place = f"{name}.{field.name}" if name else field.name
        if is_dataclass(value):
            deeper += f"\n## {place}\n\n{(type(value).__doc__ or '').splitlines()[0]}\n" + settings_text(
                value, place
            )
        elif "text" in about:
            option = f"`{about['option'].name}`" if about.get("option") else ""
            listed = [
                f"{v:.6g}" if isinstance(v, float) else str(v)
                for v in (value if isinstance(value, tuple) else [value])
            ]
            shown = f"`{', '.join(listed)}`" if any(listed) else ""
            rows.append(
                f"| `{field.name}` | {option} | {shown} | {about['text'].replace('|', chr(92) + '|')} |"
            )
    head = "\n| key | option | default | meaning |\n|---|---|---|---|\n"
    return (head + "\n".join(rows) + "\n" if rows else "") + deeper


def keep_colons(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Hide the colons of a field's sentence from napoleon, which would take what stands before them for a
    type."""
    if what == "attribute":
        lines[:] = [line.replace(":", COLON) for line in lines]


def show_colons(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Put them back."""
    lines[:] = [line.replace(COLON, "\\:") for line in lines]


def write_math(translator: Any, node: Any, display: str) -> None:
    """Draw an equation into the page, in the colour of its text, with its source as the alternative text."""
    text = node.astext().strip()
    try:
        equation = ziamath.Latex(text, size=18.0, color="currentColor", inline=display == "inline")
        drawn = equation.svg().replace("<svg ", f'<svg role="img" aria-label="{html.escape(text)}" ', 1)
    except Exception as error:
        raise ExtensionError(f"an equation cannot be drawn: {text}") from error
    translator.body.append(f'<div class="math">{drawn}</div>' if display == "block" else drawn)


def setup(app: Sphinx) -> None:
    """Register what turns the pages for GitHub into those of the site."""
    from docutils.nodes import SkipNode

    def visit(display: str) -> Any:
        def write(translator: Any, node: Any) -> None:
            write_math(translator, node, display)
            raise SkipNode

        return write

    app.connect("source-read", read_page)
    app.connect("autodoc-process-docstring", keep_colons, priority=100)  # napoleon has 500
    app.connect("autodoc-process-docstring", show_colons, priority=900)
    app.add_html_math_renderer("drawn", (visit("inline"), None), (visit("block"), None))
