"""Registry: things that are made by name, ours and those of other packages (entry points).

    VEHICLES = Registry("vehicle", {"uuv_puma": uuv_puma.build})
    spec = VEHICLES.load("uuv_puma")

A package adds its own in its pyproject.toml; the group is the registry's kind, the object a
callable that makes it:

    [project.entry-points."uuv_arm.object"]
    wellhead = "my_package.objects:wellhead"

Without a package, a name MODULE:ATTRIBUTE, such as my_objects:wellhead, is imported from the module
path.

A registry's own makers can be MODULE:ATTRIBUTE too: names are then known, and unknown ones refused,
before anything heavy is imported.
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
GROUP = "uuv_arm"  # of entry points, with the kind behind a dot


@dataclass(frozen=True, slots=True)
class MadeForm:
    """What a maker has to return."""

    words: str
    fits: Callable[[Any], bool]


class Registry(Generic[T]):
    """Makers by name for one kind of thing: "vehicle", "arm", "object", "tool", "soil", ..."""

    def __init__(
        self,
        kind: str,
        built_in: Mapping[str, Callable[..., T] | str],
        aliases: Mapping[str, str] | None = None,
        form: "MadeForm | None" = None,
    ) -> None:
        """Take the kind, its built-in makers by name, and other names for some of them.

        Args:
            kind: word that messages use, and the last part of the entry points' group.
            built_in: makers by name, or MODULE:ATTRIBUTE of one, imported when it is asked for;
                they take precedence over other packages' of the same name.
            aliases: built-in names by alias.
            form: of what a user's maker has to return; None: nothing is known of it.
        """
        self.kind = kind
        self._form = form
        self._built_in = dict(built_in)
        self._aliases = dict(aliases or {})
        self._found: dict[str, EntryPoint] | None = None

    def names(self) -> tuple[str, ...]:
        """All names that `load` knows, sorted."""
        return tuple(sorted({*self._built_in, *self._aliases, *self._of_packages()}))

    def __contains__(self, name: object) -> bool:
        """Whether `load` knows `name`."""
        return isinstance(name, str) and (
            name in self._built_in
            or name in self._aliases
            or ":" in name
            or name in self._of_packages()
        )

    def resolve(self, name: str) -> str:
        """The name that an alias stands for; another name as it is.

        Raises ConfigurationError for an unknown one.
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
            ConfigurationError: for an unknown name or option, with those there are, and for
                whatever another package's maker raises while it is imported or called.
        """
        name = self.resolve(name)
        is_built_in = name in self._built_in
        make = self.maker(name)

        # Options that the maker does not have, before it is called.
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

        # What another package raises is a fault of its name, not of the program.
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

        # A user's maker may return anything.
        if self._form is not None and not self._form.fits(instance):
            got = type(instance).__name__
            raise ConfigurationError(
                f"{self.kind} {name!r}: must return {self._form.words}, got {got}"
            )
        return instance

    def maker(self, name: str) -> Callable[..., T]:
        """The callable that makes the thing of that name.

        Raises:
            ConfigurationError: The name is unknown, or another package's maker cannot be imported.
        """
        name = self.resolve(name)
        if name in self._built_in:
            make = self._built_in[name]
            return cast(Callable[..., T], _attribute(make)) if isinstance(make, str) else make
        return self._of_user(name) if ":" in name else self._imported(self._of_packages()[name])

    def class_of(self, name: str, base: type, where: str) -> type[T]:
        """The dataclass of that name, which has to be a `base`.

        Args:
            name: as for `load`.
            base: class that all of this kind inherit, or whose `needs` says what is asked of one.
            where: begins the message about a class that is none.

        Raises:
            ConfigurationError: it is no dataclass or no `base`, or as `maker` does.
        """
        chosen: Any = self.maker(name)
        if isinstance(chosen, type) and issubclass(chosen, base) and is_dataclass(chosen):
            return cast(type[T], chosen)

        needs = getattr(base, "needs", f"inherits {base.__name__}")
        which = f"{self.kind} {shown(name)}"
        raise ConfigurationError(f"{where}: {which} must be a dataclass that {needs}")

    def name_of(self, make: Callable[..., T]) -> str | None:
        """The name under which `make` is built in, or another package's; None: under none."""
        path = f"{make.__module__}:{make.__qualname__}"
        for name, known in self._built_in.items():
            if known is make or known == path:
                return name

        return next((name for name in self._of_packages() if self.maker(name) is make), None)

    def _of_packages(self) -> "dict[str, EntryPoint]":
        if self._found is None:
            # reads the metadata of all packages
            from importlib.metadata import entry_points

            points = entry_points(group=f"{GROUP}.{self.kind}")
            self._found = {
                point.name: point for point in points if point.name not in self._built_in
            }
        return self._found

    def _of_user(self, name: str) -> Callable[..., T]:
        """The callable MODULE:ATTRIBUTE of a user."""
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
    """What MODULE:ATTRIBUTE names."""
    module, _, attribute = path.partition(":")
    return getattr(importlib.import_module(module), attribute)
