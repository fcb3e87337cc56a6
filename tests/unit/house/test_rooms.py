"""The map of rooms in CONTRIBUTING.md is the tree."""

import pytest

import room_map


def test_the_map_of_rooms_is_the_tree():
    page = room_map.FILE.read_text(encoding="utf-8")
    assert page == room_map.with_map(page), "./uvw run tests/support/room_map.py writes it"


def test_the_map_has_every_package_with_its_purpose():
    folders = dict(room_map.packages())
    assert {"models", "sim/plant", "uuv", "uuv/cli", "scripts/experiments/faults"} <= folders.keys()
    assert "uuv/models" not in folders
    assert all(folders.values())
    assert set(dict(room_map.orders_of_imports())) == {"uuv", *room_map.ROOMS}


def test_another_map_is_written_anew_and_a_page_without_marks_is_refused():
    stale = f"# Rooms\n{room_map.BEGIN}\n| `gone/` | nothing |\n{room_map.END}\nmore\n"
    page = room_map.with_map(stale)
    assert "gone/" not in page
    assert room_map.with_map(page) == page
    assert page.startswith("# Rooms\n")
    assert page.endswith(f"{room_map.END}\nmore\n")
    with pytest.raises(ValueError, match="the page has no"):
        room_map.with_map("# Rooms\n")
