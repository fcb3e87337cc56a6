"""Registry of things that are made by name, from this project and from other packages (entry
points).

    VEHICLES = Registry("vehicle", {"uuv_puma": uuv_puma.build})
    spec = VEHICLES.load("uuv_puma")

A package adds entries in its pyproject.toml. The last part of the group is the registry's kind, and
each entry refers to a function that makes the thing:

    [project.entry-points."uuv_arm.object"]
    wellhead = "my_package.objects:wellhead"

Without a package, a name MODULE:ATTRIBUTE, such as my_objects:wellhead, is imported from the module
path.

Built-in makers can be stated as MODULE:ATTRIBUTE too. Their names are then known, and unknown names
refused, without a costly import.
"""

import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from uuv.sim.interfaces.errors import ConfigurationError, UuvError, did_you_mean
from uuv.sim.interfaces.spatial import shown

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
GROUP = "uuv_arm"  # group of entry points, followed by a dot and the kind


@dataclass(frozen=True, slots=True)
class MadeForm:
    """Requirement on what a maker returns."""

    words: str
    fits: Callable[[Any], bool]


class Registry(Generic[T]):
    """Functions ("makers") by name that make one kind of thing: "vehicle", "arm", "object", "tool",
    "soil", ...
    """

    def __init__(
        self,
        kind: str,
        built_in: Mapping[str, Callable[..., T] | str],
        aliases: Mapping[str, str] | None = None,
        form: "MadeForm | None" = None,
        copied: Callable[[T], T] | None = None,
    ) -> None:
        """Set the kind, the built-in makers by name, and aliases of some of them.

        Args:
            kind: word that messages use, and the last part of the entry points' group.
            built_in: makers by name, or MODULE:ATTRIBUTE of a maker, which is imported when it is
                needed; they take precedence over makers of other packages with the same name.
            aliases: built-in names by alias.
            form: requirement on what a user's maker returns; None: no requirement.
            copied: makes a copy, so that a built-in thing is made once and `load` returns copies;
                None: it is made anew each time.
        """
        self.kind = kind
        self._form = form
        self._copied = copied
        self._made: dict[Any, T] = {}  # built-in things to copy, by name and options
        self._built_in = dict(built_in)
        self._aliases = dict(aliases or {})
        self._found: dict[str, EntryPoint] | None = None

    def names(self) -> tuple[str, ...]:
        """All names that `load` knows, sorted."""
        return tuple(sorted({*self._built_in, *self._aliases, *self._of_packages()}))

    def __contains__(self, name: object) -> bool:
        """True if `load` knows `name`."""
        return isinstance(name, str) and (
            name in self._built_in
            or name in self._aliases
            or ":" in name
            or name in self._of_packages()
        )

    def resolve(self, name: str) -> str:
        """The name that an alias refers to; any other name unchanged.

        Raises ConfigurationError for an unknown name.
        """
        if name not in self:
            meant = did_you_mean(name, self.names())
            raise ConfigurationError(
                f"unknown {self.kind} {shown(name)}; there are {', '.join(self.names())}, or "
                f"MODULE:ATTRIBUTE{meant}"
            )
        return self._aliases.get(name, name)

    def load(self, name: str, *arguments: Any, **options: Any) -> T:
        """Make the thing of that name.

        Args:
            name: one of `names()`.
            arguments: positional arguments of its maker.
            options: keyword arguments of its maker.

        Returns:
            What the maker returns.

        Raises:
            ConfigurationError: the name or an option is unknown (the message lists the known ones),
                or the maker of another package raises an error while it is imported or called.
        """
        name = self.resolve(name)
        is_built_in = name in self._built_in
        make = self.maker(name)

        # Options that the maker does not have are refused before it is called.
        if options:
            allowed = inspect.signature(make).parameters
            anything = any(
                parameter.kind is parameter.VAR_KEYWORD for parameter in allowed.values()
            )
            if not anything and not set(options) <= set(allowed):
                unknown = sorted(set(options) - set(allowed))
                raise ConfigurationError(
                    f"{self.kind} {name!r} has no {unknown}; it has {list(allowed)}"
                )

        # An error in another package is reported as a fault of the name, not of this program.
        if is_built_in and self._copied is not None:
            key = (name, arguments, *sorted(options.items()))
            if key not in self._made:
                self._made[key] = make(*arguments, **options)
            return self._copied(self._made[key])
        if is_built_in:
            return make(*arguments, **options)
        try:
            instance = make(*arguments, **options)
        except UuvError:
            raise
        except Exception as error:
            raise ConfigurationError(
                f"{self.kind} {name!r}: {type(error).__name__}: {error}"
            ) from error

        # The function of a user may return anything, so the result is checked.
        if self._form is not None and not self._form.fits(instance):
            got = type(instance).__name__
            raise ConfigurationError(
                f"{self.kind} {name!r}: must return {self._form.words}, got {got}"
            )
        return instance

    def maker(self, name: str) -> Callable[..., T]:
        """The function that makes the thing of that name.

        Raises:
            ConfigurationError: The name is unknown, or another package's maker cannot be imported.
        """
        name = self.resolve(name)
        if name in self._built_in:
            make = self._built_in[name]
            return cast(Callable[..., T], _attribute(make)) if isinstance(make, str) else make
        return self._of_user(name) if ":" in name else self._imported(self._of_packages()[name])

    def class_of(self, name: str, base: type, where: str) -> type[T]:
        """The dataclass of that name, which must be a subclass of `base`.

        Args:
            name: as for `load`.
            base: base class of this kind, or an object whose `needs` describes the required class.
            where: first words of the message about an unsuitable class.

        Raises:
            ConfigurationError: it is not a dataclass or not a subclass of `base`, or as for
                `maker`.
        """
        chosen: Any = self.maker(name)
        if isinstance(chosen, type) and issubclass(chosen, base) and is_dataclass(chosen):
            return cast(type[T], chosen)

        needs = getattr(base, "needs", f"inherits {base.__name__}")
        which = f"{self.kind} {shown(name)}"
        raise ConfigurationError(f"{where}: {which} must be a dataclass that {needs}")

    def name_of(self, make: Callable[..., T]) -> str | None:
        """The name of `make` among the built-in makers or those of other packages; None if it has
        no name.
        """
        path = f"{make.__module__}:{make.__qualname__}"
        for name, known in self._built_in.items():
            if known is make or known == path:
                return name

        return next((name for name in self._of_packages() if self.maker(name) is make), None)

    def _of_packages(self) -> "dict[str, EntryPoint]":
        if self._found is None:
            # this reads the metadata of all packages
            from importlib.metadata import entry_points

            points = entry_points(group=f"{GROUP}.{self.kind}")
            self._found = {
                point.name: point for point in points if point.name not in self._built_in
            }
        return self._found

    def _of_user(self, name: str) -> Callable[..., T]:
        """The function MODULE:ATTRIBUTE of a user."""
        try:
            make = _attribute(name)
        except (Exception, SystemExit) as error:
            raise ConfigurationError(
                f"{self.kind} {shown(name)}: cannot be imported; {type(error).__name__}: {error}"
            ) from error

        if not callable(make):
            raise ConfigurationError(f"{self.kind} {shown(name)}: must be callable")
        return cast(Callable[..., T], make)

    def _imported(self, point: "EntryPoint") -> Callable[..., T]:
        package = point.dist.name if point.dist else "an unknown package"
        try:
            make: Any = point.load()
        except Exception as error:
            raise ConfigurationError(
                f"{self.kind} {point.name!r} of {package}: cannot import {point.value}; "
                f"{type(error).__name__}: {error}"
            ) from error

        if not callable(make):
            raise ConfigurationError(
                f"{self.kind} {point.name!r} of {package}: {point.value} must be callable"
            )
        return cast(Callable[..., T], make)


def _attribute(path: str) -> Any:
    """The object that MODULE:ATTRIBUTE names."""
    module, _, attribute = path.partition(":")
    return getattr(importlib.import_module(module), attribute)
