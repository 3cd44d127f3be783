"""pyproject.toml and setup.py against the repository: the wheel is complete, and its package page
has no dead links."""

import os
import re
import runpy
import subprocess
import sys
import tomllib
from importlib.resources import files
from pkgutil import resolve_name

import pytest
import setuptools

from circnav_mav import checkout
from circnav_mav.cli.init import schema_text
from tests.process import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SETUPTOOLS = PROJECT["tool"]["setuptools"]
FOLDERS = {"circnav_mav": "circnav_mav", **checkout.FOLDERS}
"""Folders of the repository, by installed package name."""


def contents():
    """Return the files of each package, by package name."""
    found = {}
    for package, folder in FOLDERS.items():
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                name = ".".join([package, *path.parent.relative_to(ROOT / folder).parts])
                found.setdefault(name, []).append(path)
    return found


def test_package_list_of_pyproject_is_complete():
    assert {name: folder for name, folder in FOLDERS.items() if name != folder} == SETUPTOOLS[
        "package-dir"
    ]
    assert len(set(SETUPTOOLS["packages"])) == len(SETUPTOOLS["packages"])
    assert set(SETUPTOOLS["packages"]) == set(contents())


def test_package_data_patterns_match_data_files():
    data = SETUPTOOLS["package-data"]
    used = set()
    for name, paths in contents().items():
        for path in paths:
            patterns = {(name, one) for one in data.get(name, ()) if path.match(one)}
            used |= patterns
            assert patterns or path.suffix == ".py" or path.name == "README.md", path
    assert used >= {(name, one) for name, patterns in data.items() for one in patterns} - {
        ("circnav_mav.config", "*.json")
    }
    assert not [path for paths in contents().values() for path in paths if path.is_symlink()]


def test_imported_packages_are_in_this_repository():
    """Editable and regular installs find the same files only if each folder is a package."""
    for name in contents():
        assert files(name).is_dir(), name


def test_checkout_imports_own_folders_when_not_installed(tmp_path):
    """A source folder on PYTHONPATH shadows an installed circnav_mav."""
    for folder in FOLDERS.values():
        (tmp_path / folder).symlink_to(ROOT / folder)
    program = """
import sys
sys.meta_path = [one for one in sys.meta_path if "editable" not in f"{one!r}".lower()]
import circnav_mav.config, circnav_sim.config
from circnav_mav import bench
print(circnav_mav.config.__file__, circnav_sim.config.__file__)
"""
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == [
        str(tmp_path / "config" / "__init__.py"),
        str(tmp_path / "sim" / "config.py"),
    ], done.stderr


@pytest.mark.parametrize(
    "reference",
    [
        *PROJECT["project"]["scripts"].values(),
        *PROJECT["project"]["entry-points"]["circnav.ranging"].values(),
    ],
)
def test_each_entry_point_can_be_imported(reference):
    assert callable(resolve_name(reference))


@pytest.mark.parametrize("kind", ["mission", "campaign"])
def test_shipped_schemas_match_core_and_extras(kind):
    assert schema_text(kind) == (ROOT / "config" / f"{kind}.schema.json").read_text(
        encoding="utf-8"
    )


def test_long_description_is_readme_without_relative_links(
    monkeypatch,
):
    """The package index has no other file of the repository, so relative links would be dead."""
    given = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    runpy.run_path(str(ROOT / "setup.py"))
    page = given["long_description"]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert given["long_description_content_type"] == "text/markdown"
    assert re.findall(r"\]\((?!https?:|#)", page) == []
    assert not re.search(r"<(img|a) ", page)
    assert len(re.findall(r"\]\((?!https?:|#)", readme)) > 10, "no relative link in README.md"
    commands = r"^```sh\n(.*?)^```"
    kept = [re.findall(commands, text, re.MULTILINE | re.DOTALL) for text in (page, readme)]
    assert kept[0] == kept[1]
