"""Water and thrusters in the blocks of UUV Simulator's vehicles, read as its plugins read them.

Coefficients of the plugins are in axes x ahead, y to starboard, z down. Gazebo applies them at the
link's centre of mass, this project at the link's origin. The centre of buoyancy is in the link's
own axes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from uuv.models.files.gazebo.content import (
    FileContent,
    ModelFacts,
    number_in,
    number_or,
    numbers_in,
    positive_in,
)
from uuv.models.files.gazebo.thruster_limits import limited_thruster
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, one_of

DENSITY = 1028.0  # [kg/m^3] if the plugin states none
_FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])  # axes of the plugin in axes of this project
_AXES = ("i", "j", "k")  # of a cylinder: x, y, z
_UNEVEN = 0.05  # largest accepted asymmetry of an added mass, as a share of its largest number
_SPHERE_DRAG = 0.5  # drag coefficient of the plugin's spheres
# Drag coefficients of the plugin's cylinders by length over diameter: upper end of the ratio, of
# ends, of side.
_END_DRAG = ((1.0, 0.91), (2.0, 0.85), (4.0, 0.87), (np.inf, 0.99))
_SIDE_DRAG = ((1.0, 0.63), (2.0, 0.68), (5.0, 0.74), (10.0, 0.82), (np.inf, 0.98))


def read_water(plugin: Element, facts: ModelFacts, content: FileContent) -> None:
    """Read the plugin of an underwater object: water of each of its links.

    Raises:
        ConfigurationError: the model has no such link, or an entry must be a number and is not.
    """
    density = positive_in(plugin, "fluid_density", facts.name, DENSITY)
    content.water_density = density

    for link in plugin.findall("link"):
        name = link.get("name", "")
        subject = f"{facts.name}: water of link {name!r}"
        if name not in facts.masses:
            content.tell(name, "water", "", "left out", "the model has no such link")
            continue

        volume = _volume(link, name, facts, density, content)
        center = numbers_in(link, "center_of_buoyancy", subject, (3,)) or [0.0, 0.0, 0.0]
        body = {"volume": volume, "center_of_buoyancy": center}
        content.tell(name, "centre of buoyancy", f"{center} m", "read", "uuv_simulator")
        model = link.find("hydrodynamic_model")

        if model is not None:
            shape = _Shape(model, _box_of(link, subject), subject)
            body |= _coefficients(shape, name, density, content)

        content.bodies[name] = body


def read_thruster(plugin: Element, facts: ModelFacts, content: FileContent) -> None:
    """Read the plugin of a thruster: its position, its curve and its time constant.

    Raises:
        ConfigurationError: an entry must be a number and is not.
    """
    number = (plugin.findtext("thrusterID") or plugin.findtext("thruster_id") or "").strip()
    name = number or (plugin.get("name") or "")
    joint = facts.joints.get((plugin.findtext("jointName") or "").strip())
    link = (plugin.findtext("linkName") or "").strip()

    if joint is None:
        content.tell(f"thruster {name}", "thruster", "", "left out", "the model has no such joint")
        return

    subject = f"{facts.name}: thruster {name}"
    conversion = plugin.find("conversion")
    dynamics = plugin.find("dynamics")
    curve = _curve(conversion, subject) if conversion is not None else None
    constant = None if dynamics is None else number_in(dynamics, "timeConstant", subject)
    kind = "" if dynamics is None else (dynamics.findtext("type") or "").strip()
    if constant is None and kind not in ("", "ZeroOrder"):
        content.tell(f"thruster {name}", f"dynamics {kind}", "", "left out", "no time constant")

    gain = number_or(1.0, plugin, "gain", subject)
    gain *= number_or(1.0, plugin, "propeller_efficiency", subject)
    limits = {
        "thrust": _between(plugin, "thrustMin", "thrustMax", subject),
        "command": _between(plugin, "clampMin", "clampMax", subject),
    }

    content.thrusters.append(
        limited_thruster(
            f"{name}",
            link or joint.child,
            joint.axis,
            _scaled(curve, gain, number_or(1.0, plugin, "thrust_efficiency", subject)),
            limits,
            constant or 0.0,
            facts.weight,
            content,
        )
    )


def _between(
    plugin: Element, low: str, high: str, subject: str
) -> tuple[float | None, float | None]:
    """Limits of a plugin, which ignores limits whose lower one is above the upper."""
    least = number_in(plugin, low, subject)
    most = number_in(plugin, high, subject)
    crossed = least is not None and most is not None and least >= most
    return (None, None) if crossed else (least, most)


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """A hydrodynamic model, and the box [m] of its link, which supplies missing lengths of the
    shape.
    """

    model: Element
    box: list[float]  # x, y, z; empty: no box is stated
    subject: str  # first words of error messages

    def number(self, tag: str, of_box: Callable[[list[float]], float]) -> float:
        """A length [m] of the shape, or that of the box; 0 if neither is stated."""
        stated = number_in(self.model, tag, self.subject)
        if stated is not None:
            return stated
        return of_box(self.box) if self.box else 0.0


def _box_of(link: Element, subject: str) -> list[float]:
    """Extents [m] of a link's box in the plugin's order: width along x, length along y."""
    box = link.find("box")
    if box is None:
        return []
    extents = [number_in(box, tag, subject) for tag in ("width", "length", "height")]

    return [extent for extent in extents if extent is not None] if None not in extents else []


def _volume(
    link: Element, name: str, facts: ModelFacts, density: float, content: FileContent
) -> float:
    """Volume [m^3] of a link; if it is not stated, that of a neutral link of its mass."""
    subject = f"{facts.name}: water of link {name!r}"
    neutral = (link.findtext("neutrally_buoyant") or "").strip().lower() in ("1", "true")
    stated = number_in(link, "volume", subject)

    if neutral or stated is None:
        volume = facts.masses[name] / density
        reason = "neutrally_buoyant" if neutral else "no <volume>: assumed neutral"
        content.tell(name, "volume", f"{volume:.6g} m^3", "read" if neutral else "guessed", reason)
        return volume

    content.tell(name, "volume", f"{stated:.6g} m^3", "read", "uuv_simulator")

    return stated


def _coefficients(
    shape: _Shape, name: str, density: float, content: FileContent
) -> dict[str, list]:
    """Added mass and damping of a link, in axes of this project."""
    model = shape.model
    subject = shape.subject
    kind = (model.findtext("type") or "").strip()
    added = np.reshape(numbers_in(model, "added_mass", subject, (36,)) or np.zeros(36), (6, 6))
    linear = _matrix(numbers_in(model, "linear_damping", subject, (6, 36)))
    quadratic = _matrix(numbers_in(model, "quadratic_damping", subject, (6, 36)))
    of_kind = _SHAPES.get(kind)

    if of_kind is not None:
        added_shape, drag = of_kind(shape, density)
        added = added + added_shape
        quadratic = quadratic - np.diag(drag)
    elif kind != "fossen":
        content.tell(name, f"hydrodynamic model {kind!r}", "", "left out", "unknown form")

    flip = np.diag(_FLIP)
    added = _positive(flip @ added @ flip, name, content)
    damping = _dissipative(-(flip @ linear @ flip), "linear damping", name, content)
    drag = np.diag(_dissipative(np.diag(-np.diag(quadratic)), "quadratic damping", name, content))
    content.tell(name, "added mass", _diagonal(added), "read", f"{kind}, z down")
    content.tell(name, "linear damping", _diagonal(damping), "read", f"{kind}, z down")
    content.tell(name, "quadratic damping", _diagonal(np.diag(drag)), "read", f"{kind}, z down")

    coefficients: dict[str, list] = {
        "added_mass": added.tolist(),
        "linear_damping": damping.tolist(),
        "quadratic_damping": drag.tolist(),
    }

    forward = numbers_in(model, "linear_damping_forward_speed", subject, (6, 36))

    if forward is not None and np.any(forward):
        terms = _forward_terms(_matrix(forward))
        coefficients["forms"] = [{"cross_terms": {"terms": terms}}]
        content.tell(name, "damping by forward speed", "", "read", f"{len(terms)} cross terms")

    return coefficients


def _positive(added: Array, name: str, content: FileContent) -> Array:
    """Added mass in a form that a body can have: symmetric and positive semidefinite."""
    uneven = float(np.abs(added - added.T).max())
    largest = float(np.abs(added).max())

    if uneven > 0.0:
        way = "read" if uneven <= _UNEVEN * largest else "guessed"
        content.tell(
            name,
            "added mass",
            f"asymmetric by {uneven:.3g}",
            way,
            "the mean with its transpose is taken",
        )
        added = 0.5 * (added + added.T)

    try:
        return np.array(BodyHydrodynamics(volume=0.0, added_mass=added).added_mass)
    except ConfigurationError:
        content.tell(
            name,
            "added mass",
            "",
            "guessed",
            "its diagonal only, since the whole matrix is not positive semidefinite",
        )
        return np.diag(np.abs(np.diag(added)))


def _dissipative(damping: Array, what: str, name: str, content: FileContent) -> Array:
    """Damping that removes energy: as signed in the file, or with the sign that makes its diagonal
    positive.
    """
    if np.linalg.eigvalsh(0.5 * (damping + damping.T)).min() >= 0.0:
        return damping
    content.tell(
        name, what, "", "guessed", "magnitudes only, since the signs of the file would add energy"
    )
    return np.diag(np.abs(np.diag(damping)))


def _forward_terms(forward: Array) -> list[list[float]]:
    """Cross terms of a damping (6, 6) that grows with the speed ahead, in axes of this project."""
    terms = []
    for i, j in np.argwhere(forward != 0.0).tolist():
        # plugin: tau_i = +F_ij u nu_j; here: -c nu_0 nu_j, in axes with y and z reversed
        terms.append([i, j, 0, 0.0, float(-forward[i, j] * _FLIP[i] * _FLIP[j])])

    return terms


def _matrix(numbers: list[float] | None) -> Array:
    """Matrix (6, 6) of 6 numbers on its diagonal, or of 36; zero without numbers."""
    if numbers is None:
        return np.zeros((6, 6))
    return np.diag(numbers) if len(numbers) == 6 else np.reshape(numbers, (6, 6))


def _diagonal(matrix: Array) -> str:
    return ", ".join(f"{entry + 0.0:.4g}" for entry in np.diag(matrix))


def _sphere(shape: _Shape, density: float) -> tuple[Array, Array]:
    """Added mass (6, 6) and quadratic drag (6,) of the plugin's spheres."""
    radius = shape.number("radius", min)
    added = 2.0 / 3.0 * np.pi * density * radius**3
    drag = 0.5 * density * _SPHERE_DRAG * np.pi * radius**2
    line = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])

    return np.diag(added * line), drag * line


