"""Imports in a checkout that shadows the installed package, or is not installed at all."""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

FOLDERS = {"circnav_sim": "sim", "circnav_mav.config": "config"}
"""Folders of the repository, by installed package name, as in pyproject.toml."""


class CheckoutFinder:
    """Finds the packages in FOLDERS in the repository that contains the source of circnav_mav."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a package in FOLDERS, or None for any other module."""
        if name not in FOLDERS:
            return None
        folder = self._root / FOLDERS[name]
        return spec_from_file_location(
            name, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )


def add_folders(root: Path) -> None:
    """Make the packages in FOLDERS importable from the repository at `root`, before installed
    ones, which may be of another version."""
    sys.meta_path.insert(0, CheckoutFinder(root))
