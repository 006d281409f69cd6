# SPDX-License-Identifier: GPL-3.0-or-later
"""A Dask cluster, which spreads frames or jobs over machines and tries again when a worker dies.

A frame is a function of its pose alone, so it does not matter who solves it. Workers need the packages
`distributed` and `dermis_native` of the version used here, for frames neither Blender nor this add-on: what they
run is sent along.
"""

from __future__ import annotations

import itertools
import operator
import sys
import uuid
from collections.abc import Callable, Generator, Iterable, Sequence
from functools import partial
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

        # Built by a worker from arrays, and again by another one when that worker dies. What is Dermis' own goes
        # as bytes: by itself Dask would name the module, which a worker has not.
        skin = self._send(cloudpickle.loads, cloudpickle.dumps(frames))
        solve = self._send(cloudpickle.loads, cloudpickle.dumps(_positions))

        def send(piece: range) -> Any:
            poses = cloudpickle.dumps([samples[index] for index in piece])
            return self._send(operator.call, solve, skin, poses, dermis_native.__version__)

        pieces = [range(start, min(start + PIECE, len(samples))) for start in range(0, len(samples), PIECE)]
        try:
            for number, future in self._done((partial(send, piece) for piece in pieces), PIECES_PER_WORKER, stop):
                yield from zip(pieces[number], self._result(future), strict=True)
        finally:
            self._client.cancel([skin, solve])

    def done(
        self, task: Callable[..., Any], inputs: Sequence[tuple[Any, ...]]
    ) -> Generator[tuple[int, Any | InputError]]:
        """Index and result of `task(*inputs, stopped)` for each of the inputs, in any order, one at a time on each
        worker; an InputError in the place of a result that there is not.

        `stopped` says whether the result is still wanted: after leaving the generator early it is not.
        """
        import cloudpickle
        import distributed

        make: Any = distributed.Event
        end = make(f"dermis-{uuid.uuid4().hex}", client=self._client)
        work = self._send(cloudpickle.loads, cloudpickle.dumps(partial(_until, end.name, task)))
        orders = (partial(self._send, operator.call, work, *each) for each in inputs)
        try:
            for number, future in self._done(orders, 1, lambda: None):
                try:
                    result = self._result(future)
                except InputError as error:
                    result = error
                yield number, result
        finally:
            end.set()
            self._client.cancel([work])

    def _send(self, task: Callable[..., Any], *inputs: Any) -> Any:
        return self._client.submit(task, *inputs, pure=False, retries=RETRIES)

    def _done(
        self, orders: Iterable[Callable[[], Any]], per_worker: int, stop: Callable[[], None]
    ) -> Generator[tuple[int, Any]]:
        """Number and future of each order when it is done; so many are under way for each worker."""
        import distributed

        wait: Any = distributed.wait
        waiting = enumerate(orders)
        running: dict[Any, int] = {}
        try:
            while True:
                free = max(1, self._workers()) * per_worker - len(running)
                running.update((send(), number) for number, send in itertools.islice(waiting, max(free, 0)))
                if not running:
                    return
                stop()
                try:
                    with self._client.as_current():
                        done = wait(list(running), timeout=POLL_SECONDS, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    continue
                for future in done:
                    yield running.pop(future), future
        finally:
            self._client.cancel(list(running))

    def _result(self, future: Any) -> Any:
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            raise InputError(f"Workers of '{self._address}' died again and again: {error}.") from error
        except ModuleNotFoundError as error:
            raise InputError(f"A worker of '{self._address}' lacks a package: {error}.") from error
        except (OSError, ValueError) as error:
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


def _until(end: str, task: Callable[..., Any], *inputs: Any) -> Any:
    """What a worker does; the name is that of the event which ends it."""
    import distributed

    make: Any = distributed.Event
    return task(*inputs, make(end).is_set)
