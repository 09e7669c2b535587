"""TeX between dollars → MathML, which browsers draw without a script or a font of ours."""

from __future__ import annotations

import re
from html import unescape

from latex2mathml.converter import convert

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<open>[(\[])(?P<tex>.*?)\\[)\]]</(?P=tag)>(?P<after>[.,;:)]*)', re.DOTALL
)


def to_mathml(html: str, page: str) -> str:
    """A page's HTML with its formulas drawn. Raises ValueError with the formula and the page it is on."""

    def drawn(match: re.Match[str]) -> str:
        tex = unescape(match["tex"]).strip()
        block = match["open"] == "["
        try:
            formula = convert(tex, display="block" if block else "inline")
        except Exception as error:
            raise ValueError(f"{page}: the formula {tex!r} cannot be drawn: {error!r}") from error
        if block:
            return f'<div class="formula" tabindex="0">{formula}</div>{match["after"]}'
        # no line begins with the full stop behind a formula
        return f'<span class="formula">{formula}{match["after"]}</span>' if match["after"] else formula

    return _FORMULA.sub(drawn, html)
