# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames solved by a Dask cluster, which spreads them over machines and tries again when a worker dies.

A frame is a function of its pose alone, so it does not matter who solves it. Workers need the packages
`distributed` and `dermis_native` of the version used here, and neither Blender nor this add-on: what they run is
sent along.
"""

from __future__ import annotations

import operator
import sys
from collections.abc import Callable, Generator, Sequence
from types import TracebackType
from typing import Any

import dermis_native

from .character import Weights
from .errors import InputError
from .skin_frames import PoseSample, SkinFrames

# Samples that a worker solves in one go, and how many such pieces are under way for each worker.
PIECE = 8
PIECES_PER_WORKER = 3
CONNECT_SECONDS = 20
POLL_SECONDS = 0.1
RETRIES = 5


class Cluster:
    """A connection to a scheduler, for the length of a `with` block."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._client: Any = None

    def __enter__(self) -> Cluster:
        try:
            import cloudpickle
            import distributed
        except ImportError as error:
            raise InputError(
                f"Dask needs the Python package 'distributed' here and on its workers ({error}): "
                f"install it with {sys.executable} -m pip install distributed."
            ) from error
        # The add-on's name differs from machine to machine.
        cloudpickle.register_pickle_by_value(sys.modules[__package__])
        try:
            # Its package has types, but not for this.
            client: Any = distributed.Client
            self._client = client(self._address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"There is no Dask scheduler at '{self._address}': {error}.") from error
        if not self._workers():
            self._client.close()
            raise InputError(f"The Dask scheduler at '{self._address}' has no worker: start some.")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()

    def solved(
        self, frames: SkinFrames, samples: Sequence[PoseSample], stop: Callable[[], None]
    ) -> Generator[tuple[int, Weights]]:
        """Index and positions (V,3) of each sample, in any order. `stop` raises when no more is wanted."""
        import cloudpickle
        import distributed

        wait: Any = distributed.wait

        def send(task: Callable[..., Any], *inputs: Any) -> Any:
            return self._client.submit(task, *inputs, pure=False, retries=RETRIES)

        # Built by a worker from arrays, and again by another one when that worker dies. What is Dermis' own goes
        # as bytes: by itself Dask would name the module, which a worker has not.
        skin = send(cloudpickle.loads, cloudpickle.dumps(frames))
        solve = send(cloudpickle.loads, cloudpickle.dumps(_positions))
        waiting = [range(start, min(start + PIECE, len(samples))) for start in range(0, len(samples), PIECE)]
        waiting.reverse()
        running: dict[Any, range] = {}
        try:
            while waiting or running:
                while waiting and len(running) < max(1, self._workers()) * PIECES_PER_WORKER:
                    piece = waiting.pop()
                    poses = cloudpickle.dumps([samples[index] for index in piece])
                    running[send(operator.call, solve, skin, poses, dermis_native.__version__)] = piece
                stop()
                try:
                    with self._client.as_current():
                        done = wait(list(running), timeout=POLL_SECONDS, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    continue
                for future in done:
                    yield from zip(running.pop(future), self._result(future), strict=True)
        finally:
            self._client.cancel([skin, solve, *running])

    def _result(self, future: Any) -> list[Weights]:
        from distributed import KilledWorker

        try:
            return list(future.result())
        except KilledWorker as error:
            raise InputError(f"Workers of '{self._address}' died again and again: {error}.") from error
        except ModuleNotFoundError as error:
            raise InputError(f"A worker of '{self._address}' lacks a package: {error}.") from error
        except ValueError as error:
            raise InputError(f"A worker of '{self._address}' failed: {error}.") from error

    def _workers(self) -> int:
        return len(self._client.scheduler_info(n_workers=-1)["workers"])


def _positions(frames: SkinFrames, samples: bytes, version: str) -> list[Weights]:
    """What a worker does."""
    import cloudpickle
    import dermis_native as own

    if own.__version__ != version:
        raise ValueError(f"it has dermis_native {own.__version__} instead of {version}")
    return [frames.positions(sample) for sample in cloudpickle.loads(samples)]