def _cylinder(shape: _Shape, density: float) -> tuple[Array, Array]:
    """Added mass (6, 6) and quadratic drag (6,) of the plugin's cylinders."""
    radius = shape.number("radius", min)
    length = shape.number("length", max)
    stated = (shape.model.findtext("axis") or "").strip()
    if stated:
        axis = _AXES.index(one_of(stated, _AXES, f"{shape.subject}: <axis>"))
    else:
        axis = int(np.argmax(shape.box or [1.0, 0.0, 0.0]))
    ratio = length / (2.0 * radius) if radius > 0.0 else 0.0
    end = next(drag for most, drag in _END_DRAG if ratio <= most)
    side = next(drag for most, drag in _SIDE_DRAG if ratio <= most)

    # Added mass across the axis; along it, for which the plugin has no length; and of rotation end
    # over end.
    section = density * np.pi * radius**2
    added = np.array([section * length] * 3 + [section * length**3 / 12.0] * 3)
    added[axis] = section
    added[3 + axis] = 0.0
    drag = np.array([0.5 * side * radius * length * density] * 3 + [0.0] * 3)
    drag[axis] = 0.5 * end * np.pi * radius**2 * density

    return np.diag(added), drag


def _box(shape: _Shape, density: float) -> tuple[Array, Array]:
    """No added mass (6, 6), and the quadratic drag (6,) of the plugin's boxes."""
    x = shape.number("length", lambda box: box[0])
    y = shape.number("width", lambda box: box[1])
    z = shape.number("height", lambda box: box[2])
    coefficient = number_or(1.0, shape.model, "cd", shape.subject)
    drag = 0.5 * coefficient * density * np.array([y * z, x * z, x * y, 0.0, 0.0, 0.0])

    return np.zeros((6, 6)), drag


