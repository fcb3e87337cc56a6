"""Notes about a vehicle, stored in text elements of its spec: parts left out, parts computed."""

from collections.abc import Iterable

import mujoco

from uuv.models.files.gazebo.entries import ReadEntry

COMPUTED = "computed_"  # beginning of the name of a text element about a computed part
_ENTRY = "entry_"  # beginning of the name of a text about water or a thruster of the file
_BETWEEN = " | "  # separator of the columns of such a text
_NOTE = "note_"  # the name of a note about the file has this after the first prefix


def note(spec: mujoco.MjSpec, lines: Iterable[str]) -> None:
    """Store lines about a vehicle's file in its spec, for `computed`."""
    first = 1 + sum(name.startswith(_NOTE) for name in computed(spec))
    for i, line in enumerate(lines, start=first):
        spec.add_text(name=f"{COMPUTED}{_NOTE}{i}", data=line)


def computed(spec: mujoco.MjSpec) -> dict[str, str]:
    """Stored lines of a spec: one by the name of each computed part, and the notes."""
    texts = [text for text in spec.texts if text.name.startswith(COMPUTED)]
    return {text.name.removeprefix(COMPUTED): text.data for text in texts}


def keep_entries(spec: mujoco.MjSpec, entries: Iterable[ReadEntry]) -> None:
    """Store the entries of a vehicle's file in its spec, for `entries_of`; equal parts become one
    entry.
    """
    alike: dict[tuple[str, ...], list[str]] = {}
    for entry in entries:
        key = entry.quantity, entry.value, entry.way, entry.origin
        alike.setdefault(key, []).append(entry.part)

    for i, (key, parts) in enumerate(alike.items(), start=1):
        spec.add_text(name=f"{_ENTRY}{i}", data=_BETWEEN.join((_joined(parts), *key)))


def entries_of(spec: mujoco.MjSpec) -> tuple[ReadEntry, ...]:
    """Entries of the file of a spec, as `keep_entries` stored them."""
    rows = [text.data.split(_BETWEEN) for text in spec.texts if text.name.startswith(_ENTRY)]
    return tuple(ReadEntry.of(row) for row in rows)


def _joined(parts: list[str]) -> str:
    """Names of parts, with their common beginning written once."""
    if len(parts) == 1:
        return parts[0]
    first = min(parts)
    last = max(parts)
    same = [a == b for a, b in zip(first, last, strict=False)]
    common = first[: same.index(False) if False in same else len(same)]

    return common + ", ".join(part.removeprefix(common) for part in parts)


def forget(spec: mujoco.MjSpec, name: str = "") -> None:
    """Delete the stored line about a computed part, or all of them.

    Needed because the lines of a saved MJCF may describe another state.
    """
    for text in list(spec.texts):
        if text.name.startswith(_ENTRY) and not name:
            spec.delete(text)
            continue

        part = text.name.removeprefix(COMPUTED)
        if text.name.startswith(COMPUTED) and name in ("", part):
            spec.delete(text)
