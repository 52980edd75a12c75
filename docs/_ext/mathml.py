"""Equations as MathML, which browsers draw by themselves: no MathJax from a network."""

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx


def _inline(writer: object, node: nodes.math) -> None:
    writer.body.append(_tree(node.astext(), block=False))  # type: ignore[attr-defined]
    raise nodes.SkipNode


def _block(writer: object, node: nodes.math_block) -> None:
    writer.body.append(_tree(node.astext(), block=True))  # type: ignore[attr-defined]
    raise nodes.SkipNode


def _tree(text: str, *, block: bool) -> str:
    return latex2mathml.tex2mathml(text, as_block=block)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
