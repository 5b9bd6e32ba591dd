"""HTML made of values: text is escaped because it is text, not because someone remembered to."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable
from urllib.parse import quote

VOID = frozenset({"br", "hr", "img", "meta", "link", "line", "rect", "path", "circle"})


class Html(str):
    """Text that is markup already. Only this file and literals of ours make one; whatever else comes is escaped."""

    __slots__ = ()


NOTHING = Html("")
# control characters, and those that turn the direction of the text after them
_UNSEEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def text(value: object) -> Html:
    """`value` as text that cannot become markup; control characters and half surrogates (file names hold anything) become a replacement mark."""
    if isinstance(value, Html):
        return value
    plain = str(value).encode("utf-8", "replace").decode("utf-8")
    return Html(html.escape(_UNSEEN.sub("\ufffd", plain), quote=True))


def joined(parts: Iterable[object], between: str = "") -> Html:
    """All parts, each escaped where it is not markup."""
    return Html(between.join(text(part) for part in parts))


def tag(name: str, /, *content: object, **attributes: object) -> Html:
    """An element. A trailing underscore in an attribute's name is dropped (`class_`), others become hyphens; None leaves it out."""
    written = "".join(f' {key.rstrip("_").replace("_", "-")}="{text(value)}"' for key, value in attributes.items() if value is not None)
    if name in VOID:
        return Html(f"<{name}{written}>" if name in {"br", "hr", "img", "meta", "link"} else f"<{name}{written}/>")
    return Html(f"<{name}{written}>{joined(content)}</{name}>")


def link(path: str, *content: object) -> Html:
    """A link to a file beside the page (a relative path, quoted: a name with `javascript:` in it stays a name)."""
    return tag("a", *content, href="./" + quote(path))


def table(head: Iterable[object], rows: Iterable[Iterable[object]], *, class_: str | None = None, row_classes: Iterable[str] = ()) -> Html:
    """A table whose cells know the head of their column (`data-label`: on a phone each row becomes a card)."""
    heads = [text(h) for h in head]
    classes = list(row_classes)
    body, is_right = [], [False] * len(heads)
    for i, row in enumerate(rows):
        cells = [
            cell if isinstance(cell, Html) and cell.startswith("<td") else tag("td", cell, data_label=h) for h, cell in zip(heads, row, strict=True)
        ]
        is_right = [cell.startswith('<td class="n"') for cell in cells]
        body.append(tag("tr", *cells, class_=classes[i] if i < len(classes) and classes[i] else None))
    return tag(
        "table",
        tag("thead", tag("tr", *(tag("th", h, scope="col", class_="n" if right else None) for h, right in zip(heads, is_right, strict=True)))),
        tag("tbody", *body),
        class_=class_,
    )


def figure_cell(value: object, label: str) -> Html:
    """A cell for a number: set right."""
    return tag("td", value, class_="n", data_label=label)
