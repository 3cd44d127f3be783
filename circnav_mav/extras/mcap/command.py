"""The command `circnav export`."""

from pathlib import Path

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.foreign import open_file
from circnav_mav.runlog.run_folder import RunError, open_run

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of an MCAP file."""


def export_run(folder: str, mcap: str | None) -> int:
    """Write the MCAP file, by default into the folder, and print its topics. Raises Refused."""
    if mcap is None:
        raise Refused("export: name the output format: --mcap")
    path = Path(mcap) if mcap else Path(folder) / "flight.mcap"
    with refusing(path, RunError):
        _check_place(path)
        run = open_run(Path(folder))
        if not len(run.ticks.time):
            raise Refused(f"{folder}: an empty run without records", Exit.NOTHING_RECEIVED)
        try:
            from circnav_mav.extras.mcap.export import export_mcap

            counts = export_mcap(run, path)
        except ImportError:
            raise Refused("export --mcap needs the extra [mcap]: pip install 'circnav-mav[mcap]'") from None
    if run.damage_text is not None:
        say(f"  WARNING    {run.damage_text}")
    say(f"{path}: " + ", ".join(f"{count} messages on {topic}" for topic, count in counts.items()))
    return Exit.DONE


def _check_place(path: Path) -> None:
    """Refuse to overwrite anything except an earlier export. Raises Refused, OSError."""
    if path.is_file():
        with open_file(path) as file:
            begin = file.read(len(MAGIC))
        if begin not in (MAGIC, b""):
            raise Refused(f"--mcap {path}: exists and is not an MCAP file: name another")
    elif path.exists():
        raise Refused(f"--mcap {path}: exists and is not a file: name another")
