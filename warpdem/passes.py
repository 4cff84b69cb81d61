"""Launches in order, as one graph; on a CPU shared out among threads."""

import ctypes
import os
import threading
import warnings
import weakref
from copy import copy

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .errors import InputError, ModelWarning
from .kernels.memory import CHUNK, is_patched, is_shareable, rendezvous, wait_for

SHARED = 4096  # indices of a launch from which on it is worth sharing out
BATCH = 32  # times that launches repeat in a graph of a team's
MANY = 128  # launches from which on it is worth its making
PATIENCE = 10_000  # looks of a waiting thread before it sleeps


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Team:
    """Threads of a CPU that go through graphs side by side.

    Every thread has a graph of its own: a share of each launch, and a rendezvous after it. Nothing
    a launch does depends on how it is shared out, as a kernel writes at its own index only, so
    results are the same to the bit for any number of threads.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        # a cache line of 8 each: arrivals at rendezvous, graphs begun
        self._counters = wp.zeros(16, dtype=wp.uint64, device="cpu")
        give_way = wp.uint64(_address_of_yield())
        inputs = [self._counters, wp.uint64(threads), give_way]
        self.meet = wp.launch(rendezvous, 1, inputs, device="cpu", record_cmd=True)
        self._work = _Work(self._counters.numpy())
        wait = [self._counters, wp.uint64(0), PATIENCE, give_way]
        for rank in range(1, threads):
            launch = wp.launch(wait_for, 1, wait, device="cpu", record_cmd=True)
            threading.Thread(
                target=_follow, args=(self._work, launch, self._counters, rank), daemon=True
            ).start()
        weakref.finalize(self, self._work.end)

    def capture(self, launches: list[wp.Launch]) -> list[wp.Graph]:
        """A graph for each thread."""
        graphs = []
        for rank in range(self.threads):
            with wp.ScopedCapture(device="cpu") as capture:
                for launch in launches:
                    share = self._share(launch, rank)
                    if share is not None:
                        share.launch()
                    self.meet.launch()
            graphs.append(capture.graph)
        return graphs

    def launch(self, graphs: list[wp.Graph]) -> None:
        """All graphs side by side; returns when the last has ended."""
        self._work.begin(graphs)
        wp.capture_launch(graphs[0])

    def _share(self, launch: wp.Launch, rank: int) -> wp.Launch | None:
        """The part of a launch that falls to a thread; a small one falls to the first whole."""
        size = launch.bounds.size
        if size < SHARED or not is_shareable(launch.kernel):
            return launch if rank == 0 else None
        # whole loops each, so that an index meets the same instructions whoever takes it
        ends = [CHUNK * round(size * r / self.threads / CHUNK) for r in range(self.threads)]
        ends.append(size)
        first, last = ends[rank], ends[rank + 1]
        share = copy(launch)
        share.params = list(launch.params)
        share.bounds = share.params[0] = type(launch.bounds)(last)
        share.bounds.shape[0] = last + first  # memory.py: the loop starts at shape - size
        return share


def team_of(threads: int, device: str) -> Team | None:
    """A team, or None for a single thread. Raises InputError for a number that cannot be."""
    if not 1 <= int(threads) <= cores():
        raise InputError(
            f"threads is {threads}; this process may use {cores()} cores: give 1 to {cores()}."
        )
    if threads == 1:
        return None
    if device != "cpu":
        raise InputError(f"threads is {threads}; threads are of a CPU, and device is {device!r}.")
    if not is_patched():
        warnings.warn(
            "the code that this version of Warp writes for a CPU is not known to warpdem, so one "
            "thread does all the work, in plain loops.",
            ModelWarning,
            stacklevel=5,
        )
        return None
    return Team(int(threads))


class _Work:
    """What the leading thread tells those that follow."""

    def __init__(self, counters: NDArray[np.uint64]) -> None:
        self.graphs: list[wp.Graph] = []
        self.over = False
        self._counters = counters
        self._sleepers: list[threading.Event] = []

    def begin(self, graphs: list[wp.Graph]) -> None:
        self.graphs = graphs
        self._counters[8] += np.uint64(1)
        while self._sleepers:
            self._sleepers.pop().set()

    def end(self) -> None:
        self.over = True
        self.begin([])

    def sleep(self, begun: int) -> None:
        """Until the next graph after that many begins."""
        bell = threading.Event()
        self._sleepers.append(bell)
        if int(self._counters[8]) > begun:
            return
        bell.wait()

    def has_begun(self, begun: int) -> bool:
        return int(self._counters[8]) > begun


def _follow(work: _Work, wait: wp.Launch, counters: wp.array, rank: int) -> None:
    """A thread's life; it holds `counters` so that they outlast it."""
    begun = 0
    while True:
        wait.set_param_by_name("begun", wp.uint64(begun))
        wait.launch()
        if not work.has_begun(begun):
            work.sleep(begun)
        begun += 1
        if work.over:
            return
        wp.capture_launch(work.graphs[rank])


