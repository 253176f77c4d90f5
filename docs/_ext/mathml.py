"""Equations as MathML, which browsers render themselves: pages need no network and no script."""

from __future__ import annotations

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.errors import SphinxError

#: Forms that the converter misreads without a warning: a fraction of digits without braces (12/x for x/2), and an index
#: of a letter with an accent.
_MISREAD = re.compile(r"\\[td]?frac *\d|\\(?:tilde|hat|bar|dot) *\\?[A-Za-z]+_")


def _mathml(equation: str, as_block: bool = False) -> str:
    """An equation as MathML; an error where the converter would misread it."""
    if form := _MISREAD.search(equation):
        raise SphinxError(f"{form[0]!r} in {equation!r} is misread: write \\tfrac{{1}}{{2}}, or {{}} before an index.")
    return str(tex2mathml(equation, as_block=as_block))


def inline(writer, node: nodes.math) -> None:
    """Write an equation within a line."""
    writer.body.append(_mathml(node.astext()))
    raise nodes.SkipNode


def block(writer, node: nodes.math_block) -> None:
    """Write a displayed equation."""
    mathml = _mathml(node.astext(), as_block=True)
    writer.body.append(f'<div class="math-block">{mathml}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    app.add_html_math_renderer("mathml", inline_renderers=(inline, None), block_renderers=(block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
