"""Lines about a vehicle that its spec keeps, in text elements: what its file leaves out, and what was computed."""

from collections.abc import Iterable

import mujoco

COMPUTED = "computed_"  # begins the name of a text element that tells a computed part
_NOTE = "note_"  # follows it in that of a line about the file


def note(spec: mujoco.MjSpec, lines: Iterable[str]) -> None:
    """Keep lines about a vehicle's file in its spec, for `computed`."""
    for i, line in enumerate(lines, start=1 + sum(name.startswith(_NOTE) for name in computed(spec))):
        spec.add_text(name=f"{COMPUTED}{_NOTE}{i}", data=line)


def computed(spec: mujoco.MjSpec) -> dict[str, str]:
    """What a spec tells of itself: one line by the name of each computed part, and the lines of `note`."""
    return {text.name.removeprefix(COMPUTED): text.data for text in spec.texts if text.name.startswith(COMPUTED)}


def forget(spec: mujoco.MjSpec, name: str = "") -> None:
    """Delete what a spec tells of a computed part, or of all: a saved MJCF may tell of another state."""
    for text in [each for each in spec.texts if each.name.startswith(COMPUTED)]:
        if name in ("", text.name.removeprefix(COMPUTED)):
            spec.delete(text)