def _address_of_yield() -> int:
    """Of the system's function that lets other threads run; 0 where there is none."""
    name = "SwitchToThread" if os.name == "nt" else "sched_yield"
    library = ctypes.CDLL("kernel32" if os.name == "nt" else None)
    function = getattr(library, name, None)
    return 0 if function is None else ctypes.cast(function, ctypes.c_void_p).value or 0


class Part:
    """Entries [first, first + count) of a list on the device whose length changes."""

    def __init__(self) -> None:
        self.first = self.count = 0


class Varying:
    """A launch over a part of a list, as long as it is when it is launched; over nothing, none."""

    def __init__(self, launch: wp.Launch, part: Part) -> None:
        self.launched, self.part = launch, part
        names = [x.label for x in launch.kernel.adj.args]
        self._takes_first = "first" in names
        self._first = self._count = -1

    def launch(self) -> None:
        """Launch it."""
        part = self.part
        if not part.count:
            return
        if part.count != self._count:
            self._count = part.count
            self.launched.set_dim(part.count)
        if self._takes_first and part.first != self._first:
            self._first = part.first
            self.launched.set_param_by_name("first", part.first)
        self.launched.launch()


Launched = wp.Launch | Varying


class Passes:
    """Launches in order, from their second time on one graph, or one for each of a team.

    A launch costs several microseconds, a node of a graph a fraction of one. A team, whose threads
    have to be told of each graph, makes many launches on end by graphs of `BATCH` of them.
    """

    def __init__(
        self, launches: list[wp.Launch | None], device: str, team: Team | None = None
    ) -> None:
        # a launch over nothing, as of the bonds of a single element, is None
        self.launches = [x for x in launches if x is not None]
        self.device, self.team = device, team
        self.graphs: list[wp.Graph] = []
        self._batch: list[wp.Graph] = []
        self._count = 0

    def launch(self, times: int = 1) -> None:
        """Launch them all, so many times."""
        if not self.launches:
            return
        if not self.graphs:
            for launch in self.launches:
                launch.launch()
            self.graphs = self._capture(1)
            times -= 1
        if self.team is None:
            for _ in range(times):
                wp.capture_launch(self.graphs[0])
            return
        self._count += times
        if not self._batch and self._count > MANY and times >= BATCH:
            self._batch = self._capture(BATCH)
        while self._batch and times >= BATCH:
            self.team.launch(self._batch)
            times -= BATCH
        for _ in range(times):
            self.team.launch(self.graphs)

    def _capture(self, times: int) -> list[wp.Graph]:
        launches = self.launches * times
        if self.team is not None:
            return self.team.capture(launches)
        with wp.ScopedCapture(device=self.device) as capture:
            for launch in launches:
                launch.launch()
        return [capture.graph]
