"""Water and thrusters that a file carries, and where each of its numbers is from."""

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
    """A joint that a plugin may drive."""

    child: str  # link
    axis: Array  # (3,) in the child's frame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelFacts:
    """What the readers of plugins need to know of the model."""

    name: str  # with which errors begin
    masses: Mapping[str, float]  # [kg] of each link, with what is fixed to it
    weight: float  # [N] of the whole in air
    joints: Mapping[str, DrivenJoint]
    # [m^3] and centre (3,) [m] of each link's collision shapes; of those that are known
    volumes: Mapping[str, tuple[float, Array]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, name: str, stated: Mapping[str, float], carriers: Mapping[str, str], **others: Any
    ) -> Self:
        """Facts by the mass of each link alone.

        Args:
            name: of the model.
            stated: [kg] of each link.
            carriers: link that each link which is fixed to one is fixed to.
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
    bodies: dict[str, dict[str, Any]] = field(default_factory=dict)  # as of a sidecar
    thrusters: list[MappedThruster] = field(default_factory=list)
    entries: list[ReadEntry] = field(default_factory=list)

    def tell(self, part: str, quantity: str, value: str, way: Way, origin: str) -> None:
        """Add an entry."""
        entry = ReadEntry(part=part, quantity=quantity, value=value, way=way, origin=origin)
        self.entries.append(entry)

    def tree(self) -> dict[str, Any]:
        """Its water as of a sidecar; empty: it has none."""
        if not self.bodies:
            return {}
        density = {} if self.water_density is None else {"water_density": self.water_density}
        return {**density, "bodies": self.bodies}


def number_in(element: Element, tag: str, name: str) -> float | None:
    """Number of a child element; None: it has none such.

    Raises:
        ConfigurationError: it is no number.
    """
    text = element.findtext(tag)
    return None if text is None else figure(text.strip(), f"{name}: <{tag}>")


def number_or(default: float, element: Element, tag: str, name: str) -> float:
    """Number of a child element; `default` where it has none such.

    Raises:
        ConfigurationError: it is no number.
    """
    number = number_in(element, tag, name)
    return default if number is None else number


def positive_in(element: Element, tag: str, name: str, default: float) -> float:
    """Number above zero of a child element; `default` where it is missing.

    Raises:
        ConfigurationError: it is none, or not above zero.
    """
    return finite_number(number_or(default, element, tag, name), f"{name}: <{tag}>", above=0.0)


def numbers_in(
    element: Element, tag: str, name: str, counts: Iterable[int] = ()
) -> list[float] | None:
    """Numbers of a child element; None: it is missing.

    Args:
        element: parent.
        tag: of the child.
        name: begins the error messages.
        counts: that are allowed; none: any.

    Raises:
        ConfigurationError: an entry is not a number, or their count differs.
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
