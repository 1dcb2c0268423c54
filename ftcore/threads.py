"""One BLAS thread while something flies: the same bits on one core and on many, in a notebook too.

A threaded BLAS splits sums among its threads, so the last bits of a product depend on how many there are. The matrices
here are small, and more threads would only get in each other's way.
"""

from __future__ import annotations

import threading
from contextlib import ContextDecorator
from functools import lru_cache

from threadpoolctl import LibController, ThreadpoolController


@lru_cache(maxsize=1)
def _libraries() -> tuple[LibController, ...]:
    """The BLAS libraries of this process; asked for when NumPy and SciPy are loaded."""
    return tuple(lib for lib in ThreadpoolController().lib_controllers if lib.user_api == "blas")


class _OneThread(ContextDecorator):
    """Context and decorator; may be entered again within, and from several threads at the same time.

    The number of threads belongs to the process. So it is set by whoever enters first and put back by whoever leaves
    last, and not by each in between, or one flight would hand its neighbour the threads back too early.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._before: tuple[tuple[LibController, int], ...] = ()

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                counted = ((library, library.get_num_threads()) for library in _libraries())
                self._before = tuple((library, number) for library, number in counted if number and number != 1)
                for library, _ in self._before:
                    library.set_num_threads(1)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                for library, number in self._before:
                    library.set_num_threads(number)
                self._before = ()


one_blas_thread = _OneThread()
"""``with one_blas_thread:`` or ``@one_blas_thread`` around whatever must give the same bits everywhere."""
