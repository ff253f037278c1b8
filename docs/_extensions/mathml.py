"""Equations as MathML, written at build time by docutils: to show them a page needs no script and no network."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

_LOG = logging.getLogger(__name__)


_DOT = r'\s*<mo stretchy="false">˙</mo>\s*'
_DOTTED_LETTER = '<mi class="dotted">\\1\N{COMBINING DOT ABOVE}</mi>'
_INDEXED = re.compile(rf"<munderover>\s*<mi>(\w)</mi>(.*?){_DOT}</munderover>", re.DOTALL)
_DOTTED = re.compile(rf'<mover accent="true">\s*<mi>(\w)</mi>{_DOT}</mover>')
_MATRIX = re.compile(r"<mo>\[</mo>\s*<mtable>(.*?)</mtable>\s*<mo>\]</mo>", re.DOTALL)


def _mathml(node: nodes.Element, *, as_block: bool) -> str:
    """The equation; dots and brackets of matrices set so that no font made for mathematics is needed."""
    try:
        text = tex2mathml(node.astext(), as_block=as_block)
        text = _DOTTED.sub(rf"{_DOTTED_LETTER}", text)
        text = _INDEXED.sub(rf"<msub>{_DOTTED_LETTER}\2</msub>", text)
        return _MATRIX.sub(r'<mtable class="matrix">\1</mtable>', text)
    except MathError as error:
        _LOG.warning("equation cannot be set: %s", error, location=node)
        return ""


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def _block(writer: HTML5Translator, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="equation">{_mathml(node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
