"""The gallery shows every job, object and vehicle, and its page is what the table prints."""

from pathlib import Path

import pytest
from PIL import Image

from uuv import jobs, models
from uuv.models.objects.targets import OBJECTS
from uuv.pictures import gallery
from uuv.pictures.filmed_jobs import FILMED
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.reporting.scene import clip


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gallery in a folder of its own, with an empty page."""
    monkeypatch.setattr(gallery, "CHECKOUT", tmp_path)
    monkeypatch.setattr(gallery, "FOLDER", tmp_path)
    monkeypatch.setattr(gallery, "FIGURES", tmp_path / "figures.json")
    monkeypatch.setattr(gallery, "PAGE", tmp_path / "gallery.md")
    return tmp_path


def frames(file: Path) -> int:
    with Image.open(file) as picture:
        return getattr(picture, "n_frames", 1)


def test_every_job_object_and_vehicle_is_shown():
    shown = {entry.name for entry in gallery.entries()}
    assert {job.command.split()[0] for job in FILMED} == set(jobs.JOBS.names())
    assert {f"object_{name}" for name in OBJECTS.names()} <= shown
    assert {f"vehicle_{models.describe(name).name}" for name in models.available()} <= shown


def test_the_page_is_that_of_the_table_and_its_pictures_are_there_and_small():
    entries = gallery.entries()
    assert gallery.PAGE.read_text("utf-8") == gallery.page(entries, gallery.kept_figures())
    files = sorted(gallery.FOLDER.glob("*.webp"))
    assert files == sorted(entry.file for entry in entries)
    assert sum(file.stat().st_size for file in files) <= gallery.MOST_BYTES
    clips = [file for file in files if frames(file) > 1]
    assert 0 < len(clips) <= gallery.MOST_CLIPS
    assert max(file.stat().st_size for file in clips) <= clip.MOST_BYTES
    assert gallery.kept_figures().keys() == {entry.name for entry in entries}


def test_a_picture_is_made_with_its_figures_and_stands_on_the_page(elsewhere: Path, capsys):
    (block,) = (entry for entry in gallery.entries() if entry.name == "object_block")
    gallery.PAGE.write_text("")
    gallery.make([block])
    with Image.open(elsewhere / "object_block.webp") as picture:
        assert picture.size == (800, 450)
    page = (elsewhere / "gallery.md").read_text("utf-8")
    assert "![block](gallery/object_block.webp)" in page
    assert "`uuv list objects`" in page
    assert "size 0." in page
    assert "object_valve" not in page  # not made here
    assert capsys.readouterr().out.strip() == "object_block.webp"


def test_too_many_bytes_and_a_missing_checkout_are_refused(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch
):
    with pytest.raises(ConfigurationError, match="a checkout of the project alone"):
        gallery.make([])
    gallery.PAGE.write_text("")
    (elsewhere / "large.webp").write_bytes(bytes(2000))
    monkeypatch.setattr(gallery, "MOST_BYTES", 1000)
    with pytest.raises(ConfigurationError, match=r"0.0 MB, 0.001 MB are allowed"):
        gallery.make([])
