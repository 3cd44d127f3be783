"""flight.png: drawn for every kind of run."""

import pytest

from circnav_mav.analysis.plots import plot_flight
from circnav_mav.analysis.run_folder import read_ticks, read_truth
from circnav_mav.core.values import Direction, Orbit

ORBIT = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)


@pytest.mark.parametrize("kind", [{}, {"truth": False}, {"engaged": False}], ids=["truth", "no truth", "never engaged"])
def test_every_run_has_its_picture(run_folder, epoch_us, tmp_path, kind):
    folder = run_folder(**kind)
    plot_flight(tmp_path / "flight.png", read_ticks(folder), read_truth(folder, epoch_us), ORBIT, "by hand")
    picture = (tmp_path / "flight.png").read_bytes()
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert len(picture) > 10_000


def test_a_picture_that_cannot_be_written_is_an_error_of_the_system(run_folder, epoch_us, tmp_path):
    folder = run_folder()
    with pytest.raises(OSError, match="No such file or directory"):
        plot_flight(tmp_path / "no" / "x.png", read_ticks(folder), None, ORBIT, "by hand")
