"""Hooks of MkDocs: pages that stand elsewhere in the repository, and the API pages.

A page is generated for each room, from the docstrings of its modules.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig

ROOT: Final = Path(__file__).parents[1]
PACKAGES: Final = ("onboard", "sitl", "gcs_tools")
# Pages of the site by the file that they show, relative to the repository.
PAGES: Final = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "onboard/contract/THEORY.md": "theory.md",
}
_LINK: Final = re.compile(r"\[([^\]]*)\]\((?!https?:|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the API pages to the navigation."""
    if config.nav is not None:
        config.nav.append({"API": list(api_pages())})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, and link the pages of docs/ to them."""
    for name, page in PAGES.items():
        content = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=linked(content, Path(name).parent)))
    for page, content in api_pages().items():
        files.append(File.generated(config, page, content=content))
    return files


def on_page_read_source(page: object, config: MkDocsConfig) -> str | None:
    """Return a page of docs/ with its links outside of docs/ turned into links within the site."""
    source = getattr(getattr(page, "file", None), "abs_src_path", None)
    if source is None or not Path(source).is_relative_to(config.docs_dir):
        return None
    return linked(Path(source).read_text(encoding="utf-8"), Path(source).parent.relative_to(ROOT))


def linked(content: str, directory: Path) -> str:
    """Turn links relative to a directory of the repository into links between pages of the site.

    A link to a file or folder that the site does not show, such as a program, becomes its text.
    """

    def replaced(found: re.Match[str]) -> str:
        text, path, anchor = found[1], found[2], found[3] or ""
        target = (ROOT / directory / path).resolve()
        name = target.relative_to(ROOT).as_posix() if target.is_relative_to(ROOT) else ""
        if name in PAGES:
            return f"[{text}]({PAGES[name]}{anchor})"
        if name.startswith("docs/"):
            return f"[{text}]({name.removeprefix('docs/')}{anchor})"
        return text

    return _LINK.sub(replaced, content)


def api_pages() -> dict[str, str]:
    """Return the content of the API pages by their names: an index, and one for each room."""
    pages, index = {}, ["# API", "", "One page for each room; `__init__` says what it is for.", ""]
    for package in PACKAGES:
        rooms = sorted({path.parent for path in (ROOT / package).rglob("*.py")})
        for room in rooms:
            name = ".".join(room.relative_to(ROOT).parts)
            pages[f"api/{name}.md"] = _room_page(name, room)
            index.append(f"- [`{name}`]({name}.md)")
    return {"api/index.md": "\n".join([*index, ""]), **pages}


def _room_page(name: str, room: Path) -> str:
    modules = [f"{name}.{path.stem}" for path in sorted(room.glob("*.py")) if path.stem[:2] != "__"]
    parts = [f"# {name}", f"::: {name}\n    options:\n      members: false\n      heading_level: 2"]
    return "\n\n".join([*parts, *(f"::: {module}" for module in modules)]) + "\n"
