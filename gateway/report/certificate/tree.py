"""XML as a tree of frozen elements and its text; what no XML may hold is replaced."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape

FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True)
class Node:
    """An element: its name with prefix, its attributes, and either a text or others inside."""

    name: str
    inside: tuple[Node, ...] | str = ()
    attributes: tuple[tuple[str, str], ...] = ()


Inside = str | Node | None | tuple[Node | None, ...]


def node(name: str, inside: Inside = (), **attributes: str) -> Node:
    """An element with a text, another element or several inside; of several what is None is left out."""
    said = tuple(attributes.items())
    if isinstance(inside, str):
        return Node(name, inside, said)
    several = (inside,) if isinstance(inside, Node) or inside is None else inside
    return Node(name, tuple(one for one in several if one is not None), said)


def text_of(root: Node, namespaces: dict[str, str]) -> str:
    """The whole document, indented, with the namespaces on its root."""
    spaces = tuple((f"xmlns:{prefix}", address) for prefix, address in namespaces.items())
    whole = Node(root.name, root.inside, (*spaces, *root.attributes))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + "\n".join(_lines(whole, "")) + "\n"


def _lines(one: Node, indent: str) -> list[str]:
    head = one.name + "".join(f' {name}="{_clean(value)}"' for name, value in one.attributes)
    if isinstance(one.inside, str):
        return [f"{indent}<{head}>{_clean(one.inside)}</{one.name}>"]
    if not one.inside:
        return [f"{indent}<{head}/>"]
    lines = [line for child in one.inside for line in _lines(child, indent + " ")]
    return [f"{indent}<{head}>", *lines, f"{indent}</{one.name}>"]


def _clean(text: str) -> str:
    return escape(FORBIDDEN.sub("\ufffd", text), quote=True)
