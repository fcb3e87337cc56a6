"""The promised names, as the page docs/api.md lists them."""

import re
from dataclasses import dataclass

_GROUP = re.compile(r"^## (.+)$", flags=re.MULTILINE)
_ROW = re.compile(r"^\| `(uuv\.[\w.]+)` \| (.+) \|$", flags=re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A group of the page."""

    title: str
    text: str  # example and remarks, before the table
    lines: dict[str, str]  # what each name is, by name

    @property
    def page(self) -> str:
        """Name of its page on the site, without folder and ending."""
        return self.title.lower().replace(" ", "_")


def groups_of(page: str) -> tuple[Group, ...]:
    """Groups of the text of docs/api.md, in its order."""
    _, *parts = _GROUP.split(page)
    return tuple(
        Group(title=title, text=text.split("| name |")[0].strip(), lines=dict(_ROW.findall(text)))
        for title, text in zip(parts[::2], parts[1::2], strict=True)
    )
