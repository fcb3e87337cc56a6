"""Random streams of one case of an experiment, one for each named quantity that is drawn."""

import zlib
from collections.abc import Iterable, Mapping
from string import hexdigits

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown

_WIDTHS = (128, 128, 1, 32)  # [bits] of the four numbers of a state


class Streams:
    """Random streams of one case. Each name has its own stream, so that adding, removing or
    extending a draw does not change the others.

        streams = Streams(seed, run)
        speed = streams["current speed"].uniform(0.0, 0.4)

    A stream that is requested again continues where it stopped.
    """

    def __init__(self, *key: int, states: Iterable[tuple[str, str]] = ()) -> None:
        """Make streams from a key, or from states that were saved.

        Args:
            key: Numbers, at least 0, that identify the case: the seed of the experiment, and the
                number of the run.
            states: Initial state of the stream of each name (`state_of`). If states are given,
                there are no other names, and the key has no effect.
        """
        self._key = key
        self._states = dict(states)
        self._streams: dict[str, np.random.Generator] = {}

    def __getitem__(self, name: str) -> np.random.Generator:
        """The stream of a name.

        Raises:
            ConfigurationError: The saved states have none of that name.
        """
        if name not in self._streams:
            self._streams[name] = self._begin(name)
        return self._streams[name]

    def _begin(self, name: str) -> np.random.Generator:
        if not self._states:
            # depends neither on other draws nor on the process
            return np.random.default_rng([*self._key, zlib.crc32(name.encode())])
        if name not in self._states:
            raise ConfigurationError(
                f"no stream {shown(name)} was kept; there are {', '.join(self._states)}"
            )
        return _in_state(self._states[name])


def state_of(rng: np.random.Generator) -> str:
    """State of a generator of `np.random.default_rng`: four hexadecimal numbers in a text.

    Raises:
        ConfigurationError: The generator is of another kind.
    """
    state = rng.bit_generator.state
    if state["bit_generator"] != "PCG64":
        raise ConfigurationError(f"state of a stream: PCG64 only, got {state['bit_generator']}")

    inner: Mapping[str, int] = state["state"]
    numbers = (inner["state"], inner["inc"], state["has_uint32"], state["uinteger"])
    return " ".join(f"{number:x}" for number in numbers)


def _in_state(text: str) -> np.random.Generator:
    """A generator in a state that `state_of` returned.

    Raises:
        ConfigurationError: The text is not such a state.
    """
    words = text.split()
    numbers = [int(word, 16) for word in words if set(word) <= set(hexdigits)]
    fit = [0 <= number < 1 << bits for number, bits in zip(numbers, _WIDTHS, strict=False)]
    if not len(words) == len(numbers) == len(_WIDTHS) or not all(fit):
        raise ConfigurationError(
            f"state of a stream: must be a text written by `state_of`, got {shown(text)}"
        )

    state, inc, has_uint32, uinteger = numbers
    bits = np.random.PCG64()
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": state, "inc": inc},
        "has_uint32": has_uint32,
        "uinteger": uinteger,
    }
    return np.random.Generator(bits)
