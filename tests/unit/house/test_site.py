"""The site opens from disk: nothing of it is fetched, and its search has what it needs there."""

from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[3]


class _Settings(yaml.SafeLoader):
    """Reads mkdocs.yml without its extensions' own tags."""


_Settings.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def test_search_and_pages_need_no_server():
    settings = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), _Settings)
    assert {"search", "offline"} <= {p for p in settings["plugins"] if isinstance(p, str)}
    assert settings["use_directory_urls"] is False
    assert settings["theme"]["font"] is False

    # the theme's own replacement of workers is fetched: this one must go before it by its name
    scripts = settings["extra"]["polyfills"]
    assert any("iframe-worker" in script for script in scripts)
    local = [*scripts, *settings["extra_css"], *settings.get("extra_javascript", ())]
    assert all((ROOT / "docs" / file).is_file() for file in local)