_SHAPES = {"sphere": _sphere, "cylinder": _cylinder, "box": _box}


def _curve(conversion: Element, subject: str) -> Callable[[Array], Array] | None:
    """Thrust [N] over the command of a conversion; None if its form is unknown."""
    kind = (conversion.findtext("type") or "").strip()
    if kind == "Basic":
        constant = number_or(0.0, conversion, "rotorConstant", subject)
        return lambda x: constant * x * np.abs(x)

    if kind == "Bessa":
        tags = ("rotorConstantL", "rotorConstantR", "deltaL", "deltaR")
        left, right, low, high = (number_or(0.0, conversion, tag, subject) for tag in tags)
        return lambda x: (
            left * np.minimum(x * np.abs(x) - low, 0.0)
            + right * np.maximum(x * np.abs(x) - high, 0.0)
        )

    if kind == "LinearInterp":
        inputs = numbers_in(conversion, "inputValues", subject) or []
        thrust = numbers_in(conversion, "outputValues", subject) or []
        if len(inputs) != len(thrust) or len(inputs) < 2:
            raise ConfigurationError(
                f"{subject}: inputValues and outputValues must have the same number of entries, at "
                "least two"
            )

        order = np.argsort(inputs)

        return lambda x: np.interp(x, np.array(inputs)[order], np.array(thrust)[order])

    return None


def _scaled(
    curve: Callable[[Array], Array] | None, gain: float, efficiency: float
) -> Callable[[Array], Array] | None:
    """A curve with one factor on its command and one on its thrust."""
    return None if curve is None else lambda x: efficiency * curve(gain * x)
