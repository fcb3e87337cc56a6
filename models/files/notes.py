"""Lines about a vehicle, kept in text elements of its spec: what is left out, what is computed."""

from collections.abc import Iterable

import mujoco

COMPUTED = "computed_"  # begins the name of a text element about a computed part
_NOTE = "note_"  # follows it in that of a line about the file


def note(spec: mujoco.MjSpec, lines: Iterable[str]) -> None:
    """Keep lines about a vehicle's file in its spec, for `computed`."""
    first = 1 + sum(name.startswith(_NOTE) for name in computed(spec))
    for i, line in enumerate(lines, start=first):
        spec.add_text(name=f"{COMPUTED}{_NOTE}{i}", data=line)


def computed(spec: mujoco.MjSpec) -> dict[str, str]:
    """What a spec states of itself: a line by the name of each computed part, and the notes."""
    texts = [text for text in spec.texts if text.name.startswith(COMPUTED)]
    return {text.name.removeprefix(COMPUTED): text.data for text in texts}


def forget(spec: mujoco.MjSpec, name: str = "") -> None:
    """Delete what a spec states of a computed part, or of all.

    A saved MJCF may describe another state.
    """
    for text in list(spec.texts):
        part = text.name.removeprefix(COMPUTED)
        if text.name.startswith(COMPUTED) and name in ("", part):
            spec.delete(text)
