"""The project's address: README, CITATION and pyproject say what the one constant says, and nothing
else does.
"""

import re
import runpy
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parent.parent
ADDRESS = runpy.run_path(str(ROOT / ".ci" / "address.py"))["ADDRESS"]


def disagreements(
    readme: str, citation: dict[str, object], project: dict[str, object], address: str
) -> list[str]:
    """What names another address than this one, or an address where there is none."""
    found = []
    clones = re.findall(r"git clone (\S+)", readme)
    if clones != ([address] if address else []):
        found.append(f"README clones {clones}")
    if citation.get("repository-code", "") != address or "url" in citation:
        found.append("CITATION.cff")
    urls = project.get("urls", {})
    assert isinstance(urls, dict)
    if set(urls.values()) != ({address} if address else set()):
        found.append(f"pyproject.toml has {urls}")
    return found


@pytest.fixture
def pages() -> tuple[str, dict[str, object], dict[str, object]]:
    """README, and what CITATION and pyproject hold."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    return (ROOT / "README.md").read_text(encoding="utf-8"), citation, project


def test_the_pages_name_the_address_that_there_is_and_no_other(pages) -> None:
    assert disagreements(*pages, ADDRESS) == []


def test_an_address_that_one_page_lacks_is_noticed(pages) -> None:
    assert len(disagreements(*pages, "https://example.org/other")) == 3


def test_a_readme_without_an_address_installs_from_its_folder(pages) -> None:
    assert bool(ADDRESS) or "pip install -c constraints.txt '." in pages[0]
