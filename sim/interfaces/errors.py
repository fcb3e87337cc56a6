"""One error tree. A message names the offending thing, what is allowed, and what was given."""


class UuvError(Exception):
    """Base of every error that this project raises on purpose; scripts turn it into one line and exit code 2."""


class ConfigurationError(UuvError, ValueError):
    """A value given at a door (file, option, argument) is not allowed."""


class HydrodynamicsError(UuvError):
    """The hydrodynamic model cannot be run as asked (solver, step length, MuJoCo's layout)."""


class MissingLibraryError(UuvError, ImportError):
    """A package that only some things need, or a system library of one, is not installed."""


class PerceptionError(UuvError):
    """Measurements do not hold what was asked of them (nothing seen, object not found)."""


class ReachError(UuvError):
    """A pose or path lies outside what the arm can take."""


class PhysicsWarning(UserWarning):
    """The physics runs, but a model looks unlike any real vehicle, or has gone beyond what it was judged for."""
