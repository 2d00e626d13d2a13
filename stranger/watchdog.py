"""Ends a child that uses more than it may, also while nobody waits for its answer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from gaugeblock.stranger.limits import GIGABYTE, Limits
from gaugeblock.stranger.usage import Usage, memory_left, usage

# Memory is filled at about a gigabyte a second and core: this is how far a limit can be overrun.
PERIOD = 0.1
# Not all memory of the kernel is counted for the process that asked for it. Below this share of the machine's
# the child goes, before the kernel chooses somebody else.
SHORT = 0.03


class Watchdog:
    """Looks at a child's usage ten times a second, and calls `kill` once, with the reason in `reason`."""

    def __init__(self, root: int, limits: Limits, kill: Callable[[], None]):
        self._root, self._limits, self._kill = root, limits, kill
        self._started = time.monotonic()
        self._done = threading.Event()
        self.reason = ""
        self.peak = Usage()
        self._thread = threading.Thread(target=self._watch, name="stranger watchdog", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Look no more."""
        self._done.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(PERIOD):
            now = usage(self._root)
            self.peak = Usage(
                memory=max(self.peak.memory, now.memory),
                cpu_seconds=max(self.peak.cpu_seconds, now.cpu_seconds),
                threads=max(self.peak.threads, now.threads),
            )
            self.reason = self._too_much(now)
            if self.reason:
                self._kill()
                return

    def _too_much(self, now: Usage) -> str:
        limits = self._limits
        if now.memory > limits.bytes:
            return f"it used more memory than {limits.bytes / GIGABYTE:g} GB (estimator.limits.memory_gb)"
        if now.cpu_seconds > limits.cpu_seconds:
            return f"it used more processor time than {limits.cpu_seconds:g} s (estimator.limits.cpu_seconds)"
        if memory_left() < SHORT:
            return "the machine ran short of memory"
        # The sandbox itself is a few processes more.
        if now.threads > limits.processes + 8:
            return f"it had more than {limits.processes} processes (estimator.limits.processes)"
        if time.monotonic() - self._started > limits.total_seconds:
            return f"it took longer than {limits.total_seconds:g} s in all (estimator.limits.total_seconds)"
        return ""
