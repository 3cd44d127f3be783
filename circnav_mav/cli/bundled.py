"""Mission and campaign files bundled with circnav. Commands accept their names, as in `circnav fly
quickstart`."""

from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from circnav_mav.cli.exits import Refused

CONFIG = Path(str(files("circnav_mav.config")))
FOLDERS = {"mission": CONFIG, "campaign": CONFIG / "campaigns"}


def names(kind: str) -> list[str]:
    """Return the names of the bundled files."""
    return sorted(map(listed_name, FOLDERS[kind].glob("*.toml")))


def listed_name(path: Path) -> str:
    """Return the name of a bundled file. Files for ArduPilot are named by vehicle kind, as in
    `plane`."""
    return path.stem.removeprefix("ardu").replace("_", "-")


def bundled(kind: str, name: str) -> Path | None:
    """Return the path of the bundled file with this name, or None. Examples of names: `px4-plane`,
    or `plane` for ArduPilot."""
    wanted = name.lower().replace("-", "_")
    paths = (FOLDERS[kind] / f"{start}{wanted}.toml" for start in ("", "ardu"))
    return next(filter(Path.is_file, paths), None)


class FileOrName(click.ParamType):  # type: ignore[type-arg]
    """Type of a command-line parameter: the path of a file, or the name of a bundled file. A file
    in the current folder has priority over a bundled file of the same name."""

    def __init__(self, kind: str) -> None:
        self.kind = self.name = kind

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the path. Raises Refused if the value is neither a file nor a bundled name."""
        try:
            return self._file(value)
        except OSError as error:
            raise Refused(f"{value}: {error.strerror or error}") from None

    def _file(self, value: str) -> str:
        path = Path(value)
        found = bundled(self.kind, path.stem)
        if path.name == path.stem == value and not path.is_file():
            if found is None:
                known = names(self.kind)
                near = "".join(
                    f", did you mean {name}?" for name in get_close_matches(value, known, 1)
                )
                raise Refused(
                    f"{value}: is not a file and not a bundled {self.kind}{near}; bundled:"
                    f" {', '.join(known)}"
                )
            return str(found)
        if found is not None and not path.exists():
            raise Refused(
                f"{value}: no such file; give the bundled one by its name:"
                f" {path.stem.replace('_', '-')}"
            )
        return value

    def get_missing_message(self, param: click.Parameter, ctx: click.Context | None) -> str:
        """Return a description of valid values."""
        return f"A file, or the name of a bundled {self.kind}: {', '.join(names(self.kind))}."

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[Any]:
        """Return shell completions. The file entry must be the first: the shell's list of files
        replaces all entries before it."""
        fits = [name for name in names(self.kind) if name.startswith(incomplete)]
        return [CompletionItem(incomplete, type="file"), *map(CompletionItem, fits)]
