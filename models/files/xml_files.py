"""Parser of users' XML, which accepts prefixes without a declared name space."""

import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from uuv.sim.interfaces.errors import ConfigurationError


def xml_of(content: bytes | str, name: str) -> Element:
    """The root element of a document.

    Gazebo reads prefixes such as `gz:` without a declaration, so they are declared where XML asks
    for it.

    Args:
        content: of the file; bytes say their encoding themselves.
        name: begins the error messages.

    Raises:
        ConfigurationError: it is no XML.
    """
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        # the latter two of encodings it does not know
        if "unbound prefix" not in str(error) or not isinstance(content, bytes):
            raise ConfigurationError(f"{name}: no XML ({error})") from error

    prefixes = set(re.findall(rb"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*[\s=>/]", content))
    declared = set(re.findall(rb"xmlns:([\w.-]+)", content)) | {b"xmlns", b"xml"}
    spaces = b"".join(
        b' xmlns:%s="urn:%s"' % (prefix, prefix) for prefix in sorted(prefixes - declared)
    )
    root = re.search(rb"<[A-Za-z][\w.-]*", content)
    start = len(content) if root is None else root.end()
    try:
        return ElementTree.fromstring(content[:start] + spaces + content[start:])
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigurationError(f"{name}: no XML ({error})") from error
