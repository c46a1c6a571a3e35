"""A page read back: its elements, checked for balance, with their text."""

from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"meta", "link", "input", "br"}


@dataclass
class Element:
    """A tag, its attributes, what is in it."""

    tag: str
    given: dict[str, str]
    inside: "list[Element | str]" = field(default_factory=list)

    @property
    def text(self) -> str:
        """All text in it."""
        return "".join(own if isinstance(own, str) else own.text for own in self.inside).strip()

    def all(self, tag: str = "", look: str = "", **given: str) -> "list[Element]":
        """Elements within of this tag, class and attributes, in order."""
        found = []
        for own in self.inside:
            if isinstance(own, Element):
                fits = own.tag == (tag or own.tag) and look in ("", *own.given.get("class", "").split())
                found += [own] if fits and all(own.given.get(key) == value for key, value in given.items()) else []
                found += own.all(tag, look, **given)
        return found

    def one(self, tag: str = "", look: str = "", **given: str) -> "Element":
        """The first of them."""
        return self.all(tag, look, **given)[0]


class Reader(HTMLParser):
    """Builds elements; every tag must be closed by its own end."""

    def __init__(self) -> None:
        super().__init__()
        self.open = [Element("", {})]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len({name for name, _ in attrs}) == len(attrs), f"an attribute of <{tag}> is given twice"
        own = Element(tag, {name: value or "" for name, value in attrs})
        self.open[-1].inside.append(own)
        if tag not in VOID:
            self.open.append(own)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open[-1].tag == tag, f"</{tag}> closes <{self.open[-1].tag}>"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.open[-1].inside.append(data)


def parsed(page: str) -> Element:
    """The page as elements."""
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert len(reader.open) == 1, f"<{reader.open[-1].tag}> is never closed"
    return reader.open[0]
