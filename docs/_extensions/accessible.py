"""What the theme leaves out for people who use a keyboard or a screen reader."""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx


def _complete(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    tree = context.get("furo_navigation_tree")
    if isinstance(tree, str):
        context["furo_navigation_tree"] = tree.replace(
            'role="heading"', 'role="heading" aria-level="2"'
        )
    if isinstance(context.get("body"), str):
        # What scrolls sideways on a telephone is reached by the keyboard.
        for start in ("<pre", '<div class="table-wrapper'):
            tag, _, rest = start.partition(" ")
            more = f" {rest}" if rest else ""
            context["body"] = context["body"].replace(start, f'{tag} tabindex="0"{more}')


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the hook, after the theme's."""
    app.connect("html-page-context", _complete, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
