"""The mission and campaign files that come with circnav: they go by name, as in `circnav fly quickstart`."""

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
    """What is bundled, as people type it: ArduPilot's vehicles by their kind."""
    return sorted(path.stem.removeprefix("ardu").replace("_", "-") for path in FOLDERS[kind].glob("*.toml"))


def bundled(kind: str, name: str) -> Path | None:
    """The file of a name, None where there is none: `px4-plane`; `plane` is ArduPilot's."""
    wanted = name.lower().replace("-", "_")
    paths = (FOLDERS[kind] / f"{start}{wanted}.toml" for start in ("", "ardu"))
    return next(filter(Path.is_file, paths), None)


class FileOrName(click.ParamType):  # type: ignore[type-arg]
    """A file, or the name of a bundled one; a file of that name in the current folder comes first."""

    def __init__(self, kind: str) -> None:
        self.kind = self.name = kind

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The path. Raises Refused for a word that is neither."""
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
                near = "".join(f", did you mean {name}?" for name in get_close_matches(value, known, 1))
                raise Refused(f"{value}: is no file and no bundled {self.kind}{near}; bundled: {', '.join(known)}")
            return str(found)
        if found is not None and not path.exists():
            raise Refused(f"{value}: no such file; the bundled one goes by its name: {path.stem.replace('_', '-')}")
        return value

    def get_missing_message(self, param: click.Parameter, ctx: click.Context | None) -> str:
        """What the argument may be."""
        return f"A file, or the name of a bundled {self.kind}: {', '.join(names(self.kind))}."

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Files first: the shell's own list of them takes the place of what came before."""
        fits = [name for name in names(self.kind) if name.startswith(incomplete)]
        return [CompletionItem(incomplete, type="file"), *map(CompletionItem, fits)]
