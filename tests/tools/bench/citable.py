"""Write a benchmark that can be cited: tables, figures, versions, seeds and BibTeX, in one folder.

    pip install -e '.[test]'
    python -m tests.tools.bench.citable --out benchmark

Guidance: every law in every situation of `circnav bench`. Place of the beacon: flights of the
bundled vehicle (`bench_locate`), and Plaza 1 and 2 if the extra [peers] is installed
(`bench_plaza`).
"""

import argparse
import os
import platform
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from circnav_mav import __version__
from circnav_mav.extras.bench import bench
from circnav_mav.extras.bench.flight import POLICIES
from circnav_mav.extras.bench.pictures import draw
from circnav_mav.extras.bench.situations import SITUATIONS, Situation
from circnav_mav.runtime.jobs import cores
from tests.process import ROOT
from tests.tools.bench import bench_locate

FTM = "one lap, WiFi FTM (2 m, 10 % outliers, 30 % lost)"
BESIDE = """\
| one unknown beacon, one vehicle | ranges | horizontal error, m |
|---|---|---|
| arXiv 2606.00075, real flight, online on a smartphone | 455, WiFi FTM, line of sight | 4.4 |
| the same flight, offline, best of six noise models | the same | 1.1 |
| circnav, {flights} emulated flights: median / 95 % | {situation} | {median:.1f} / {worst:.1f} |

The published rows are the final errors of one real flight in mountainous terrain, with a real radio
and a close flyby. Our row is emulated: white noise, outliers, losses, a GPS error of 1.5 m, and one
lap of a circle flown by range alone. It is no claim to be better: it shows the geometry and the
method, not the radio. Without line of sight their online estimate did not converge. We have not
tried that.
"""
BIBTEX = """\
% Benchmark of seed {seed}, {flights} flights a cell
{entries}
@misc{{arxiv260600075,
  title = {{Towards Networked One Search Agent Systems: Multilateration of {{WiFi}} Fine Time
           Measurement Responders Using {{GNSS}} References}},
  year = {{2026}},
  eprint = {{2606.00075}},
  archivePrefix = {{arXiv}}
}}
"""


def versions() -> str:
    """Return the versions of the product, Python and the packages that compute, as a table."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        needed = tomllib.load(file)["project"]["dependencies"]
    packages = {name: version(name) for name in (one.partition(">=")[0] for one in needed)}
    rows = {"circnav": __version__, "Python": platform.python_version(), **packages}
    return "| program | version |\n|---|---|\n" + "".join(
        f"| {name} | {number} |\n" for name, number in rows.items()
    )


def places(flights: int) -> dict[str, list[bench_locate.Result | None]]:
    """Return the results of the emulated flights by situation."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        return {
            situation.name: list(
                pool.map(partial(bench_locate.fly, situation), range(1, 1 + flights))
            )
            for situation in bench_locate.SITUATIONS
        }


def plaza() -> str:
    """Return the table of Plaza 1 and 2, or the reason why it is missing."""
    spec = find_spec("gtsam")
    if spec is None or spec.origin is None:
        return "Not computed: the data are in the wheel of gtsam (`pip install '.[peers]'`).\n"
    from tests.tools.bench import bench_plaza

    given = list(bench_plaza.beacons(Path(spec.origin).parent / "Data"))
    rows = [
        bench_plaza.row(name, method, given, each=False)
        for name, method in bench_plaza.METHODS.items()
    ]
    return "\n".join((bench_plaza.HEADER, "|---|---|---|---|---|---|", *rows)) + "\n"


def write(
    out: Path, *, flights: int, place_flights: int, seed: int, cells: list[tuple[Situation, str]]
) -> None:
    """Fly, and write the folder."""
    out.mkdir(parents=True, exist_ok=True)
    done = bench.run(cells, flights, seed, out, report=print, processes=cores(), form="pdf")
    draw(bench.table(done), out / "table.png")
    found = places(place_flights)
    errors = [one.error for one in found[FTM] if one is not None]
    rows = [bench_locate.row(one, found[one.name]) for one in bench_locate.SITUATIONS]
    entries = (ROOT / "docs" / "circnav.bib").read_text()
    (out / "CITATION.bib").write_text(BIBTEX.format(entries=entries, seed=seed, flights=flights))
    guidance = f"""\
Seed {seed}, {flights} flights a cell. The laws of a situation fly in the same worlds. Situations:
docs/measured.md. All figures: table.csv.

{(out / "table.md").read_text()}
![median RMS radius error](table.png)
"""
    emulated = "\n".join((f"Seeds 1 to {place_flights}.\n", bench_locate.HEADER, *rows))
    beside = BESIDE.format(
        flights=place_flights,
        situation=FTM,
        median=np.median(errors),
        worst=np.percentile(errors, 95),
    )
    parts = {
        "Guidance": guidance,
        "Place of the beacon, emulated": f"{emulated}\n",
        "Place of the beacon, beside a published flight": beside,
        "Place of the beacon, Plaza 1 and 2": plaza(),
        "Versions": f"{versions()}\n    {' '.join(sys.argv)}\n",
    }
    text = "".join(f"\n## {title}\n\n{part}" for title, part in parts.items())
    (out / "README.md").write_text(f"# Benchmark of circnav {__version__}\n{text}")


def main() -> None:
    """Write the folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--flights", type=int, default=10, help="flights a cell")
    parser.add_argument("--place-flights", type=int, default=50, help="flights a situation")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cells = [(situation, law) for situation in SITUATIONS.values() for law in POLICIES]
    write(
        options.out,
        flights=options.flights,
        place_flights=options.place_flights,
        seed=options.seed,
        cells=cells,
    )


if __name__ == "__main__":
    main()
