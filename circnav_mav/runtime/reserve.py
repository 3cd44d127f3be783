"""Memory, file descriptors and disk space that a flight takes before the engagement, so that a
limit of the computer cannot end the flight, or lose its summary."""

import errno
import os
from contextlib import suppress
from math import hypot
from pathlib import Path

from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import OwnMotion, RangeSample
from circnav_mav.mission.mission import Mission

NAME = ".reserve"
"""File that holds the disk space. At the end it becomes summary.json."""
SPACE = 4 << 20
"""Reserved disk space, bytes. The size is chosen, not measured."""
DESCRIPTORS = 16
"""Number of reserved file descriptors: the pipes of the drawing process, and the files that are
read and written at the end."""
MEMORY = 16 << 20
"""Reserved memory, bytes. The size is chosen, not measured."""
_pinned: list[bytes] = []
"""Objects that keep the arenas of Python's allocator."""


def take_memory(settings: Mission) -> None:
    """Take the memory of a flight: the buffers of the linear algebra, and room in the heap. Raises
    MemoryError."""
    # The first product of matrices allocates a buffer of 32 MB (OpenBLAS). If a limit denies it,
    # OpenBLAS ends the process: without this call in the first seconds of the guidance.
    if settings.estimator in ESTIMATORS:
        estimator = ESTIMATORS[settings.estimator](settings.tuning.estimation)
        speed = settings.orbit.speed
        for number in range(20):
            time = 0.1 * number
            estimator.move(OwnMotion(time, heading=0.0, turn_rate=0.0, airspeed=speed))
            r = hypot(settings.orbit.radius, speed * time)
            estimator.observe(RangeSample(stamp=time, time=time, r=r, sigma=1.0))
            estimator.at(time)
    # When a large block is freed for the first time, the C library returns it to the system. It
    # keeps the next block of this size for later allocations.
    for _ in range(2):
        bytearray(MEMORY)
    # Python's allocator keeps an arena of 1 MiB (Python 3.11) while one of its objects exists.
    # 400: size of an object that this allocator serves, bytes; about 2,500 fill an arena.
    objects = [bytes(400) for _ in range(MEMORY // 400)]
    _pinned[:] = objects[::2000]


class Reserve:
    """Disk space and file descriptors for the files that are written at the end of a flight."""

    def __init__(self, folder: Path) -> None:
        """Raises OSError if the descriptors or the space are not available."""
        self._path = folder / NAME
        self._file = self._path.open("wb", buffering=0)
        self._spare: list[int] = []
        try:
            for _ in range(DESCRIPTORS):
                self._spare.append(os.dup(self._file.fileno()))
            self._take_space()
        except OSError as error:
            self.close()
            if error.errno == errno.EMFILE:
                text = f"{DESCRIPTORS} more file descriptors are needed: raise ulimit -n"
                raise OSError(error.errno, text, str(folder)) from None
            raise

    def _take_space(self) -> None:
        try:
            os.posix_fallocate(self._file.fileno(), 0, SPACE)
        except OSError as error:
            # A limit of the file size (ulimit -f) below SPACE is no lack of space.
            if error.errno != errno.EFBIG:
                raise

    def release(self) -> None:
        """Free the descriptors."""
        while self._spare:
            os.close(self._spare.pop())

    def write(self, path: Path, text: str) -> None:
        """Write a file into the reserved space, which needs no free block, and free the rest of the
        space. Raises OSError."""
        self._file.seek(0)
        self._file.write(text.encode("utf-8", "replace"))
        self._file.truncate()
        self._file.close()
        os.replace(self._path, path)

    def close(self) -> None:
        """Free the space. Call after `write`, or if the flight has not begun."""
        self.release()
        self._file.close()
        with suppress(OSError):
            self._path.unlink(missing_ok=True)
