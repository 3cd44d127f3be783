"""The command `circnav export`."""

from pathlib import Path

from circnav_mav.cli.exits import Exit, Refused, refusing, say, warn
from circnav_mav.extras.mcap.layout import foxglove_layout
from circnav_mav.foreign import open_file
from circnav_mav.runlog.atomic_write import write_json
from circnav_mav.runlog.run_folder import Run, RunError, is_run, open_run

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of an MCAP file."""


def export_run(folder: str, mcap: str | None) -> int:
    """Write the MCAP file, by default into the folder, and its layout. Print the topics.
    Raises Refused."""
    if mcap is None:
        raise Refused("export: name the output format: --mcap")
    path = Path(mcap) if mcap else Path(folder) / "flight.mcap"
    with refusing(path, RunError):
        _check_place(path)
        runs = _runs(Path(folder))
        for run in runs.values():
            if not len(run.ticks.time):
                raise Refused(f"{run.folder}: an empty run without records", Exit.NOTHING_RECEIVED)
        try:
            from circnav_mav.extras.mcap.export import export_mcap

            counts = export_mcap(runs, path)
            layout = path.with_suffix(".layout.json")
            write_json(layout, foxglove_layout(list(runs)))
        except ImportError:
            raise Refused(
                "export --mcap needs the extra [mcap]: pip install 'circnav-mav[mcap]'"
            ) from None
    for run in runs.values():
        warn(run.damage_text)
    say(f"{path}: " + ", ".join(f"{count} messages on {topic}" for topic, count in counts.items()))
    say(f"{layout}: layout for Foxglove (Layouts, Import from file)")
    return Exit.DONE


def _runs(folder: Path) -> dict[str, Run]:
    """Return the run in a folder, or the runs in its subfolders, by the prefix of their topics.
    Raises RunError, OSError.

    A fleet folder holds one run folder for each vehicle.
    """
    parts = (
        [] if is_run(folder) or not folder.is_dir() else sorted(filter(is_run, folder.iterdir()))
    )
    return {f"/{part.name}": open_run(part) for part in parts} or {"": open_run(folder)}


def _check_place(path: Path) -> None:
    """Check that `path` does not exist or is an earlier export. Raises Refused, OSError."""
    if path.is_file():
        with open_file(path) as file:
            begin = file.read(len(MAGIC))
        if begin not in (MAGIC, b""):
            raise Refused(f"--mcap {path}: exists and is not an MCAP file: name another")
    elif path.exists():
        raise Refused(f"--mcap {path}: exists and is not a file: name another")
