"""Water and thrusters that a file contains, and the source of each of their numbers."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self
from xml.etree.ElementTree import Element

from uuv.models.files.gazebo.entries import ReadEntry, Way
from uuv.models.files.parts_file import MappedThruster
from uuv.models.files.urdf_places import figure
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import GRAVITY, Array, finite_number, shown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrivenJoint:
    """A joint that a plugin can drive."""

    child: str  # link
    axis: Array  # (3,) in the child's frame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFacts:
    """Data of the model that the readers of plugins need."""

    name: str  # first words of error messages
    masses: Mapping[str, float]  # [kg] of each link, including the links fixed to it
    weight: float  # [N] of the whole model in air
    joints: Mapping[str, DrivenJoint]
    # [m^3] and centre (3,) [m] of each link's collision shapes, where they are known
    volumes: Mapping[str, tuple[float, Array]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, name: str, stated: Mapping[str, float], carriers: Mapping[str, str], **others: Any
    ) -> Self:
        """Facts of a model from the masses of its single links.

        Args:
            name: name of the model.
            stated: [kg] of each link.
            carriers: for each link that is fixed to another, that other link.
            **others: joints and volumes.
        """
        masses = dict(stated)
        for link, mass in stated.items():
            passed = {link}
            while (link := carriers.get(link, "")) in masses and link not in passed:
                passed.add(link)
                masses[link] += mass

        weight = GRAVITY * math.fsum(stated.values())
        return cls(name=name, masses=masses, weight=weight, **others)


@dataclass(slots=True, kw_only=True, eq=False)
class FileContent:
    """Water and thrusters of a file, filled by the readers of its plugins."""

    water_density: float | None = None  # [kg/m^3]
    # bodies and thrusters as in a sidecar
    bodies: dict[str, dict[str, Any]] = field(default_factory=dict)
    thrusters: list[MappedThruster] = field(default_factory=list)
    entries: list[ReadEntry] = field(default_factory=list)

    def tell(self, part: str, quantity: str, value: str, way: Way, origin: str) -> None:
        """Add an entry."""
        entry = ReadEntry(part=part, quantity=quantity, value=value, way=way, origin=origin)
        self.entries.append(entry)

    def tree(self) -> dict[str, Any]:
        """The water as a tree of a sidecar; empty if there is none."""
        if not self.bodies:
            return {}
        density = {} if self.water_density is None else {"water_density": self.water_density}
        return {**density, "bodies": self.bodies}


def number_in(element: Element, tag: str, name: str) -> float | None:
    """Number of a child element; None: there is no such child.

    Raises:
        ConfigurationError: the child is not a number.
    """
    text = element.findtext(tag)
    return None if text is None else figure(text.strip(), f"{name}: <{tag}>")


def number_or(default: float, element: Element, tag: str, name: str) -> float:
    """Number of a child element, or `default` if there is no such child.

    Raises:
        ConfigurationError: the child is not a number.
    """
    number = number_in(element, tag, name)
    return default if number is None else number


def positive_in(element: Element, tag: str, name: str, default: float) -> float:
    """Number above zero of a child element, or `default` if there is no such child.

    Raises:
        ConfigurationError: the child is not a number, or is not above zero.
    """
    return finite_number(number_or(default, element, tag, name), f"{name}: <{tag}>", above=0.0)


def numbers_in(
    element: Element, tag: str, name: str, counts: Iterable[int] = ()
) -> list[float] | None:
    """Numbers of a child element; None: there is no such child.

    Args:
        element: parent element.
        tag: tag of the child.
        name: first words of error messages.
        counts: allowed numbers of entries; empty: any number.

    Raises:
        ConfigurationError: an entry is not a number, or the number of entries is not allowed.
    """
    text = element.findtext(tag)
    if text is None:
        return None
    numbers = [figure(word, f"{name}: <{tag}>") for word in text.replace(",", " ").split()]
    allowed = tuple(counts)

    if allowed and len(numbers) not in allowed:
        expected = " or ".join(map(str, allowed))
        raise ConfigurationError(f"{name}: <{tag}>: expected {expected} numbers, got {shown(text)}")

    return numbers
